// SPDX-License-Identifier: Apache-2.0
//
// The walks over either BVH, and over the kd-tree seen as a tree of boxes, that cull within leaves
// (leaf_culling.h): single rays with ray-box culling, packets with vertex culling and paper 004's
// node tests. And brute force by one of the papers' tests, which they are compared with.
//
// A kd-tree's cell is walked as the box that it is: its interval along a ray is made of the same
// products as a box's (core/accel/kd_tree.h), so what that header promises to walks holds here. It
// costs six products a node instead of one; kd_single-inl.h and kd_packet-inl.h go the usual way,
// without culling in their leaves. With perfect splits a cell's entry bounds no distance, but that
// of the whole boxes of its triangles does (`reach`): closest hits are cut off by it, for six
// products a node more.
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_CULLED_WALKS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_CULLED_WALKS_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_CULLED_WALKS_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_CULLED_WALKS_INL_H_
#endif

#include <algorithm>
#include <cstddef>
#include <limits>
#include <memory>
#include <span>

#include "core/accel/binary_bvh.h"
#include "core/accel/bvh.h"
#include "core/accel/kd_tree.h"
#include "core/base/cancel.h"
#include "core/intersect/hit.h"
#include "core/traverse/finish-inl.h"
#include "core/traverse/packet_leaf-inl.h"
#include "core/traverse/ray_box_leaf-inl.h"
#include "core/traverse/single-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// ---- The trees, as boxes with a few children. The root is node 0.

struct TreeChild {
  uint32_t node;
  Box3f box;
};

class BinaryBvhView {
 public:
  BinaryBvhView(const IndexedGeometry& scene, const LeafCulling&) : bvh_(*scene.binary_bvh) {}
  bool empty() const { return bvh_.empty(); }
  Box3f root_box() const { return bvh_.nodes[0].box(); }
  bool is_leaf(uint32_t node) const { return bvh_.nodes[node].is_leaf(); }
  // Box of a leaf's contents; false: it has none.
  bool LeafOf(uint32_t node, const Box3f& box, LeafRange* range, Box3f* leaf_box) const {
    const BinaryBvhNode& n = bvh_.nodes[node];
    *range = {{bvh_.ids.data(), bvh_.ids.size()}, &bvh_.leaves, n.first, n.count};
    *leaf_box = box;
    return true;
  }
  // Writes them to `out`, kWidth at most; returns how many there are.
  uint32_t Children(uint32_t node, const Box3f&, TreeChild* out) const {
    const uint32_t first = bvh_.nodes[node].first;
    out[0] = {first, bvh_.nodes[first].box()};
    out[1] = {first + 1, bvh_.nodes[first + 1].box()};
    return 2;
  }
  // Whether a box entered after the nearest hit may be left out; if not, the one whose entry tells.
  bool boxes_bound_hits() const { return true; }
  const Box3f* bounding_box(uint32_t) const { return nullptr; }
  static constexpr uint32_t kWidth = 2;
  static constexpr uint32_t kStack = kMaxBinaryBvhDepth + 1;

 private:
  const BinaryBvh& bvh_;
};

// Nodes are numbered by the bits of their ChildRef.
class BvhView {
 public:
  BvhView(const IndexedGeometry& scene, const LeafCulling&) : bvh_(scene.bvh) {
    static_assert(ChildRef::Inner(0).bits() == 0);
  }
  bool empty() const { return bvh_.empty(); }
  Box3f root_box() const { return bvh_.bounds; }
  bool is_leaf(uint32_t node) const { return ChildRef::FromBits(node).is_leaf(); }
  bool LeafOf(uint32_t node, const Box3f& box, LeafRange* range, Box3f* leaf_box) const {
    const ChildRef ref = ChildRef::FromBits(node);
    *range = {{bvh_.leaf_ids.data(), bvh_.leaf_ids.size()},
              nullptr,
              ref.leaf_unit() * kUnitTriangles,
              ref.leaf_count()};
    if (bvh_.has_leaf_rows()) {
      range->rows = bvh_.leaves.data() + size_t{ref.leaf_unit()} * kUnitFloats;
      range->stride = ref.leaf_units() * kUnitTriangles;
    }
    *leaf_box = box;
    return true;
  }
  uint32_t Children(uint32_t node, const Box3f&, TreeChild* out) const {
    const BvhNode& n = bvh_.nodes[ChildRef::FromBits(node).node()];
    for (uint32_t i = 0; i < n.child_count; ++i) {
      out[i] = {n.child[i].bits(),
                {{n.bounds[0][i], n.bounds[1][i], n.bounds[2][i]},
                 {n.bounds[3][i], n.bounds[4][i], n.bounds[5][i]}}};
    }
    return n.child_count;
  }
  bool boxes_bound_hits() const { return true; }
  const Box3f* bounding_box(uint32_t) const { return nullptr; }
  static constexpr uint32_t kWidth = kBvhWidth;
  static constexpr uint32_t kStack = kBvhStackSize;

