// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/independent_walk.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/geometry/box3.h"
#include "core/intersect/predicate.h"

namespace sightline::bench {
namespace {

constexpr size_t kLeafTriangles = 4;

// Whether the ray or segment may meet the box.
bool MayMeet(const Box3f& box, const PredicateRay& ray) {
  double enter = 0, leave = ray.segment ? 1 : std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    const double lo = box.lo[axis], hi = box.hi[axis];
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

Box3f BoxOf(const SceneGeometry& geometry, uint32_t id) {
  Box3f box;
  for (const Vec3f corner : geometry.Corners(id)) box.Extend(corner);
  return box;
}

bool Seen(const SceneGeometry& geometry, uint32_t id, const TraceRay& query) {
  if (id == query.from_source || id == query.to_source || query.unseen.Holds(id)) return false;
  const ObjectRecord& object = geometry.objects[geometry.ObjectOf(id)];
  if ((object.mask & query.mask) == 0) return false;
  if (object.culling == Culling::kNone) return true;
  const auto [a, b, c] = geometry.Corners(id);
  const bool front = SideOfPlane(a, b, c, query.ray.origin) > 0;
  return front == (object.culling == Culling::kBack);
}

}  // namespace

IndependentWalk::IndependentWalk(const SceneGeometry& geometry) {
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    if (!std::binary_search(geometry.inert.begin(), geometry.inert.end(), id)) ids_.push_back(id);
  }
  if (!ids_.empty()) Part(geometry, 0, ids_.size());
}

void IndependentWalk::Part(const SceneGeometry& geometry, size_t begin, size_t end) {
  Node node{.first = static_cast<uint32_t>(begin), .count = static_cast<uint32_t>(end - begin)};
  for (size_t i = begin; i < end; ++i) {
    const Box3f box = BoxOf(geometry, ids_[i]);
    node.box.Extend(box.lo);
    node.box.Extend(box.hi);
  }
  const size_t place = nodes_.size();
  nodes_.push_back(node);
  if (end - begin <= kLeafTriangles) return;
  const Vec3d extent = ToDouble(node.box.hi) - ToDouble(node.box.lo);
  int axis = extent.y > extent.x ? 1 : 0;
  if (extent.z > extent[axis]) axis = 2;
  const auto centre = [&](uint32_t id) {
    const Box3f box = BoxOf(geometry, id);
    return double{box.lo[axis]} + double{box.hi[axis]};
  };
  const size_t middle = begin + (end - begin) / 2;
  const auto at = [&](size_t i) { return ids_.begin() + static_cast<ptrdiff_t>(i); };
  std::nth_element(at(begin), at(middle), at(end),
                   [&](uint32_t a, uint32_t b) { return centre(a) < centre(b); });
  Part(geometry, begin, middle);
  nodes_[place].upper = static_cast<uint32_t>(nodes_.size());
  Part(geometry, middle, end);
}

Hit IndependentWalk::Closest(const SceneGeometry& geometry, const TraceRay& query) const {
  Hit best;
  if (nodes_.empty()) return best;
  std::vector<uint32_t> stack = {0};
  while (!stack.empty()) {
    const uint32_t number = stack.back();
    stack.pop_back();
    const Node& node = nodes_[number];
    if (!MayMeet(node.box, query.ray)) continue;
    if (node.upper != 0) {
      stack.push_back(number + 1);
      stack.push_back(node.upper);
      continue;
    }
    for (uint32_t i = node.first; i < node.first + node.count; ++i) {
      const uint32_t id = ids_[i];
      if (!MayMeet(BoxOf(geometry, id), query.ray)) continue;
      const auto [a, b, c] = geometry.Corners(id);
      if (!BlocksExactly(query.ray, a, b, c) || !Seen(geometry, id, query)) continue;
      const Hit hit{HitDistance(query.ray, a, b, c), id};
      if (!(hit.t > query.near)) continue;
      // Not `best = min`: a hit beyond the largest float has t = +inf and still blocks.
      if (best.triangle == kNoTriangle || hit < best) best = hit;
    }
  }
  return best;
}

}  // namespace sightline::bench
