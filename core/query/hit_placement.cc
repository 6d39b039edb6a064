// SPDX-License-Identifier: Apache-2.0
#include "core/query/hit_placement.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "core/base/check.h"
#include "core/query/id_lanes.h"

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
  FindTouching(scene, placement.at, placement.radius, triangle, &touched, kMaxTouched);
  return PlaceTouching(scene, placement, source.plane, touched).position;
}

// Short rows of pixels come one after another: a neighbour's source is among the last few.
int HitPlacer::SourceOf(const RayPacket& packet, uint32_t triangle) {
  const int sources = static_cast<int>(sources_.size());
  const int oldest = std::max(sources - kRecentSources, 0);
  for (int source = sources - 1; source >= oldest; --source) {
    if (sources_[static_cast<size_t>(source)].triangle == triangle) return source;
  }
  sources_.emplace_back(scene_, packet.origin, triangle);
  return sources;
}

void HitPlacer::CollectParts(const RayPacket& packet) {
  sources_.clear();
  part_count_ = 0;
  group_count_ = (packet.count + kGroupLanes - 1) / kGroupLanes;
  for (int g = 0; g < group_count_; ++g) {
    TouchPoints& points = groups_[g];
    points.per_vertex = kHitTouchPerVertex;
    const int begin = g * kGroupLanes, end = std::min(begin + kGroupLanes, packet.count);
    std::memcpy(points.source, packet.triangle + begin, sizeof(points.source));
    points.used = ~(WhereIs(kNoTriangle, points.source) |
                    WhereIs(kNoTriangle, points.source + PlacementKernels::kLanes)
                        << PlacementKernels::kLanes) &
                  ((1u << (end - begin)) - 1);
    for (int first = begin; first < end; first += PlacementKernels::kLanes) {
      constexpr uint32_t kMask = (1u << PlacementKernels::kLanes) - 1;
      for (uint32_t hits = points.used >> (first - begin) & kMask; hits != 0;) {
        const uint32_t triangle = packet.triangle[first + std::countr_zero(hits)];
        const Part part = {.source = SourceOf(packet, triangle),
                           .first = first,
                           .lanes = WhereIs(triangle, points.source + (first - begin)) & hits};
        hits &= ~part.lanes;
        for (uint32_t left = part.lanes; left != 0; left &= left - 1) {
          source_of_[first + std::countr_zero(left)] = part.source;
        }
        parts_[part_count_++] = part;
      }
    }
  }
}

void HitPlacer::FindTouchedAmongCandidates(int group, const Box3f& around) {
  const size_t before = touched_.size();
  candidates_.ForEachTouching(around, groups_[group], [&](int i, uint32_t id) {
    touched_.emplace_back(group * kGroupLanes + i, id);
  });
  std::sort(touched_.begin() + static_cast<ptrdiff_t>(before), touched_.end());
}

void HitPlacer::FindTouched() {
  touched_.clear();
  if (part_count_ == 0) return;
  TouchExtent all, extents[kMaxGroups];
  for (int g = 0; g < group_count_; ++g) {
    if (groups_[g].used == 0) continue;
    extents[g] = kernels_.extent(groups_[g]);
    all.Extend(extents[g]);
  }
  const bool together =
      candidates_.Gather(scene_, Around(all), all.norm_one, TouchCandidates::kMost);
  for (int g = 0; g < group_count_; ++g) {
    const TouchPoints& points = groups_[g];
    if (points.used == 0) continue;
    if (poll_.Stops(kGroupLanes)) return;
    const Box3f around = Around(extents[g]);
    if (together || candidates_.Gather(scene_, around, extents[g].norm_one, kMostOfGroup)) {
      FindTouchedAmongCandidates(g, around);
      continue;
    }
    for (uint32_t left = points.used; left != 0; left &= left - 1) {
      const int i = std::countr_zero(left);
      FindTouching(scene_, points.at(i), points.radius(i), points.source[i], &ids_, kMaxTouched,
                   &poll_);
      if (poll_.stopped()) return;
      for (const uint32_t id : ids_) touched_.emplace_back(g * kGroupLanes + i, id);
    }
  }
}

// And those that one try does not settle. The others touch nothing, and are clear.
void HitPlacer::PlaceTouchers(const RayPacket& packet, std::span<Vec3f> positions) {
  for (const auto& [lane, id] : touched_) left_[lane / kGroupLanes] |= 1u << lane % kGroupLanes;
  size_t next = 0;
  for (int g = 0; g < group_count_; ++g) {
    const TouchPoints& points = groups_[g];
    for (uint32_t left = left_[g]; left != 0; left &= left - 1) {
      if (poll_.stopped()) return;
      const int i = std::countr_zero(left), lane = g * kGroupLanes + i;
      ids_.clear();
      for (; next < touched_.size() && touched_[next].first == lane; ++next) {
        ids_.push_back(touched_[next].second);
      }
      const HitSource& source = sources_[static_cast<size_t>(source_of_[lane])];
      const Placement placement = {.at = points.at(i),
                                   .source = source.triangle,
                                   .side = source.plane.side,
                                   .radius = points.radius(i),
                                   .reference = packet.origin};
      const Placed placed = PlaceTouching(scene_, placement, source.plane, ids_, &poll_);
      positions[static_cast<size_t>(lane)] = placed.position;
      near_surface_[static_cast<size_t>(lane)] = !placed.clear;
    }
  }
}

bool HitPlacer::Place(const RayPacket& packet, std::span<Vec3f> positions) {
  SIGHTLINE_DCHECK(!packet.segments);
  CollectParts(packet);
  std::fill_n(left_, group_count_, 0u);
  near_surface_.reset();
  for (const Part& part : std::span(parts_, static_cast<size_t>(part_count_))) {
    const int g = part.first / kGroupLanes;
    const uint32_t settled =
        kernels_.place(sources_[static_cast<size_t>(part.source)], packet, part.first, part.lanes,
                       &groups_[g], &positions[static_cast<size_t>(part.first)]);
    left_[g] |= (part.lanes & ~settled) << part.first % kGroupLanes;
  }
  FindTouched();
  PlaceTouchers(packet, positions);
  return !poll_.stopped();
}

}  // namespace sightline