 private:
  const Bvh& bvh_;
};

class KdTreeView {
 public:
  KdTreeView(const IndexedGeometry& scene, const LeafCulling& culling)
      : tree_(*scene.kd_tree),
        triangles_(scene.kd_leaves ? &*scene.kd_leaves : nullptr),
        cell_boxes_(culling.cell_boxes) {}
  bool empty() const { return tree_.empty(); }
  Box3f root_box() const { return tree_.bounds; }
  bool is_leaf(uint32_t node) const { return tree_.nodes[node].is_leaf(); }
  bool LeafOf(uint32_t node, const Box3f& cell, LeafRange* range, Box3f* leaf_box) const {
    if (tree_.nodes[node].is_empty_leaf()) return false;
    const KdLeaf& leaf = tree_.leaves[tree_.nodes[node].leaf()];
    *range = {{tree_.ids.data(), tree_.ids.size()}, triangles_, leaf.first, leaf.count};
    *leaf_box = cell_boxes_ ? cell : leaf.box();
    return true;
  }
  uint32_t Children(uint32_t node, const Box3f& box, TreeChild* out) const {
    const KdNode n = tree_.nodes[node];
    out[0] = {n.first_child(), box};
    out[1] = {n.first_child() + 1, box};
    out[0].box.hi[n.axis()] = n.split();
    out[1].box.lo[n.axis()] = n.split();
    return 2;
  }
  bool boxes_bound_hits() const { return !tree_.perfect(); }
  const Box3f* bounding_box(uint32_t node) const {
    return tree_.perfect() ? &tree_.reach[node] : nullptr;
  }
  static constexpr uint32_t kWidth = 2;
  static constexpr uint32_t kStack = kKdStackSize;

 private:
  const KdTree& tree_;
  const LeafTriangles* const triangles_;
  const bool cell_boxes_;
};

// Onto the stack, above `base` the nearest last; of equal ones the first that came.
template <class Pending>
HWY_INLINE void PushByEntry(const Pending& child, int base, Pending* stack, int* depth) {
  int to = (*depth)++;
  for (; to > base && stack[to - 1].entry <= child.entry; --to) stack[to] = stack[to - 1];
  stack[to] = child;
}

// ---- One ray

template <class Tree, bool kAny>
class CulledSingleWalk {
 public:
  CulledSingleWalk(const IndexedGeometry& scene, const LeafCulling& culling, const TraceRay& query,
                   WalkStats* stats, RayPoll* poll)
      : tree_(scene, culling),
        stats_(stats),
        poll_(poll),
        leaf_(scene, culling, query, stats, poll),
        limit_(query.ray.segment ? kSegmentEnd : std::numeric_limits<float>::infinity()) {}

  // Left off, and of no use, where the poll has fired.
  Hit Run() {
    if (tree_.empty()) return best_;
    // Not initialized: a box's default is not nothing.
    alignas(Pending) std::byte room[(Tree::kStack + 1) * sizeof(Pending)];
    Pending* const stack = reinterpret_cast<Pending*>(room);
    int depth = 0;
    Push({0, tree_.root_box(), 0}, stack, &depth);
    while (depth > 0) {
      if (poll_->Stops()) break;
      const Pending at = stack[--depth];
      if (IsBehind(at)) continue;
      if (tree_.is_leaf(at.node)) {
        if (VisitLeaf(at)) break;
        continue;
      }
      ++stats_->nodes;
      TreeChild children[Tree::kWidth];
      const uint32_t count = tree_.Children(at.node, at.box, children);
      const int base = depth;
      for (uint32_t i = 0; i < count; ++i) {
        Pending child = {children[i].node, children[i].box, 0};
        if (Meets(&child)) PushByEntry(child, base, stack, &depth);
      }
    }
    return best_;
  }

