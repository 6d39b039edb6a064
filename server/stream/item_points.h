// SPDX-License-Identifier: Apache-2.0
//
// The points of an item of ComputeShadows: a range of a stored set, or its own. Those of a set are
// ready to be lit. An item's own are rebased and checked when it is prepared, which is quick; where
// they touch, and what they attach to, is found out by each part for its points, since that takes
// as long as the rays do, and others wait.
//
// Invariant: a point is placed as it would be alone, so the parts do not show in any answer.
//
// Thread safety: Place for several parts at once, each point in one of them; near_surface after
// all; the rest is constant. The scene, the options and the pace outlive the object.
//
//   SL_ASSIGN_OR_RETURN(std::unique_ptr<ItemPoints> points,
//                       ItemPoints::Own(*scene, decoded, options, &pace, &cancel));
//   PreparedPoints placed;
//   SL_ASSIGN_OR_RETURN(const PointRange part, points->Place(offset, count, &cancel, &placed));
#ifndef SIGHTLINE_SERVER_STREAM_ITEM_POINTS_H_
#define SIGHTLINE_SERVER_STREAM_ITEM_POINTS_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/query/point_order.h"
#include "core/query/points.h"
#include "core/query/shadows.h"
#include "core/scene/scene.h"
#include "server/codec/query_codec.h"
#include "server/points/point_set_store.h"
#include "server/stream/placement_pace.h"

namespace sightline {

class ItemPoints {
 public:
  // REQUIRES: the range is within the set, and not empty.
  static std::unique_ptr<ItemPoints> OfSet(const std::shared_ptr<const PointSet>& set,
                                           size_t offset, size_t count);
  // InvalidArgument: as RebasePoints. Cancelled / DeadlineExceeded from `cancel`.
  static absl::StatusOr<std::unique_ptr<ItemPoints>> Own(const Scene& scene, DecodedPoints decoded,
                                                         const PointOptions& options,
                                                         PlacementPace* pace,
                                                         const CancelToken* cancel);

  size_t size() const { return count_; }
  // As they are before they are placed: valid is what it will be, and they are ordered by where
  // they are now.
  PointRange Range(size_t begin, size_t count) const;
  // Of the set, where its points from offset() on are the item's; null: none.
  const PointOrders* orders() const { return orders_; }
  size_t offset() const { return offset_; }
  // Whether parts have to be kept to PlacementPace::MostPoints.
  bool wants_placing() const { return options_ != nullptr && WantsPlacing(*options_); }

  // Points begin .. begin + count - 1, placed; `placed` is where they are kept if that moved them.
  absl::StatusOr<PointRange> Place(size_t begin, size_t count, const CancelToken* cancel,
                                   PreparedPoints* placed);
  // Those at begin + places[i].
  absl::StatusOr<PointRange> Place(size_t begin, std::span<const uint32_t> places,
                                   const CancelToken* cancel, PreparedPoints* placed);
  // Of an item's own that were placed: how many are within rounding of a triangle that is not
  // their source.
  uint64_t near_surface() const { return near_surface_; }

 private:
  ItemPoints() = default;
  absl::Status PlaceAll(std::span<const Vec3d> normals, const CancelToken* cancel,
                        PreparedPoints* points);

  std::shared_ptr<const PreparedPoints> points_;
  size_t offset_ = 0, count_ = 0;
  const PointOrders* orders_ = nullptr;  // Lives as long as points_.
  // Of an item's own alone.
  const Scene* scene_ = nullptr;
  const PointOptions* options_ = nullptr;
  PlacementPace* pace_ = nullptr;
  std::vector<Vec3d> normals_;  // For the sides of attached points; or empty.
  std::atomic<uint64_t> near_surface_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_ITEM_POINTS_H_
