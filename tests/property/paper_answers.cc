// SPDX-License-Identifier: Apache-2.0
#include "tests/property/paper_answers.h"

#include <algorithm>
#include <cstdint>

#include "core/intersect/intersector_check.h"
#include "core/intersect/predicate.h"

namespace sightline::testing_support {
namespace {

// fn(id, object) for every triangle that may block the query, whatever its side.
template <typename Fn>
void ForEachAsked(const SceneGeometry& geometry, const TraceRay& query, const Fn& fn) {
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    const ObjectRecord& object = geometry.objects[geometry.ObjectOf(id)];
    if (id == query.from_source || id == query.to_source || query.unseen.Holds(id)) continue;
    if ((object.mask & query.mask) == 0) continue;
    if (std::binary_search(geometry.inert.begin(), geometry.inert.end(), id)) continue;
    fn(id, object);
  }
}

bool IsSeen(Culling culling, int side_of_origin) {
  return culling == Culling::kNone ||
         (culling == Culling::kBack ? side_of_origin > 0 : side_of_origin < 0);
}

}  // namespace

std::vector<QueryOptions> WaysBy(Intersector intersector, std::span<const Structure> structures) {
  std::vector<QueryOptions> ways;
  for (const Strategy strategy : {Strategy::kSingle, Strategy::kPacket}) {
    if (strategy == Strategy::kPacket && intersector == Intersector::kHavelHeroutDotProduct) {
      continue;  // For single rays.
    }
    for (const Structure structure : structures) {
      for (const bool culls : {false, true}) {
        QueryOptions options;
        options.strategy = strategy;
        options.structure = structure;
        options.intersector = intersector;
        if (culls) options.leaf_culling = LeafCulling();
        options.packet_side = culls ? 8 : 16;
        ways.push_back(options);
      }
    }
  }
  return ways;
}

bool LeavesEdgesOut(const QueryOptions& way) {
  return way.strategy == Strategy::kPacket && way.leaf_culling && way.leaf_culling->aperture &&
         way.leaf_culling->skip_edges;
}

Hit FirstHitBy(const SceneGeometry& geometry, Intersector kind, const TraceRay& query) {
  Hit best;
  ForEachAsked(geometry, query, [&](uint32_t id, const ObjectRecord& object) {
    const auto [a, b, c] = geometry.Corners(id);
    IntersectorHit at;
    if (!IntersectRay(kind, query.ray, a, b, c, &at) || !(at.t > query.near)) return;
    if (!IsSeen(object.culling, SideOfPlane(a, b, c, query.ray.origin))) return;
    best = std::min(best, Hit{at.t, id});
  });
  return best;
}

bool MayDifferByAnyHit(const SceneGeometry& geometry, Intersector kind, const TraceRay& query,
                       bool blocked, bool edges_left_out) {
  if (blocked && !edges_left_out) return false;
  bool certain = false, denied_in_doubt = false;
  ForEachAsked(geometry, query, [&](uint32_t id, const ObjectRecord& object) {
    const auto [a, b, c] = geometry.Corners(id);
    const IntersectorCheck check = CheckIntersector(kind, query.ray, a, b, c);
    // Beyond doubt: no walk may miss them all. Which side is seen may be in doubt for itself.
    certain |= check.hit && check.certain && object.culling == Culling::kNone;
    denied_in_doubt |= !check.hit && !check.certain;
  });
  return blocked ? denied_in_doubt : !certain;
}

}  // namespace sightline::testing_support
