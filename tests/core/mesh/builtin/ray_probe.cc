// SPDX-License-Identifier: Apache-2.0
#include "tests/core/mesh/builtin/ray_probe.h"

#include <algorithm>

namespace sightline {

RayProbe::RayProbe(const std::vector<ObjectInput>& objects) {
  for (const ObjectInput& object : objects) {
    for (size_t t = 0; t + 2 < object.indices.size(); t += 3) {
      triangles_.push_back({object.vertices[object.indices[t]],
                            object.vertices[object.indices[t + 1]],
                            object.vertices[object.indices[t + 2]]});
    }
  }
  nodes_.reserve(triangles_.size() / 2);
  Build(0, static_cast<uint32_t>(triangles_.size()));
}

void RayProbe::Build(uint32_t begin, uint32_t end) {
  const uint32_t index = static_cast<uint32_t>(nodes_.size());
  nodes_.emplace_back();
  Box3d box, centers;
  for (uint32_t i = begin; i < end; ++i) {
    const Triangle& t = triangles_[i];
    box.Extend(t.a);
    box.Extend(t.b);
    box.Extend(t.c);
    centers.Extend(t.a + t.b + t.c);
  }
  nodes_[index].box = box;
  constexpr uint32_t kLeaf = 4;
  if (end - begin <= kLeaf) {
    nodes_[index].first = begin;
    nodes_[index].count = end - begin;
    return;
  }
  const Vec3d e = centers.Extent();
  const int axis = e.x >= e.y && e.x >= e.z ? 0 : e.y >= e.z ? 1 : 2;
  const uint32_t middle = begin + (end - begin) / 2;
  std::nth_element(triangles_.begin() + begin, triangles_.begin() + middle,
                   triangles_.begin() + end, [axis](const Triangle& p, const Triangle& q) {
                     return p.a[axis] + p.b[axis] + p.c[axis] < q.a[axis] + q.b[axis] + q.c[axis];
                   });
  Build(begin, middle);
  nodes_[index].first = static_cast<uint32_t>(nodes_.size());
  Build(middle, end);
}

std::optional<RayProbe::Hit> RayProbe::Cast(Vec3d from, Vec3d direction, double limit) const {
  std::optional<Hit> best;
  double nearest = limit;
  std::vector<uint32_t> stack{0};
  while (!stack.empty()) {
    const uint32_t at = stack.back();
    stack.pop_back();
    const Node& node = nodes_[at];
    double enter = 0, leave = nearest;
    for (int axis = 0; axis < 3; ++axis) {
      const double t0 = (node.box.lo[axis] - from[axis]) / direction[axis];
      const double t1 = (node.box.hi[axis] - from[axis]) / direction[axis];
      // A direction along the axis gives NaN only on the slab's border: then nothing is excluded.
      enter = std::max(enter, std::min(t0, t1));
      leave = std::min(leave, std::max(t0, t1));
    }
    if (enter > leave) continue;
    if (node.count == 0) {
      stack.push_back(at + 1);
      stack.push_back(node.first);
      continue;
    }
    for (uint32_t i = node.first; i < node.first + node.count; ++i) {
      const Triangle& tri = triangles_[i];
      const Vec3d e1 = tri.b - tri.a, e2 = tri.c - tri.a, p = Cross(direction, e2);
      const double det = Dot(e1, p);
      if (det == 0) continue;
      const Vec3d s = from - tri.a, q = Cross(s, e1);
      const double u = Dot(s, p) / det, v = Dot(direction, q) / det, t = Dot(e2, q) / det;
      if (u < 0 || v < 0 || u + v > 1 || t <= 0 || t >= nearest) continue;
      nearest = t;
      const Vec3d normal = Cross(e1, e2);
      best = Hit{t, Dot(normal, direction) > 0 ? -normal : normal};
    }
  }
  return best;
}

}  // namespace sightline
