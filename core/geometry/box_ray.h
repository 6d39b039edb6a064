// SPDX-License-Identifier: Apache-2.0
//
// The slab test of a ray or segment against axis-aligned boxes, in floats. It culls, so it must
// never reject a box that holds a hit, and its entry is what distances are held to, so it must be
// monotone.
//
// Per axis k with face coordinate f: t = fl(fl(f - o) · inv), inv = fl(1 / d).
//
// 1. Monotone: for a fixed ray, subtraction and multiplication
//    round monotonically, so a box inside another one has no
//    smaller entry and no larger exit, bit for bit. A node's
//    entry never exceeds that of a triangle in it.
// 2. Conservative: t carries at most four relative roundings (d of
//    a segment, inv, difference, product), so |t - exact| <=
//    4.1·2^-24·|exact| + 2^-149. Entry <= exit in exact arithmetic,
//    with exit >= 0, therefore implies entry <= exit·kBoxExitScale
//    + kBoxExitShift; entry <= 1 implies entry <= kSegmentEnd.
// 3. d = 0: inv is infinite. A face on the ray's line gives 0·inf = NaN, which
//    minimum and maximum ignore (x86's minps and maxps return their second
//    operand then; all code here keeps the running value second). Elsewhere
//    ±inf says truthfully that the slab never or always holds the ray.
// 4. d subnormal: 1/d may overflow; inv is NaN, and the axis never culls.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_GEOMETRY_BOX_RAY_H_
#define SIGHTLINE_CORE_GEOMETRY_BOX_RAY_H_

#include <cmath>
#include <limits>

#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"

namespace sightline {

// 2·4.1 roundings of 2^-24 and their products stay below 16·2^-24 (see 2).
inline constexpr float kBoxExitScale = 1.0f + 0x1p-20f;
// Covers underflow of both products (see 2).
inline constexpr float kBoxExitShift = 0x1p-126f;
// No hit before a segment's end lies in a box entered later than this (see 2).
inline constexpr float kSegmentEnd = 1.0f + 0x1p-20f;

// The reciprocal that the slab test multiplies by (see 3 and 4).
inline float SlabReciprocal(float d) {
  if (d != 0 && std::abs(d) < std::numeric_limits<float>::min()) {
    return std::numeric_limits<float>::quiet_NaN();
  }
  return 1.0f / d;
}

struct BoxRay {
  Vec3f origin;
  Vec3f inv;

  // `direction` is a ray's stored direction, or fl(end - origin) of a segment.
  static BoxRay Make(Vec3f origin, Vec3f direction) {
    return {
        origin,
        {SlabReciprocal(direction.x), SlabReciprocal(direction.y), SlabReciprocal(direction.z)}};
  }
};

// Where the ray enters the box: -inf if no axis says anything.
inline float BoxEntry(const BoxRay& ray, const Box3f& box) {
  float entry = -std::numeric_limits<float>::infinity();
  for (int k = 0; k < 3; ++k) {
    const float face = std::signbit(ray.inv[k]) ? box.hi[k] : box.lo[k];
    const float t = (face - ray.origin[k]) * ray.inv[k];
    if (t > entry) entry = t;
  }
  return entry;
}

// Where it leaves the box: +inf if no axis says anything.
inline float BoxExit(const BoxRay& ray, const Box3f& box) {
  float exit = std::numeric_limits<float>::infinity();
  for (int k = 0; k < 3; ++k) {
    const float face = std::signbit(ray.inv[k]) ? box.lo[k] : box.hi[k];
    const float t = (face - ray.origin[k]) * ray.inv[k];
    if (t < exit) exit = t;
  }
  return exit;
}

// Conservative: false only if no point of the ray with 0 <= t lies in the box.
inline bool MayMeetBox(const BoxRay& ray, const Box3f& box) {
  const float exit = BoxExit(ray, box) * kBoxExitScale + kBoxExitShift;
  const float entry = BoxEntry(ray, box);
  return entry <= exit && 0 <= exit;
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_GEOMETRY_BOX_RAY_H_
