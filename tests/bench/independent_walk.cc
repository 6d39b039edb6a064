// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/independent_walk.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/accel/bvh.h"
#include "core/geometry/box3.h"
#include "core/intersect/predicate.h"
#include "core/traverse/leaf_view.h"

namespace sightline::bench {
namespace {

// Whether the ray or segment may meet the box.
bool MayMeet(Vec3f box_lo, Vec3f box_hi, const PredicateRay& ray) {
  double enter = 0, leave = ray.segment ? 1 : std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    const double lo = box_lo[axis], hi = box_hi[axis];
    const double o = ray.origin[axis];
    const double d = ray.segment ? double{ray.target[axis]} - o : double{ray.target[axis]};
    if (d == 0) {  // Floats' difference is zero in doubles only if they are equal.
      if (o < lo || o > hi) return false;
      continue;
    }
    double near = (lo - o) / d, far = (hi - o) / d;
    if (near > far) std::swap(near, far);
    enter = std::max(enter, near - std::abs(near) * kSlabMargin);
    leave = std::min(leave, far + std::abs(far) * kSlabMargin);
  }
  return enter <= leave;
}

bool MayMeet(const BvhNode& node, uint32_t slot, const PredicateRay& ray) {
  return MayMeet({node.bounds[0][slot], node.bounds[1][slot], node.bounds[2][slot]},
                 {node.bounds[3][slot], node.bounds[4][slot], node.bounds[5][slot]}, ray);
}

bool MayMeet(Vec3f a, Vec3f b, Vec3f c, const PredicateRay& ray) {
  Box3f box;
  for (const Vec3f corner : {a, b, c}) box.Extend(corner);
  return MayMeet(box.lo, box.hi, ray);
}

bool Seen(const SceneGeometry& geometry, uint32_t id, const TraceRay& query) {
  const ObjectRecord& object = geometry.objects[geometry.ObjectOf(id)];
  if ((object.mask & query.mask) == 0) return false;
  if (object.culling == Culling::kNone) return true;
  const auto [a, b, c] = geometry.Corners(id);
  const bool front = SideOfPlane(a, b, c, query.ray.origin) > 0;
  return front == (object.culling == Culling::kBack);
}

}  // namespace

Hit WalkIndependently(const IndexedGeometry& scene, const TraceRay& query) {
  Hit best;
  if (scene.bvh.empty()) return best;
  std::vector<ChildRef> stack = {ChildRef::Inner(0)};
  while (!stack.empty()) {
    const ChildRef ref = stack.back();
    stack.pop_back();
    if (ref.is_inner()) {
      const BvhNode& node = scene.bvh.nodes[ref.node()];
      for (uint32_t slot = 0; slot < node.child_count; ++slot) {
        if (MayMeet(node, slot, query.ray)) stack.push_back(node.child[slot]);
      }
      continue;
    }
    const LeafView leaf(scene, ref);
    for (uint32_t lane = 0; lane < leaf.count; ++lane) {
      const uint32_t id = leaf.id(lane);
      if (id == query.from_source || id == query.to_source) continue;
      const auto [a, b, c] = scene.geometry.Corners(id);
      if (!MayMeet(a, b, c, query.ray)) continue;
      if (!Blocks(query.ray, a, b, c) || !Seen(scene.geometry, id, query)) continue;
      const Hit hit{HitDistance(query.ray, a, b, c), id};
      // Not `best = min`: a hit beyond the largest float has t = +inf and still blocks.
      if (best.triangle == kNoTriangle || hit < best) best = hit;
    }
  }
  return best;
}

}  // namespace sightline::bench
