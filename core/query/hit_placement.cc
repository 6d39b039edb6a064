// SPDX-License-Identifier: Apache-2.0
#include "core/query/hit_placement.h"

#include <algorithm>
#include <array>

#include "core/base/check.h"

namespace sightline {
namespace {

// More candidates than this are not worth gathering for a group: each hit walks for itself.
constexpr uint32_t kMostOfGroup = 64;

// Sources among which a hit's is looked for before it gets one of its own.
constexpr int kRecentSources = 8;

}  // namespace

Vec3f PlaceHit(const IndexedGeometry& scene, Vec3f origin, Vec3f direction, float t,
               uint32_t triangle) {
  const HitSource source(scene, origin, triangle);
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

void HitPlacer::CollectSources(const RayPacket& packet) {
  hits_ = 0;
  sources_.clear();
  int hits_of[kMaxHits + 1];  // Of the source before; then where those of a source begin.
  hits_of[0] = 0;
  for (int lane = 0; lane < packet.count; ++lane) {
    const uint32_t triangle = packet.triangle[lane];
    if (triangle == kNoTriangle) continue;
    // Short rows of pixels come one after another: a neighbour's source is among the last few.
    const int sources = static_cast<int>(sources_.size());
    const int oldest = std::max(sources - kRecentSources, 0);
    int source = sources - 1;
    while (source >= oldest && sources_[source].triangle != triangle) --source;
    if (source < oldest) {
      source = sources;
      sources_.emplace_back(scene_, packet.origin, triangle);
      hits_of[source + 1] = 0;
    }
    lane_[hits_] = lane;
    source_of_[hits_++] = source;
    ++hits_of[source + 1];
  }
  for (size_t s = 0; s < sources_.size(); ++s) hits_of[s + 1] += hits_of[s];
  for (int hit = 0; hit < hits_; ++hit) by_source_[hits_of[source_of_[hit]]++] = hit;
}

// fn(source, hits) for all hits, up to four of one source at a time; fewer are filled up with the
// last.
template <typename Fn>
void HitPlacer::ForEachFour(const Fn& fn) const {
  for (int i = 0; i < hits_;) {
    const int source = source_of_[by_source_[i]];
    std::array<int, 4> hits;
    for (int& hit : hits) {
      if (i < hits_ && source_of_[by_source_[i]] == source) {
        hit = by_source_[i++];
      } else {
        hit = by_source_[i - 1];
      }
    }
    fn(sources_[source], hits);
  }
}

void HitPlacer::PlaceOnSources(const RayPacket& packet) {
  ForEachFour([&](const HitSource& source, const std::array<int, 4>& hits) {
    std::array<int, 4> lanes;
    std::array<Placement*, 4> placements;
    for (int i = 0; i < 4; ++i) {
      lanes[i] = lane_[hits[i]];
      placements[i] = &placements_[hits[i]];
    }
    source.PlacementsOf(packet, lanes, placements);
  });
}

void HitPlacer::MakeGroups() {
  group_count_ = 0;
  for (int hit = 0; hit < hits_;) {
    Group group{.begin = hit};
    const int lanes = lane_[hit] / kGroupLanes;
    for (; hit < hits_ && lane_[hit] / kGroupLanes == lanes; ++hit) group.Add(placements_[hit]);
    group.end = hit;
    groups_[group_count_++] = group;
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

void HitPlacer::PlaceBesideSources(std::span<Vec3f> positions) {
  ForEachFour([&](const HitSource& source, const std::array<int, 4>& hits) {
    std::array<const Placement*, 4> placements;
    for (int i = 0; i < 4; ++i) placements[i] = &placements_[hits[i]];
    std::array<Vec3f, 4> placed;
    const uint32_t settled = source.PlaceBeside(placements, &placed);
    for (int i = 0; i < 4; ++i) {
      positions[lane_[hits[i]]] = placed[i];
      settled_[hits[i]] = (settled >> i & 1) != 0;
    }
  });
}

// And those that one try does not settle.
void HitPlacer::PlaceTouchers(std::span<Vec3f> positions) {
  size_t next = 0;
  for (int hit = 0; hit < hits_; ++hit) {
    ids_.clear();
    for (; next < touched_.size() && touched_[next].first == hit; ++next) {
      ids_.push_back(touched_[next].second);
    }
    if (settled_[hit] && ids_.empty()) continue;
    positions[lane_[hit]] =
        PlaceTouching(scene_, placements_[hit], sources_[source_of_[hit]].plane, ids_).position;
  }
}

void HitPlacer::Place(const RayPacket& packet, std::span<Vec3f> positions) {
  SIGHTLINE_DCHECK(!packet.segments);
  CollectSources(packet);
  PlaceOnSources(packet);
  MakeGroups();
  FindTouched();
  PlaceBesideSources(positions);
  PlaceTouchers(positions);
}

}  // namespace sightline
