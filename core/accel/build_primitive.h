// SPDX-License-Identifier: Apache-2.0
//
// What the BVH builder moves about: one triangle's box and id in 32 bytes, and the vectors to work
// on it (the compilers' vector extension: AVX without its names). Private to core/accel.
//
// Upper faces are kept negated: so one minimum of eight floats extends a box.
//
// Centroids are used doubled, lo + hi, rounded once: only their order matters, and they are at most
// 2^41.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_ACCEL_BUILD_PRIMITIVE_H_
#define SIGHTLINE_CORE_ACCEL_BUILD_PRIMITIVE_H_

#include <array>
#include <cstdint>
#include <cstring>
#include <limits>

#include "core/geometry/box3.h"
#include "core/geometry/float4.h"
#include "core/mesh/scene_geometry.h"

namespace sightline::bvh_build {

using sightline::Max;
using sightline::Min;
using Float8 = float __attribute__((vector_size(32)));
using Int8 = int32_t __attribute__((vector_size(32)));

inline Float8 LoadFloat8(const void* p) {
  Float8 v;
  std::memcpy(&v, p, sizeof(v));
  return v;
}
inline Float8 Broadcast8(float x) { return Float8{x, x, x, x, x, x, x, x}; }
inline Int8 Broadcast8(int32_t x) { return Int8{x, x, x, x, x, x, x, x}; }
inline Float8 Min(Float8 a, Float8 b) { return a < b ? a : b; }
inline Float4 LowHalf(Float8 v) { return Float4{v[0], v[1], v[2], v[3]}; }
inline Float4 HighHalf(Float8 v) { return Float4{v[4], v[5], v[6], v[7]}; }

struct alignas(32) Primitive {
  Primitive() = default;
  // {lo, 0, -hi, id's bits}.
  explicit Primitive(Float8 lanes) { std::memcpy(this, &lanes, sizeof(*this)); }

  float lo[3];
  float zero;
  float minus_hi[3];
  uint32_t id;

  // The last lane holds the id's bits: it may be carried along and compared, but not calculated
  // with (as a denormal operand it would slow every multiplication down).
  Float8 box() const { return LoadFloat8(this); }
  float centroid(int axis) const { return lo[axis] - minus_hi[axis]; }
  // Doubled, in the first three lanes, and negated in lanes 4-6; the others are 0.
  Float8 centroid() const {
    const Float8 b = (Float8)((Int8)box() & Int8{-1, -1, -1, 0, -1, -1, -1, 0});
    return b - __builtin_shufflevector(b, b, 4, 5, 6, 7, 0, 1, 2, 3);
  }
};
static_assert(sizeof(Primitive) == 32);

inline Primitive MakePrimitive(const SceneGeometry& geometry, uint32_t id) {
  const std::array<uint32_t, 3>& corners = geometry.triangles[id];
  const Float4 a = LoadVertex(geometry.vertices[corners[0]]);
  const Float4 b = LoadVertex(geometry.vertices[corners[1]]);
  const Float4 c = LoadVertex(geometry.vertices[corners[2]]);
  const Float4 lo = Min(Min(a, b), c), minus_hi = -Max(Max(a, b), c);
  const Int4 last = (Int4)minus_hi & Int4{-1, -1, -1, 0};
  return Primitive(__builtin_shufflevector(
      lo, (Float4)(last | Int4{0, 0, 0, static_cast<int32_t>(id)}), 0, 1, 2, 3, 4, 5, 6, 7));
}

// A box as {lo, *, -hi, *}: lanes 3 and 7 mean nothing. Empty at first.
struct BuildBox {
  Float8 faces = Broadcast8(std::numeric_limits<float>::infinity());

  void Extend(Float8 other) { faces = Min(faces, other); }
  void Extend(const BuildBox& b) { Extend(b.faces); }
  void Extend(const Primitive& p) { Extend(p.box()); }
  float lo(int axis) const { return faces[axis]; }
  float hi(int axis) const { return -faces[axis + 4]; }
  float extent(int axis) const { return hi(axis) - lo(axis); }
  int widest_axis() const {
    int axis = 0;
    for (int i = 1; i < 3; ++i) axis = extent(i) > extent(axis) ? i : axis;
    return axis;
  }
  // Half the surface area of the box scaled by `scale` in each direction. REQUIRES: not empty.
  float HalfArea(float scale) const {
    // Extents, negated: their products are the same. Not the last lanes: what is in them may be a
    // denormal (an id's bits), for whose product some processors take 150 cycles.
    const Float4 sum = LowHalf(faces) + HighHalf(faces);
    const Float4 e = __builtin_shufflevector(sum, sum, 0, 1, 2, 2) * Broadcast(scale);
    const Float4 products = e * __builtin_shufflevector(e, e, 1, 2, 0, 3);
    return (products[0] + products[1]) + products[2];
  }
};

}  // namespace sightline::bvh_build

#endif  // SIGHTLINE_CORE_ACCEL_BUILD_PRIMITIVE_H_
