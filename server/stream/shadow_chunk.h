// SPDX-License-Identifier: Apache-2.0
//
// A run of an item's points that one reply answers and several parts compute. Points that do not
// come as neighbours are ordered in space, once for the whole run, before they are parted:
// neighbours share their walks, and a part alone has too few of them to find any.
//
// Invariants: the parts are even and hold every valid point once; what a point is answered does not
// depend on the part it is in.
//
// Thread safety: RunPart may run for several parts at once, each part once. The first of them
// orders the points while the others wait: a millisecond at most for kMostPoints.
//
//   ShadowChunk chunk(points.positions.size(), ShadowChunk::PartPoints(part_rays, samples));
//   SL_ASSIGN_OR_RETURN(const bool last, chunk.RunPart(k, points, samples, outputs, compute,
//                                                      &result, &stats));
//   if (last) ...  // The result is that of all parts.
#ifndef SIGHTLINE_SERVER_STREAM_SHADOW_CHUNK_H_
#define SIGHTLINE_SERVER_STREAM_SHADOW_CHUNK_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/mutex.h"
#include "core/query/point_order.h"
#include "core/query/shadows.h"

namespace sightline {

class ShadowChunk {
 public:
  // Among so many points neighbours are near enough, and ordering more would keep others waiting.
  static constexpr uint64_t kMostPoints = PointOrders::kBlock;

  // The shadows of the points in some places of the chunk, all valid, in an order of neighbours.
  using Compute = std::function<absl::Status(std::span<const uint32_t> places, ShadowHints* hints,
                                             ShadowResult* result)>;

  // Of `count` points, `part_points` to a part. REQUIRES: both > 0; whole bytes of bits to a part.
  // With `orders`, which outlive it, the points are theirs from `begin` on.
  ShadowChunk(size_t count, size_t part_points, const PointOrders* orders = nullptr,
              size_t begin = 0);

  // How many points a part should have if so many rays are about right: a power of two, since that
  // is how the order parts them (core/query/point_order.h).
  static size_t PartPoints(uint64_t part_rays, uint64_t samples);

  size_t parts() const { return parts_; }
  // Whether this was the last one to be done; then `result` has the answers of all, in their order,
  // and belongs to the caller. `points` are the chunk's, the same ones for every part: where they
  // are, to be ordered by, and which are valid.
  absl::StatusOr<bool> RunPart(size_t part, const PointRange& points, size_t samples,
                               const ShadowOutputs& outputs, const Compute& compute,
                               ShadowResult* result, QueryStats* stats);

 private:
  // The places of the part's points, and what the parts before it left.
  std::vector<uint32_t> Begin(size_t part, const PointRange& points, ShadowHints* hints);

  const size_t count_, part_points_, parts_;
  const PointOrders* const orders_;  // May be null.
  const size_t begin_;               // Of the points in those.
  Mutex mutex_;
  bool ordered_ ABSL_GUARDED_BY(mutex_) = false, begun_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<uint32_t> order_ ABSL_GUARDED_BY(mutex_);  // Of the valid points.
  ShadowHints hints_ ABSL_GUARDED_BY(mutex_);
  size_t parts_left_ ABSL_GUARDED_BY(mutex_);
  ShadowResult all_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_SHADOW_CHUNK_H_
