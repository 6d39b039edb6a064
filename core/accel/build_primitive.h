// SPDX-License-Identifier: Apache-2.0
//
// What the BVH builder moves about: one triangle's box and id in 32 bytes, and four-float vectors
// to work on it (the compilers' vector extension: SSE without its names). Private to core/accel.
//
// Centroids are used doubled, lo + hi, rounded once: only their order matters, and they are at most
// 2^41.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_ACCEL_BUILD_PRIMITIVE_H_
#define SIGHTLINE_CORE_ACCEL_BUILD_PRIMITIVE_H_

#include <cstdint>
#include <cstring>
#include <limits>

#include "core/geometry/box3.h"

namespace sightline::bvh_build {

using Float4 = float __attribute__((vector_size(16)));
using Int4 = int32_t __attribute__((vector_size(16)));

inline Float4 LoadFloat4(const void* p) {
  Float4 v;
  std::memcpy(&v, p, sizeof(v));
  return v;
}
inline Float4 Broadcast(float x) { return Float4{x, x, x, x}; }
inline Float4 Min(Float4 a, Float4 b) { return a < b ? a : b; }
inline Float4 Max(Float4 a, Float4 b) { return a > b ? a : b; }

// Zero in the last lane, the rest as it is.
inline Float4 ClearLast(Float4 v) { return (Float4)((Int4)v & Int4{-1, -1, -1, 0}); }

struct alignas(32) Primitive {
  float lo[3];
  float zero;
  float hi[3];
  uint32_t id;

  Float4 lo4() const { return LoadFloat4(this); }
  // The last lane holds the id's bits: it may be carried along, but not calculated with (as a
  // denormal operand it would slow every multiplication down).
  Float4 hi4() const { return LoadFloat4(reinterpret_cast<const char*>(this) + sizeof(Float4)); }
  // Doubled; the last lane is 0.
  Float4 centroid() const { return lo4() + ClearLast(hi4()); }
  float centroid(int axis) const { return lo[axis] + hi[axis]; }
};
static_assert(sizeof(Primitive) == 32);

// A box whose last lanes mean nothing.
struct Box4 {
  Float4 lo = Broadcast(std::numeric_limits<float>::infinity());
  Float4 hi = Broadcast(-std::numeric_limits<float>::infinity());

  void Extend(Float4 p) {
    lo = Min(lo, p);
    hi = Max(hi, p);
  }
  void Extend(const Box4& b) {
    lo = Min(lo, b.lo);
    hi = Max(hi, b.hi);
  }
  void Extend(const Primitive& p) {
    lo = Min(lo, p.lo4());
    hi = Max(hi, p.hi4());
  }
  // Half the surface area of the box scaled by `scale` in each direction. REQUIRES: not empty.
  float HalfArea(float scale) const {
    const Float4 e = ClearLast(hi - lo) * Broadcast(scale);
    return (e[0] * e[1] + e[1] * e[2]) + e[2] * e[0];
  }
  Box3f ToBox3() const { return {{lo[0], lo[1], lo[2]}, {hi[0], hi[1], hi[2]}}; }
};

}  // namespace sightline::bvh_build

#endif  // SIGHTLINE_CORE_ACCEL_BUILD_PRIMITIVE_H_
