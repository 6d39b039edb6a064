// SPDX-License-Identifier: Apache-2.0
//
// Which order to walk points in, so that blocks of them are neighbours and share a narrow shaft. A
// mesh's order winds along the surface; blocks cut from it are several times as wide as they need
// to be. So points are parted in space first, once for all their lights. ComputeShadows does so by
// itself; whoever hands it points bit by bit orders all of them before.
//
// Thread safety: functions, and a plain value.
#ifndef SIGHTLINE_CORE_QUERY_POINT_ORDER_H_
#define SIGHTLINE_CORE_QUERY_POINT_ORDER_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/geometry/vec3.h"
#include "core/query/point_parter.h"
#include "core/traverse/simd_target.h"

namespace sightline {

// Fewer points than this are a few blocks whatever their order: none pays.
inline constexpr size_t kLeastOrderedPoints = 1024;

// Whether an order of one's own pays: for many samples where blocks of neighbours in the given
// order are wider than they need to be, for few where they are far wider. Looks at a part of them.
// `ray_cost`: cycles that a ray took of late, in the order given; 0: not known.
bool OrderingPays(std::span<const Vec3f> positions, std::span<const uint8_t> valid, size_t samples,
                  float ray_cost = 0);

// An order of the points' own.
struct OwnOrder {
  PartedPoints points;
  float gain = 1;  // How many times as much rays would take without it, about.
};
// One that pays for so many samples, where the rays of a call are all it is for: parted in space
// for many of them (fewer than 2^31 points); for one or a few, whose rays take so many cycles, by
// layers of depth (depth_layers.h) where that is all that makes blocks wide. Once `cancel` fires it
// ends soon, and what it returns is of no use.
std::optional<OwnOrder> OrderThatPays(std::span<const Vec3f> positions,
                                      std::span<const uint8_t> valid, size_t samples,
                                      float ray_cost, SimdTarget simd = SimdTarget::kBest,
                                      const CancelToken* cancel = nullptr);

// The valid points, fewer than 2^31, ordered so that every 2^k from a multiple of 2^k on, k >= 4,
// were parted from the others by planes, or nearly so (point_parter.h): neighbours all. Coincident
// points and equal coordinates come in any order, always the same one. O(n log n), some 12 ns a
// point of a tile.
std::vector<uint32_t> SpatialOrder(std::span<const Vec3f> positions,
                                   std::span<const uint8_t> valid);
// The same, with the points in that order; none once `cancel` has fired.
PartedPoints InSpatialOrder(std::span<const Vec3f> positions, std::span<const uint8_t> valid,
                            SimdTarget simd = SimdTarget::kBest,
                            const CancelToken* cancel = nullptr);

// Orders for points that are going to be asked about again and again: of blocks that follow one
// another, each ordered by itself, so that any run of points finds its own.
class PointOrders {
 public:
  static constexpr size_t kBlock = 16 << 10;

  // None.
  PointOrders() = default;
  // REQUIRES: as many flags as positions. Runs in `pool`, some 30 ns a point; once `cancel` has
  // fired it ends soon, with none.
  PointOrders(std::span<const Vec3f> positions, std::span<const uint8_t> valid, ThreadPool& pool,
              const CancelToken* cancel = nullptr);
  // What they take at most, and while they are made by so many threads.
  static uint64_t BytesFor(uint64_t points, int threads);

  // Whether no block is the better for an order, even for many samples.
  bool empty() const { return begins_.empty(); }
  // The valid ones of points begin .. begin + count - 1, numbered from `begin`, as neighbours come.
  // Reads the blocks that they are in whole. REQUIRES: not empty, and there are so many points.
  std::vector<uint32_t> Of(size_t begin, size_t count) const;
  uint64_t MemoryBytes() const;

 private:
  std::vector<uint32_t> numbers_;  // Of valid points within their block, block by block.
  std::vector<size_t> begins_;     // Of the blocks in `numbers_`, and the end.
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_POINT_ORDER_H_