 private:
  struct Pending {
    uint32_t node;
    Box3f box;
    float entry;
  };

  bool Bounds() const { return kAny || tree_.boxes_bound_hits(); }

  // Whether nothing in the box can be closer than what was found.
  bool IsBehind(const Pending& at) const {
    if (Bounds()) return at.entry > limit_;
    return BoxEntry(leaf_.box_ray(), *tree_.bounding_box(at.node)) > limit_;
  }
  bool Meets(Pending* at) const {
    at->entry = BoxEntry(leaf_.box_ray(), at->box);
    const float exit = BoxExit(leaf_.box_ray(), at->box) * kBoxExitScale + kBoxExitShift;
    return at->entry <= exit && 0 <= exit && !IsBehind(*at);
  }
  void Push(Pending at, Pending* stack, int* depth) const {
    if (Meets(&at)) stack[(*depth)++] = at;
  }

  bool VisitLeaf(const Pending& at) {
    LeafRange range;
    Box3f box;
    if (!tree_.LeafOf(at.node, at.box, &range, &box)) return false;
    const float entry = BoxEntry(leaf_.box_ray(), box);
    const float exit = BoxExit(leaf_.box_ray(), box);
    const float end = exit * kBoxExitScale + kBoxExitShift;
    if (!(entry <= end && 0 <= end) || (Bounds() && entry > limit_)) return false;
    ++stats_->leaves;
    return leaf_.Visit(range, entry, end, &best_, &limit_);
  }

  const Tree tree_;
  WalkStats* const stats_;
  RayPoll* const poll_;
  RayBoxLeaf<kAny> leaf_;
  float limit_;
  Hit best_;
};

template <bool kAny>
bool TraceCulledSingle(const IndexedGeometry& scene, const LeafCulling& culling,
                       std::span<const TraceRay> rays, std::span<Hit> hits,
                       const CancelToken* cancel, WalkStats* stats) {
  RayPoll poll(cancel);
  for (size_t i = 0; i < rays.size(); ++i) {
    if (i % kPollInterval == 0 && cancel != nullptr && cancel->cancelled()) return false;
    switch (culling.tree) {
      case CulledTree::kBinaryBvh:
        hits[i] =
            CulledSingleWalk<BinaryBvhView, kAny>(scene, culling, rays[i], stats, &poll).Run();
        break;
      case CulledTree::kKdTree:
        hits[i] = CulledSingleWalk<KdTreeView, kAny>(scene, culling, rays[i], stats, &poll).Run();
        break;
      case CulledTree::kBvh:
        hits[i] = CulledSingleWalk<BvhView, kAny>(scene, culling, rays[i], stats, &poll).Run();
        break;
    }
    if (poll.stopped()) return false;
  }
  return true;
}

// One of the papers' tests over every triangle: what the walks with it are compared with. Returns
// false if `cancel` fired.
template <bool kAny>
bool BruteByIntersector(const IndexedGeometry& scene, const LeafCulling& culling,
                        const TraceRay& query, const CancelToken* cancel, Hit* hit_or_miss,
                        WalkStats* stats) {
  const SceneGeometry& geometry = scene.geometry;
  Hit& best = *hit_or_miss = Hit{};
  auto inert = geometry.inert.begin();
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    if (id % kBrutePollInterval == 0 && cancel != nullptr && cancel->cancelled()) return false;
    if (inert != geometry.inert.end() && *inert == id) {
      ++inert;
      continue;
    }
    if (id == query.from_source || id == query.to_source || query.unseen.Holds(id)) continue;
    ++stats->triangle_tests;
    const auto [a, b, c] = geometry.Corners(id);
    IntersectorHit hit;
    if (!IntersectRay(culling.intersector, query.ray, a, b, c, &hit)) continue;
    if (MustAskObjects(geometry, query.mask) &&
        !ObjectBlocks(geometry, id, query.mask, SideOfPlane(a, b, c, query.ray.origin))) {
      continue;
    }
    if constexpr (kAny) {
      best = {0.0f, id};
      return true;
    }
    if (hit.t > query.near) best = std::min(best, Hit{hit.t, id});
  }
  return true;
}

template <bool kAny>
bool TraceBruteByIntersector(const IndexedGeometry& scene, const LeafCulling& culling,
                             std::span<const TraceRay> rays, std::span<Hit> hits,
                             const CancelToken* cancel, WalkStats* stats) {
  for (size_t i = 0; i < rays.size(); ++i) {
    if (!BruteByIntersector<kAny>(scene, culling, rays[i], cancel, &hits[i], stats)) return false;
  }
  return true;
}

