// SPDX-License-Identifier: Apache-2.0
//
// What a packet's points lie close above. Points that many lights are asked about mostly lie on a
// surface, and the triangle just beneath one, its ground, darkens half of all directions: found
// once, it answers each of them by a product or two, without a walk.
//
// With N the ground's unit normal toward the point P, h > 0 P's height above its plane, F the foot
// and m_k > 0 the distance of F from edge k, a line from P along D meets the plane within the
// edges if D leans toward none of them by more than m_k over a descent of h: surely if
//
//   -N·D > |D|·h/m_k for each k.
//
// The greatest of these ratios h/m_k is the point's `slope`: at a height of a hundredth of m_k half
// a degree below the horizon is left open. Rays along D are blocked then; segments from P to L are,
// with D = L - P, if L lies beyond the plane, too: -N·D > h.
//
// Rounding. Grounds are found in doubles. Differences of stored points err by v = 2^-53 of
// themselves, a cross product of two edges by no more than 9v|E|^2, E the longest, so that the unit
// normal and, across edges, inward ones are good to 16v·|E|^2/|E1×E2|: kGroundUnits, doubled, times
// |P - corner|_1 bounds what their products with it lose. Slivers, whose sine is below
// kLeastGroundSine, are no grounds, nor is what a point is not certainly above.
// What is asked of the rows is in floats: s = N·D carries three roundings of each product, one of
// each N_k and, of segments, one of each D_k, in all no more than 5.1u·|D|_1, u = 2^-24; h is
// rounded up, and adding it takes 1.1u·|D|_1 where -s > h. |D|_1, which is taken for |D|, loses 3u
// of itself, the slope twice u of itself, and so does their product once: at most kMostGroundSlope
// times 6.1u. kGroundSlack = 2^-20 = 16u, added to the slope, is more than all that. Underflow adds
// at most 2^-147, for which kFloatUnderflow stands (core/intersect).
//
// Thread safety: plain values; pure functions.
#ifndef SIGHTLINE_CORE_TRAVERSE_POINT_GROUND_H_
#define SIGHTLINE_CORE_TRAVERSE_POINT_GROUND_H_

#include <cstdint>
#include <limits>

#include "core/geometry/vec3.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

// Grounds whose slope is greater darken too little.
inline constexpr float kMostGroundSlope = 0.25f;
inline constexpr float kGroundSlack = 0x1p-20f;
inline constexpr double kLeastGroundSine = 0x1p-16;
inline constexpr double kGroundUnits = 0x1p-48;

// A packet's points, and theirs. Lanes behind the last point repeat it. Where clear leaves were
// looked for (clear_leaves.h), points that have none have another's normal.
struct alignas(64) PointGrounds {
  static constexpr int kMaxPoints = RayPacket::kMaxRays;

  static constexpr uint32_t kMostLeaves = 64;

  static constexpr float kNone = std::numeric_limits<float>::infinity();  // As a slope.

  int count = 0;
  // Leaves with a triangle beside the points, as ChildRef bits; of more than kMostLeaves some.
  uint32_t leaf_count = 0;
  uint32_t leaf[kMostLeaves];
  alignas(64) float x[kMaxPoints], y[kMaxPoints], z[kMaxPoints];
  alignas(64) float normal_x[kMaxPoints], normal_y[kMaxPoints], normal_z[kMaxPoints];
  alignas(64) float height[kMaxPoints], slope[kMaxPoints];

  Vec3f point(int i) const { return {x[i], y[i], z[i]}; }
  Vec3f normal(int i) const { return {normal_x[i], normal_y[i], normal_z[i]}; }
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_POINT_GROUND_H_
