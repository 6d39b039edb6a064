// SPDX-License-Identifier: Apache-2.0
//
// Every triangle whose own box meets a given box, eight boxes or sixteen triangles at a time. For
// small boxes: what a point may touch, what a short way may cross. Comparisons of stored floats
// round nothing.
//
// What is touched within a radius that grows with the triangle's corners is looked for with a
// TouchBox: every box that is met is widened by the radius of what lies in it. Widening the one
// that is looked for by the largest radius of all would let one stray triangle far out send all
// the others of a city to be measured.
//
// Walks the BVH, or a kd-tree that stands alone. There a triangle comes once for every leaf that
// names it, and none is lost: a point of both boxes lies in the closed cell of some leaf that names
// the triangle, and in that leaf's box (core/accel/kd_tree.h). With perfect splits a leaf knows of
// the triangle's own part in the cell alone; `reach` holds the whole boxes.
//
// One instruction set is enough here (AVX2, the floor): the walk is short, and its answer is a set.
//
// Thread safety: functions only.
//
//   ForEachMeeting(scene, box, [&](const LeafView& leaf, uint32_t lane) {
//     ids.push_back(leaf.id(lane));
//     return true;  // Go on.
//   });
#ifndef SIGHTLINE_CORE_QUERY_BOX_WALK_H_
#define SIGHTLINE_CORE_QUERY_BOX_WALK_H_

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "core/accel/indexed_geometry.h"
#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"
#include "core/traverse/leaf_range.h"
#include "core/traverse/leaf_view.h"
#include "hwy/highway.h"

namespace sightline {

// Around a point, for triangles within base + per_vertex · (the largest 1-norm of their corners) of
// it. REQUIRES: both were made larger by TouchBox::kRoundedUp, `base` by the least normal float
// besides: the sum of three floats, the product and the sum with them lose less than 2^-21 of it.
struct TouchBox {
  static constexpr double kRoundedUp = 0x1p-20;

