// SPDX-License-Identifier: Apache-2.0
//
// Four lanes of floats, ints or doubles, for code that goes through a mesh's vertices one by one:
// operators work lane by lane. Walks, which choose their width at run time, use Highway instead.
//
// Thread safety: functions only.
//
//   lo = Min(lo, LoadVertex(vertices[i]));
#ifndef SIGHTLINE_CORE_GEOMETRY_FLOAT4_H_
#define SIGHTLINE_CORE_GEOMETRY_FLOAT4_H_

#include <immintrin.h>

#include <cstdint>
#include <cstring>

#include "core/geometry/vec3.h"

namespace sightline {

using Float4 = float __attribute__((vector_size(16)));
using Int4 = int32_t __attribute__((vector_size(16)));
using Double4 = double __attribute__((vector_size(32)));
using Long4 = int64_t __attribute__((vector_size(32)));

inline Float4 Broadcast(float x) { return Float4{x, x, x, x}; }
// Where one is no number: b.
inline Float4 Min(Float4 a, Float4 b) { return a < b ? a : b; }
inline Float4 Max(Float4 a, Float4 b) { return a > b ? a : b; }
inline Double4 Max(Double4 a, Double4 b) { return a > b ? a : b; }
inline Double4 Abs(Double4 v) {
  return (Double4)((Long4)v & Long4{INT64_MAX, INT64_MAX, INT64_MAX, INT64_MAX});
}
inline Double4 ToDouble(Float4 v) { return __builtin_convertvector(v, Double4); }
inline Float4 ToFloat(Double4 v) { return __builtin_convertvector(v, Float4); }
// Of a comparison: whether it holds in all of the first three lanes, or in any of them.
inline bool AllOfThree(Long4 mask) { return (_mm256_movemask_pd((__m256d)mask) & 7) == 7; }
inline bool AnyOfThree(Long4 mask) { return (_mm256_movemask_pd((__m256d)mask) & 7) != 0; }

// The coordinates of a vertex and a zero.
inline Float4 LoadVertex(const Vec3f& v) {
  using Float2 = float __attribute__((vector_size(8)));
  Float2 xy;
  std::memcpy(&xy, &v, sizeof(xy));
  return __builtin_shufflevector(Float4{v.z, 0, 0, 0}, __builtin_shufflevector(xy, xy, 0, 1, 0, 1),
                                 4, 5, 0, 1);
}
inline Double4 LoadVertex(const Vec3d& v) { return Double4{v.x, v.y, v.z, 0}; }
inline void StoreVertex(Float4 from, Vec3f* to) { *to = {from[0], from[1], from[2]}; }

}  // namespace sightline

#endif  // SIGHTLINE_CORE_GEOMETRY_FLOAT4_H_
