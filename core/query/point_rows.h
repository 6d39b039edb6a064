// SPDX-License-Identifier: Apache-2.0
//
// Points to rows of coordinates, as walks want them, and rows of results to bits.
//
// Thread safety: pure functions.
//
//   const PointRowKernels& kernels = PointRowKernelsFor(SimdTarget::kBest);
//   kernels.split(positions, x, y, z);
//   uint64_t lit = kernels.free_bits(ids);
#ifndef SIGHTLINE_CORE_QUERY_POINT_ROWS_H_
#define SIGHTLINE_CORE_QUERY_POINT_ROWS_H_

#include <cstdint>
#include <span>

#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"
#include "core/traverse/simd_target.h"

namespace sightline {

struct PointRowKernels {
  // x[i], y[i] and z[i] are the coordinates of points[i]. Rows are aligned to 64 bytes. Returns the
  // box around the points.
  Box3f (*split)(std::span<const Vec3f> points, float* x, float* y, float* z);
  // Bit i: ids[i] is kNoTriangle, of 64 ids. Aligned to 64 bytes.
  uint64_t (*free_bits)(const uint32_t* ids);
};

const PointRowKernels& PointRowKernelsFor(SimdTarget target);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_POINT_ROWS_H_
