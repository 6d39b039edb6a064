// SPDX-License-Identifier: Apache-2.0
//
// Parts points in space, again and again, down to the blocks that share a shaft.
//
// Thread safety: pure functions.
//
//   PartedPoints parted;
//   PointParterFor(SimdTarget::kBest)(positions, valid, cancel, &parted);
#ifndef SIGHTLINE_CORE_QUERY_POINT_PARTER_H_
#define SIGHTLINE_CORE_QUERY_POINT_PARTER_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/base/aligned_vector.h"
#include "core/base/cancel.h"
#include "core/geometry/vec3.h"
#include "core/traverse/simd_target.h"

namespace sightline {

// What a walk puts to a triangle at once (core/traverse/shaft_rays-inl.h): no block is parted
// further.
inline constexpr size_t kSmallestPart = 16;

// How many of more points than that the first part takes.
constexpr size_t FirstPart(size_t count) {
  size_t first = kSmallestPart;
  while (2 * first < count) first *= 2;
  return first;
}

struct PartedPoints {
  AlignedVector<uint32_t> numbers;
  AlignedVector<Vec3f> positions;  // Of each of them.
  // By point, where it stands in `numbers`, and how many points there are where it does not: as
  // PointBits has them, a whole vector at the end. Or empty.
  AlignedVector<uint32_t> ranks;
};

// The valid ones of as many points as there are flags, parted across their widest axis, and each
// part again. The first part takes the largest power of two of smallest parts that leaves something
// over, so that every block of 16, 32, 64 and so on from the start is one part. Parts of 256 are
// parted further to within a 255th of how wide they are. O(n log n), whatever the points; where
// they stand depends on nothing but them.
// Once `cancel` (may be null) has fired it ends soon, and holds none.
// REQUIRES: valid ones are finite, and there are fewer than 2^31 points.
using PartPointsFn = void(std::span<const Vec3f> positions, std::span<const uint8_t> valid,
                          const CancelToken* cancel, PartedPoints* parted);

PartPointsFn* PointParterFor(SimdTarget target);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_POINT_PARTER_H_
