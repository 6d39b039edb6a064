// SPDX-License-Identifier: Apache-2.0
//
// Points to rows of coordinates, as walks want them, and rows of results to bits.
//
// Thread safety: pure functions.
//
//   const PointRowKernels& kernels = PointRowKernelsFor(SimdTarget::kBest);
//   kernels.split(positions, x, y, z, &box);
//   kernels.free_bits(ids, lit_bits);
#ifndef SIGHTLINE_CORE_QUERY_POINT_ROWS_H_
#define SIGHTLINE_CORE_QUERY_POINT_ROWS_H_

#include <cstdint>
#include <span>

#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"
#include "core/traverse/simd_target.h"

namespace sightline {

struct PointRowKernels {
  // x[i], y[i] and z[i] are the coordinates of points[i], *box is around them. Rows are aligned to
  // 64 bytes.
  void (*split)(std::span<const Vec3f> points, float* x, float* y, float* z, Box3f* box);
  // The box alone. As many points to come are asked for from `coming` on, in step with those that
  // are read, if it is not null.
  void (*box)(std::span<const Vec3f> points, const Vec3f* coming, Box3f* box);
  // Bit i % 8 of bits[i / 8]: ids[i] is kNoTriangle; 0 past the last one, in (ids.size() + 7) / 8
  // bytes. Ids are aligned to 64 bytes, and read up to the end of the last 64.
  void (*free_bits)(std::span<const uint32_t> ids, uint8_t* bits);
  // bits[i / 16], bit i % 16: bit `bit` of flags[i]; 0 past the last one. Flags are aligned to 64
  // bytes; whole vectors of them are read. Returns how many are set.
  size_t (*flag_bits)(std::span<const uint16_t> flags, uint32_t bit, uint16_t* bits);
  // ids[i] = `id` where bit i % 16 of bits[i / 16] is set. Ids are aligned to 64 bytes; whole
  // vectors of them are written.
  void (*set_where)(std::span<const uint16_t> bits, uint32_t id, uint32_t* ids);
};

const PointRowKernels& PointRowKernelsFor(SimdTarget target);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_POINT_ROWS_H_