// ---- Packets

template <class Tree, bool kAny>
class CulledPacketWalk {
 public:
  CulledPacketWalk(const IndexedGeometry& scene, const LeafCulling& culling, RayPacket& packet,
                   const CancelToken* cancel, WalkStats* stats)
      : tree_(scene, culling),
        culling_(culling),
        stats_(stats),
        poll_(cancel),
        lanes_(scene, packet, stats),
        leaf_(scene, culling, lanes_, stats, &poll_) {}

  bool has_frustum() const { return leaf_.slopes().valid(); }

  // Returns false if `cancel` fired.
  bool Run() {
    if (tree_.empty()) return true;
    // Not initialized: a box's default is not nothing.
    alignas(Pending) std::byte room[(Tree::kStack + 1) * sizeof(Pending)];
    Pending* const stack = reinterpret_cast<Pending*>(room);
    int depth = 0;
    Pending root = {0, 0, tree_.root_box(), 0};
    if (Meets(0, &root)) stack[depth++] = root;
    while (depth > 0) {
      if (poll_.Stops()) return false;
      const Pending at = stack[--depth];
      if (tree_.is_leaf(at.node)) {
        const bool all_done = VisitLeaf(at);
        if (poll_.stopped()) return false;
        if (all_done) return true;
        continue;
      }
      ++stats_->nodes;
      TreeChild children[Tree::kWidth];
      const uint32_t count = tree_.Children(at.node, at.box, children);
      const int base = depth;
      for (uint32_t i = 0; i < count; ++i) {
        Pending child = {children[i].node, 0, children[i].box, 0};
        if (Meets(at.first_group, &child)) PushByEntry(child, base, stack, &depth);
      }
    }
    return true;
  }

 private:
  using D = hn::CappedTag<float, 16>;
  using V = hn::Vec<D>;

  struct Pending {
    uint32_t node;
    uint32_t first_group;  // No lane of a group before it meets the box.
    Box3f box;
    float entry;  // Of the first group that meets it: an order, and no bound for the others.
  };

  bool Bounds() const { return kAny || tree_.boxes_bound_hits(); }

  // The lanes of a group that may hit something in the node's box, given relative to the origin.
  HWY_INLINE uint32_t LanesMeet(uint32_t node, uint32_t group, const Vec3f& lo, const Vec3f& hi,
                                V* entry) const {
    auto met = lanes_.LanesMeet(group, lo, hi, entry);
    if (Bounds()) {
      met = hn::And(met, lanes_.WithinLimits(group, *entry));
    } else if (!hn::AllFalse(D(), met)) {
      const Box3f& whole = *tree_.bounding_box(node);
      V first;
      lanes_.LanesMeet(group, whole.lo - lanes_.origin(), whole.hi - lanes_.origin(), &first);
      met = hn::And(met, lanes_.WithinLimits(group, first));
    }
    return MaskBits(D(), met) & lanes_.active(group);
  }

  // Whether some lane meets the child's box; finds the first group that does.
  bool Meets(uint32_t parent_first, Pending* at) const {
    const D d;
    const Vec3f lo = at->box.lo - lanes_.origin(), hi = at->box.hi - lanes_.origin();
    const uint32_t first = culling_.node_test == NodeTest::kAllRays ? 0 : parent_first;
    bool asked_corners = culling_.node_test != NodeTest::kCorners || !has_frustum();
    for (uint32_t g = first; g < lanes_.groups(); ++g) {
      if (lanes_.active(g) != 0) {
        V entry;
        ++stats_->box_tests;
        const uint32_t met = LanesMeet(at->node, g, lo, hi, &entry);
        if (met != 0) {
          at->first_group = g;
          const auto some = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(&met));
          const V far = hn::Set(d, std::numeric_limits<float>::infinity());
          at->entry = hn::GetLane(hn::MinOfLanes(d, hn::IfThenElse(some, entry, far)));
          return true;
        }
      }
      if (asked_corners) continue;
      asked_corners = true;
      const float lo3[3] = {lo.x, lo.y, lo.z}, hi3[3] = {hi.x, hi.y, hi.z};
      if (leaf_.slopes().MissesBox(lo3, hi3)) return false;
    }
    return false;
  }

  // Returns true when no lane is left to answer.
  bool VisitLeaf(const Pending& at) {
    LeafRange range;
    Box3f box;
    if (!tree_.LeafOf(at.node, at.box, &range, &box)) return false;
    const Vec3f lo = box.lo - lanes_.origin(), hi = box.hi - lanes_.origin();
    uint32_t met[RayPacket::kMaxRays / 8], some = 0;
    for (uint32_t g = at.first_group; g < lanes_.groups(); ++g) {
      V entry;
      met[g] = lanes_.active(g) == 0 ? 0 : LanesMeet(at.node, g, lo, hi, &entry);
      some |= met[g];
    }
    if (some == 0) return false;
    ++stats_->leaves;
    leaf_.Visit(range, met, at.first_group);
    return kAny && lanes_.live() == 0;
  }

  const Tree tree_;
  const LeafCulling& culling_;
  WalkStats* const stats_;
  PacketPoll poll_;
  PacketLanes<kAny> lanes_;
  PacketLeaf<kAny> leaf_;
};

