// SPDX-License-Identifier: Apache-2.0
//
// Camera hits, placed (placement.h) on the eye's side of the triangles they lie on: one hit, or
// those of a packet together, to the same bits.
//
// Together is much faster: hits of neighbouring pixels lie close to each other, and one walk finds
// the few triangles that any of them can touch (touch_candidates.h). Where the box around a whole
// packet's hits holds too much, as at the edge of an object, its groups of sixteen lanes walk for
// themselves, and at last each hit does. What hits of one triangle share is computed once, and four
// of them are placed at a time (hit_source.h). With it a hit of a 1920×1080 view takes 67 to 92 ns
// (Sponza, the bunny, the hall of 1 M triangles), where each alone took 270 to 290.
//
// Thread safety: PlaceHit is a function only; a HitPlacer belongs to one thread.
//
//   HitPlacer placer(scene);
//   placer.Place(packet, positions);  // Traced: t and triangle are there.
#ifndef SIGHTLINE_CORE_QUERY_HIT_PLACEMENT_H_
#define SIGHTLINE_CORE_QUERY_HIT_PLACEMENT_H_

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "core/accel/indexed_geometry.h"
#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"
#include "core/query/hit_source.h"
#include "core/query/nearest_triangle.h"
#include "core/query/placement.h"
#include "core/query/touch_candidates.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

// A camera hit on `triangle` at O + t·D, placed on O's side of it. What t lost by rounding to a
// float is put back, and the point held within the triangle. Deterministic scalar double
// arithmetic. REQUIRES: the triangle blocks the ray.
Vec3f PlaceHit(const IndexedGeometry& scene, Vec3f origin, Vec3f direction, float t,
               uint32_t triangle);

class HitPlacer {
 public:
  explicit HitPlacer(const IndexedGeometry& scene) : scene_(scene) {}

  // positions[lane] = PlaceHit(scene, origin, target, t, triangle) for every lane that hit; the
  // others are left alone. REQUIRES: rays, not segments; positions.size() >= packet.count.
  void Place(const RayPacket& packet, std::span<Vec3f> positions);

 private:
  static constexpr int kMaxHits = RayPacket::kMaxRays;
  // Hits whose candidates are asked for together: the lanes of four by four pixels.
  static constexpr int kGroupLanes = 16;

  struct Group {
    int begin, end;  // Of the hits.
    Box3d box;       // Around their places.
    TouchRadius radius;
    double norm_one = 0;
    Box3f Around(const IndexedGeometry& scene) const {
      return BoxAround(box, radius.Largest(scene));
    }
    void Add(const Placement& placement);
    void Add(const Group& other);
  };

  void CollectSources(const RayPacket& packet);
  template <typename Fn>
  void ForEachFour(const Fn& fn) const;
  void PlaceOnSources(const RayPacket& packet);
  void MakeGroups();
  void FindTouched();
  void FindTouchedAmongCandidates(const Group& group, const Box3f& around);
  void PlaceBesideSources(std::span<Vec3f> positions);
  void PlaceTouchers(std::span<Vec3f> positions);

  const IndexedGeometry& scene_;
  // The packet's hits, in the order of their lanes.
  int hits_ = 0;
  int lane_[kMaxHits];
  Placement placements_[kMaxHits];
  std::vector<HitSource> sources_;
  int source_of_[kMaxHits];  // In sources_.
  int by_source_[kMaxHits];  // The hits, ordered by their source.
  int group_count_ = 0;
  Group groups_[kMaxHits / kGroupLanes];
  TouchCandidates candidates_;
  bool settled_[kMaxHits];  // Placed, unless it touches something.
  // What hits touch: (hit, triangle), ascending.
  std::vector<std::pair<int, uint32_t>> touched_;
  std::vector<uint32_t> ids_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_HIT_PLACEMENT_H_
