// SPDX-License-Identifier: Apache-2.0
#include "server/stream/item_points.h"

#include <algorithm>
#include <utility>

#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace sightline {

std::unique_ptr<ItemPoints> ItemPoints::OfSet(const std::shared_ptr<const PointSet>& set,
                                              size_t offset, size_t count) {
  SIGHTLINE_CHECK(count > 0 && offset + count <= set->points.size());
  std::unique_ptr<ItemPoints> points(new ItemPoints());
  points->points_ = std::shared_ptr<const PreparedPoints>(set, &set->points);
  points->offset_ = offset;
  points->count_ = count;
  if (!set->orders.empty()) points->orders_ = &set->orders;
  return points;
}

absl::StatusOr<std::unique_ptr<ItemPoints>> ItemPoints::Own(const Scene& scene,
                                                            DecodedPoints decoded,
                                                            const PointOptions& options,
                                                            PlacementPace* pace,
                                                            const CancelToken* cancel) {
  SL_ASSIGN_OR_RETURN(const std::vector<uint32_t> sources, decoded.Sources(scene.geometry));
  SL_ASSIGN_OR_RETURN(
      PreparedPoints rebased,
      RebasePoints(scene, {decoded.positions, decoded.normals, sources}, options, cancel));
  std::unique_ptr<ItemPoints> points(new ItemPoints());
  points->count_ = rebased.size();
  points->points_ = std::make_shared<const PreparedPoints>(std::move(rebased));
  points->scene_ = &scene;
  points->options_ = &options;
  points->pace_ = pace;
  if (options.attach_distance > 0) points->normals_ = std::move(decoded.normals);
  return points;
}

PointRange ItemPoints::Range(size_t begin, size_t count) const {
  return PointRange::Slice(*points_, offset_ + begin, count);
}

absl::StatusOr<PointRange> ItemPoints::Place(size_t begin, size_t count, const CancelToken* cancel,
                                             PreparedPoints* placed) {
  const PointRange range = Range(begin, count);
  if (!wants_placing()) return range;
  placed->positions.assign(range.positions.begin(), range.positions.end());
  placed->sources.assign(range.sources.begin(), range.sources.end());
  placed->valid.assign(range.valid.begin(), range.valid.end());
  const auto normals =
      std::span(normals_).subspan(normals_.empty() ? 0 : begin, normals_.empty() ? 0 : count);
  SL_RETURN_IF_ERROR(PlaceAll(normals, cancel, placed));
  return PointRange::All(*placed);
}

absl::StatusOr<PointRange> ItemPoints::Place(size_t begin, std::span<const uint32_t> places,
                                             const CancelToken* cancel, PreparedPoints* placed) {
  const PreparedPoints& all = *points_;
  const size_t n = places.size(), first = offset_ + begin;
  placed->positions.resize(n);
  placed->sources.resize(n);
  placed->valid.resize(n);
  std::vector<Vec3d> normals(normals_.empty() ? 0 : n);
  for (size_t i = 0; i < n; ++i) {
    placed->positions[i] = all.positions[first + places[i]];
    placed->sources[i] = all.sources[first + places[i]];
    placed->valid[i] = all.valid[first + places[i]];
  }
  for (size_t i = 0; i < normals.size(); ++i) normals[i] = normals_[first + places[i]];
  if (wants_placing()) SL_RETURN_IF_ERROR(PlaceAll(normals, cancel, placed));
  return PointRange::All(*placed);
}

absl::Status ItemPoints::PlaceAll(std::span<const Vec3d> normals, const CancelToken* cancel,
                                  PreparedPoints* points) {
  const std::chrono::nanoseconds start = Scheduler::ThreadCpuTime();
  SL_RETURN_IF_ERROR(PlacePoints(*scene_, normals, *options_, cancel, points));
  // Those that are placed: invalid ones cost nothing, and would say that the next may be many.
  pace_->Add(static_cast<uint64_t>(std::ranges::count(points->valid, 1)),
             Scheduler::ThreadCpuTime() - start);
  near_surface_ += points->near_surface;
  return absl::OkStatus();
}

}  // namespace sightline