  Box3f at;        // Around the point itself.
  Box3f farthest;  // What is not met by this is met by no triangle of the scene, however far out.
  float base = 0, per_vertex = 0;
};

namespace box_walk {

namespace hn = hwy::HWY_NAMESPACE;
using Eight = hn::CappedTag<float, 8>;
static_assert(hn::MaxLanes(Eight()) == 8, "x86-64-v3 holds eight floats in a vector");
using V = hn::Vec<Eight>;

inline uint32_t Bits(hn::Mask<Eight> mask) {
  uint8_t bytes[8] = {};
  hn::StoreMaskBits(Eight(), mask, bytes);
  return bytes[0];
}

// lo[k] <= box.hi[k] and hi[k] >= box.lo[k] on all axes.
inline hn::Mask<Eight> Meets(const V lo[3], const V hi[3], const Box3f& box) {
  const Eight d;
  auto meets = hn::And(hn::Le(lo[0], hn::Set(d, box.hi.x)), hn::Ge(hi[0], hn::Set(d, box.lo.x)));
  meets = hn::And(
      meets, hn::And(hn::Le(lo[1], hn::Set(d, box.hi.y)), hn::Ge(hi[1], hn::Set(d, box.lo.y))));
  return hn::And(meets,
                 hn::And(hn::Le(lo[2], hn::Set(d, box.hi.z)), hn::Ge(hi[2], hn::Set(d, box.lo.z))));
}

// The widened boxes, and with them the widths, which are rounded up as a whole (TouchBox). What
// meets in exact arithmetic does so here: the right sides are floats, and rounding the left ones to
// nearest never carries them past a float.
inline hn::Mask<Eight> Meets(const V lo[3], const V hi[3], const TouchBox& touch) {
  const Eight d;
  const auto farther = [&](int axis) { return hn::Max(hn::Abs(lo[axis]), hn::Abs(hi[axis])); };
  const V norm = hn::Add(hn::Add(farther(0), farther(1)), farther(2));
  const V width = hn::MulAdd(hn::Set(d, touch.per_vertex), norm, hn::Set(d, touch.base));
  V low[3], high[3];
  for (int axis = 0; axis < 3; ++axis) {
    low[axis] = hn::Sub(lo[axis], width);
    high[axis] = hn::Add(hi[axis], width);
  }
  return Meets(low, high, touch.at);
}

template <typename Region>
uint32_t MeetingChildren(const BvhNode& node, const Region& box) {
  const Eight d;
  const V lo[3] = {hn::Load(d, node.bounds[0]), hn::Load(d, node.bounds[1]),
                   hn::Load(d, node.bounds[2])};
  const V hi[3] = {hn::Load(d, node.bounds[3]), hn::Load(d, node.bounds[4]),
                   hn::Load(d, node.bounds[5])};
  return Bits(Meets(lo, hi, box)) & ((1u << node.child_count) - 1);
}

template <typename Region>
uint32_t MeetingTriangles(const LeafView& leaf, const Region& box) {
  const Eight d;
  uint32_t meeting = 0;
  for (uint32_t first = 0; first < leaf.count; first += 8) {
    V lo[3], hi[3];
    for (int axis = 0; axis < 3; ++axis) {
      const float* row = leaf.rows + axis * leaf.stride + first;
      const V a = hn::LoadU(d, row), b = hn::LoadU(d, row + 3 * leaf.stride),
              c = hn::LoadU(d, row + 6 * leaf.stride);
      lo[axis] = hn::Min(hn::Min(a, b), c);
      hi[axis] = hn::Max(hn::Max(a, b), c);
    }
    meeting |= Bits(Meets(lo, hi, box)) << first;
  }
  return meeting & ((1u << leaf.count) - 1);
}

inline bool Meets(const Box3f& a, const Box3f& b) {
  return a.lo.x <= b.hi.x && a.hi.x >= b.lo.x && a.lo.y <= b.hi.y && a.hi.y >= b.lo.y &&
         a.lo.z <= b.hi.z && a.hi.z >= b.lo.z;
}
inline bool Meets(const Box3f& a, const TouchBox& touch) {
  const auto farther = [&](int axis) {
    return std::max(std::abs(a.lo[axis]), std::abs(a.hi[axis]));
  };
  const float width = touch.per_vertex * (farther(0) + farther(1) + farther(2)) + touch.base;
  const Vec3f w = {width, width, width};
  return Meets(Box3f{a.lo - w, a.hi + w}, touch.at);
}

// What a cell or a leaf's box must meet where these say nothing of how far out their triangles
// reach.
inline const Box3f& FarthestOf(const Box3f& box) { return box; }
inline const Box3f& FarthestOf(const TouchBox& touch) { return touch.farthest; }

// Calls fn(leaf, lane) for the meeting triangles of a leaf; false: fn wants no more.
template <typename Region, typename Fn, typename Enters>
bool VisitLeaf(const LeafView& leaf, const Region& box, const Fn& fn, const Enters& enters) {
  if (!enters(leaf.count)) return false;
  for (uint32_t bits = MeetingTriangles(leaf, box); bits != 0; bits &= bits - 1) {
    if (!fn(leaf, static_cast<uint32_t>(std::countr_zero(bits)))) return false;
  }
  return true;
}

// ForEachMeeting by the kd-tree.
template <typename Region, typename Fn, typename Enters>
void WalkKdTree(const IndexedGeometry& scene, const Region& box, const Fn& fn,
                const Enters& enters) {
  const KdTree& tree = *scene.kd_tree;
  const Box3f& farthest = FarthestOf(box);
  const bool perfect = tree.perfect();
  uint32_t stack[kKdStackSize];  // Not initialized.
  uint32_t depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const uint32_t at = stack[--depth];
    const KdNode node = tree.nodes[at];
    if (node.is_empty_leaf() || (perfect && !Meets(tree.reach[at], box))) continue;
    if (!node.is_leaf()) {
      const uint32_t child = node.first_child();
      if (perfect || farthest.lo[node.axis()] <= node.split()) stack[depth++] = child;
      if (perfect || farthest.hi[node.axis()] >= node.split()) stack[depth++] = child + 1;
      continue;
    }
    const KdLeaf& leaf = tree.leaves[node.leaf()];
    if (!perfect && !Meets(leaf.box(), farthest)) continue;
    const LeafRange range = LeafRange::Of(scene, leaf);
    for (uint32_t first = 0; first < range.count; first += kMaxLeafTriangles) {
      if (!VisitLeaf(RangeView(scene.geometry, range, first).leaf, box, fn, enters)) return;
    }
  }
}

}  // namespace box_walk

// Calls fn(leaf, lane) for each triangle whose box meets `box`, a Box3f or a TouchBox, in no
// particular order, until fn returns false; on a kd-tree perhaps more than once for one triangle.
// enters(count) is called before so many triangles' boxes are compared, and ends all by false, too.
template <typename Region, typename Fn, typename Enters>
void ForEachMeeting(const IndexedGeometry& scene, const Region& box, const Fn& fn,
                    const Enters& enters) {
  if (scene.kd_tree_alone()) return box_walk::WalkKdTree(scene, box, fn, enters);
  if (scene.bvh.empty()) return;
  uint32_t stack[kBvhStackSize];  // ChildRef bits; not initialized.
  int depth = 0;
  stack[depth++] = ChildRef::Inner(0).bits();
  while (depth > 0) {
    const ChildRef ref = ChildRef::FromBits(stack[--depth]);
    if (ref.is_leaf()) {
      if (!box_walk::VisitLeaf(LeafView(scene, ref), box, fn, enters)) return;
      continue;
    }
    const BvhNode& node = scene.bvh.nodes[ref.node()];
    for (uint32_t bits = box_walk::MeetingChildren(node, box); bits != 0; bits &= bits - 1) {
      stack[depth++] = node.child[std::countr_zero(bits)].bits();
    }
  }
}
template <typename Fn>
void ForEachMeeting(const IndexedGeometry& scene, const Box3f& box, const Fn& fn) {
  ForEachMeeting(scene, box, fn, [](uint32_t) { return true; });
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_BOX_WALK_H_
