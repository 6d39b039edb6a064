// SPDX-License-Identifier: Apache-2.0
#include "core/query/hit_placement.h"

#include <algorithm>
#include <cmath>

#include "core/base/check.h"
#include "core/intersect/predicate.h"

namespace sightline {
namespace {

// The most by which the exact parameter of a hit can differ from its float, relatively: one
// rounding (2^-24), the slab test's hold on it (2^-20, kSegmentEnd), and the distance's own error
// in doubles unless the ray grazes. A larger correction would say that doubles cannot tell where a
// grazing ray meets the plane; then t is as good.
constexpr double kParameterError = 0x1p-19;

// More candidates than this are not worth gathering for a group: each hit walks for itself.
constexpr uint32_t kMostOfGroup = 64;

}  // namespace

HitSource::HitSource(const IndexedGeometry& scene, Vec3f origin, uint32_t triangle)
    : triangle(triangle) {
  const auto corners = scene.geometry.Corners(triangle);
  const auto& [a, b, c] = corners;
  anchor = ToDouble(a);
  normal = Cross(ToDouble(b) - anchor, ToDouble(c) - anchor);
  closest = ClosestPoints(a, b, c);
  plane = MakePlane(corners, SideOfPlane(a, b, c, origin));
}

Placement HitSource::PlacementOf(Vec3f origin, Vec3f direction, float t) const {
  const Vec3d d = ToDouble(direction);
  // What rounding took from t, from the height left over the plane.
  Vec3d p = ToDouble(origin) + d * static_cast<double>(t);
  const double lost = Dot(normal, anchor - p) / Dot(normal, d);
  if (std::abs(lost) <= kParameterError * t) p = p + d * lost;
  const Vec3d at = closest.To(p);
  return {.at = at,
          .source = triangle,
          .side = plane.side,
          .radius = HitTouchRadius(NormOne(at), NormOne(d) * t),
          .reference = origin};
}

Vec3f PlaceHit(const IndexedGeometry& scene, Vec3f origin, Vec3f direction, float t,
               uint32_t triangle) {
  HitSource source(scene, origin, triangle);
  if (source.plane.side == 0) {  // Not a hit of ours; any answer will do.
    const auto& [a, b, c] = source.plane.corners;
    source.plane =
        MakePlane(source.plane.corners, SideOfDirection(a, b, c, direction) > 0 ? -1 : 1);
  }
  const Placement placement = source.PlacementOf(origin, direction, t);
  std::vector<uint32_t> touched;
  FindTouching(scene, placement.at, placement.radius, triangle, &touched);
  return PlaceTouching(scene, placement, source.plane, touched).position;
}

void HitPlacer::Group::Add(const Placement& placement) {
  box.Extend(placement.at);
  radius.base = std::max(radius.base, placement.radius.base);
  radius.per_vertex = placement.radius.per_vertex;
  norm_one = std::max(norm_one, NormOne(placement.at));
}

void HitPlacer::Group::Add(const Group& other) {
  box.Extend(other.box);
  radius.base = std::max(radius.base, other.radius.base);
  radius.per_vertex = other.radius.per_vertex;
  norm_one = std::max(norm_one, other.norm_one);
}

void HitPlacer::Collect(const RayPacket& packet) {
  hits_ = group_count_ = 0;
  int sources = 0;
  for (int first = 0; first < packet.count; first += kGroupLanes) {
    Group group{.begin = hits_, .end = hits_};
    const int end = std::min(first + kGroupLanes, packet.count);
    for (int lane = first; lane < end; ++lane) {
      const auto [t, triangle] = packet.hit(lane);
      if (triangle == kNoTriangle) continue;
      // Rows of pixels come one after another, so that of the last four one often is a neighbour.
      int source = sources - 1;
      while (source >= 0 && source >= sources - 4 && sources_[source].triangle != triangle)
        --source;
      if (source < 0 || source < sources - 4) {
        source = sources++;
        sources_[source] = HitSource(scene_, packet.origin, triangle);
        SIGHTLINE_DCHECK(sources_[source].plane.side != 0);
      }
      lane_[hits_] = lane;
      source_of_[hits_] = source;
      placements_[hits_] = sources_[source].PlacementOf(packet.origin, packet.target(lane), t);
      group.Add(placements_[hits_++]);
    }
    group.end = hits_;
    if (group.end > group.begin) groups_[group_count_++] = group;
  }
}

void HitPlacer::FindTouchedAmongCandidates(const Group& group, const Box3f& around) {
  const std::span points(placements_ + group.begin, placements_ + group.end);
  candidates_.ForEachTouching(around, points, [&](size_t i, uint32_t id) {
    touched_.emplace_back(group.begin + static_cast<int>(i), id);
  });
}

void HitPlacer::FindTouched() {
  touched_.clear();
  if (hits_ == 0) return;
  Group all{.begin = 0, .end = hits_};
  for (int g = 0; g < group_count_; ++g) all.Add(groups_[g]);
  const bool together =
      candidates_.Gather(scene_, all.Around(scene_), all.norm_one, TouchCandidates::kMost);
  for (int g = 0; g < group_count_; ++g) {
    const Group& group = groups_[g];
    const Box3f around = group.Around(scene_);
    if (together || candidates_.Gather(scene_, around, group.norm_one, kMostOfGroup)) {
      FindTouchedAmongCandidates(group, around);
      continue;
    }
    for (int hit = group.begin; hit < group.end; ++hit) {
      const Placement& placement = placements_[hit];
      FindTouching(scene_, placement.at, placement.radius, placement.source, &ids_);
      for (const uint32_t id : ids_) touched_.emplace_back(hit, id);
    }
  }
  std::sort(touched_.begin(), touched_.end());
}

void HitPlacer::Place(const RayPacket& packet, std::span<Vec3f> positions) {
  SIGHTLINE_DCHECK(!packet.segments);
  Collect(packet);
  FindTouched();
  size_t next = 0;
  for (int hit = 0; hit < hits_; ++hit) {
    ids_.clear();
    for (; next < touched_.size() && touched_[next].first == hit; ++next) {
      ids_.push_back(touched_[next].second);
    }
    positions[lane_[hit]] =
        PlaceTouching(scene_, placements_[hit], sources_[source_of_[hit]].plane, ids_).position;
  }
}

}  // namespace sightline
