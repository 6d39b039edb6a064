// SPDX-License-Identifier: Apache-2.0
//
// Camera hits, placed (placement.h) on the eye's side of the triangles they lie on: one hit, or
// those of a packet together, to the same bits.
//
// Together is much faster: hits of neighbouring pixels lie close to each other, and one walk finds
// the few triangles that any of them can touch (touch_candidates.h). Where the box around a whole
// packet's hits holds too much, as at the edge of an object, its groups of sixteen lanes walk for
// themselves, and at last each hit does. What hits of one triangle share is computed once
// (hit_source.h), and eight of them are placed at a time (placement-inl.h). With it a hit of a
// 1920×1080 view takes 33 to 39 ns (the bunny, the hall), where each alone
// took 270 to 290.
//
// Thread safety: PlaceHit is a function only; a HitPlacer belongs to one thread.
//
//   HitPlacer placer(scene);
//   placer.Place(packet, positions);  // Traced: t and triangle are there.
#ifndef SIGHTLINE_CORE_QUERY_HIT_PLACEMENT_H_
#define SIGHTLINE_CORE_QUERY_HIT_PLACEMENT_H_

#include <bitset>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "core/accel/indexed_geometry.h"
#include "core/base/cancel.h"
#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"
#include "core/query/hit_source.h"
#include "core/query/nearest_triangle.h"
#include "core/query/placement.h"
#include "core/query/placement_kernels.h"
#include "core/query/point_poll.h"
#include "core/query/touch_candidates.h"
#include "core/query/touch_points.h"
#include "core/traverse/simd_target.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

// A camera hit on `triangle` at O + t·D, placed on O's side of it. What t lost by rounding to a
// float is put back, and the point held within the triangle. Deterministic scalar double
// arithmetic. REQUIRES: the triangle blocks the ray.
Vec3f PlaceHit(const IndexedGeometry& scene, Vec3f origin, Vec3f direction, float t,
               uint32_t triangle);

class HitPlacer {
 public:
  // `cancel` may be null.
  explicit HitPlacer(const IndexedGeometry& scene, SimdTarget simd = SimdTarget::kBest,
                     const CancelToken* cancel = nullptr)
      : scene_(scene), kernels_(PlacementKernelsFor(simd)), poll_(cancel), candidates_(kernels_) {}

  // positions[lane] = PlaceHit(scene, origin, target, t, triangle) for every lane that hit; the
  // others are left alone. False: `cancel` has fired, and there is no telling which are placed.
  // REQUIRES: rays, not segments; positions.size() >= packet.count.
  bool Place(const RayPacket& packet, std::span<Vec3f> positions);
  // By lane of that packet: whether the hit could not be placed strictly on the right side of all
  // that it touches (not Placed::clear).
  const std::bitset<RayPacket::kMaxRays>& near_surface() const { return near_surface_; }

 private:
  static constexpr int kGroupLanes = TouchPoints::kMost;
  static constexpr int kMaxGroups = RayPacket::kMaxRays / kGroupLanes;

  // Lanes that follow one another, as far as they hit one triangle.
  struct Part {
    int source;  // In sources_.
    int first;   // A multiple of PlacementKernels::kLanes.
    uint32_t lanes;
  };

  Box3f Around(const TouchExtent& extent) const {
    return BoxAround(extent.box, TouchRadius{extent.base, kHitTouchPerVertex}.Largest(scene_));
  }
  void CollectParts(const RayPacket& packet);
  int SourceOf(const RayPacket& packet, uint32_t triangle);
  void FindTouched();
  void FindTouchedAmongCandidates(int group, const Box3f& around);
  void PlaceTouchers(const RayPacket& packet, std::span<Vec3f> positions);

  const IndexedGeometry& scene_;
  const PlacementKernels& kernels_;
  PointPoll poll_;
  std::vector<HitSource> sources_;
  int part_count_ = 0;
  Part parts_[RayPacket::kMaxRays];
  // By sixteen lanes of the packet.
  int group_count_ = 0;
  TouchPoints groups_[kMaxGroups];
  uint32_t left_[kMaxGroups];  // Bits of lanes that the first try beside their source leaves open.
  int source_of_[RayPacket::kMaxRays];  // By lane; set for hits alone.
  TouchCandidates candidates_;
  // What hits touch: (lane, triangle), ascending.
  std::vector<std::pair<int, uint32_t>> touched_;
  std::vector<uint32_t> ids_;
  std::bitset<RayPacket::kMaxRays> near_surface_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_HIT_PLACEMENT_H_