template <class Tree, bool kAny>
bool TraceCulledTree(const IndexedGeometry& scene, const LeafCulling& culling, RayPacket& packet,
                     const CancelToken* cancel, WalkStats* stats) {
  // Packets of fewer rays than this are better off alone.
  constexpr int kLeastSplit = 4;
  {
    CulledPacketWalk<Tree, kAny> walk(scene, culling, packet, cancel, stats);
    if (walk.has_frustum()) return walk.Run();
  }
  if (culling.split == PacketSplit::kSingleRays || packet.count <= kLeastSplit) {
    RayPoll poll(cancel);
    for (int i = 0; i < packet.count; ++i) {
      if (cancel != nullptr && cancel->cancelled()) return false;
      const TraceRay ray = packet.trace_ray(i);
      const Hit hit = CulledSingleWalk<Tree, kAny>(scene, culling, ray, stats, &poll).Run();
      if (poll.stopped()) return false;
      packet.triangle[i] = hit.triangle;
      if constexpr (!kAny) packet.t[i] = hit.t;
    }
    if (packet.answered_by != nullptr) {
      std::fill_n(packet.answered_by, packet.count, AnsweredBy::kRay);
    }
    return true;
  }
  const auto part = std::make_unique<RayPacket>();
  for (int first = 0; first < packet.count;) {
    const int half = packet.count / 2;
    const int count = first == 0 ? half : packet.count - half;
    packet.CopyLanes(first, count, part.get());
    if (!TraceCulledTree<Tree, kAny>(scene, culling, *part, cancel, stats)) return false;
    std::copy_n(part->t, count, packet.t + first);
    std::copy_n(part->triangle, count, packet.triangle + first);
    first += count;
  }
  return true;
}

template <bool kAny>
bool TraceCulledPacket(const IndexedGeometry& scene, const LeafCulling& culling, RayPacket& packet,
                       const CancelToken* cancel, WalkStats* stats) {
  if (packet.count == 0) return true;
  bool done = false;
  switch (culling.tree) {
    case CulledTree::kBinaryBvh:
      done = TraceCulledTree<BinaryBvhView, kAny>(scene, culling, packet, cancel, stats);
      break;
    case CulledTree::kKdTree:
      done = TraceCulledTree<KdTreeView, kAny>(scene, culling, packet, cancel, stats);
      break;
    case CulledTree::kBvh:
      done = TraceCulledTree<BvhView, kAny>(scene, culling, packet, cancel, stats);
      break;
  }
  if (!done) return false;
  if (kAny || !packet.want_barycentrics) return true;
  if (culling.intersector == Intersector::kExact) {
    ReadyTriangles ready(scene.geometry, packet.origin, /*weights=*/true);
    FinishHits(ready, packet);
    return true;
  }
  for (int i = 0; i < packet.count; ++i) {
    IntersectorHit at;
    if (packet.triangle[i] != kNoTriangle) {
      const auto [a, b, c] = scene.geometry.Corners(packet.triangle[i]);
      if (!IntersectRay(culling.intersector, packet.ray(i), a, b, c, &at)) {
        // The corner rays had settled its edges, beside which the test itself has it miss.
        HitBarycentrics(packet.ray(i), a, b, c, &at.u, &at.v);
      }
    }
    packet.u[i] = at.u;
    packet.v[i] = at.v;
  }
  return true;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
