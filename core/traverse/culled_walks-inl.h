// SPDX-License-Identifier: Apache-2.0
//
// The walks over the binary BVH, and over the kd-tree seen as a tree of boxes, that cull within
// leaves (leaf_culling.h): single rays with ray-box culling, packets with vertex culling and paper
// 004's node tests.
//
// A kd-tree's cell is walked as the box that it is: its interval along a ray is made of the same
// products as a box's (core/accel/kd_tree.h), so what that header promises to walks holds here. It
// costs six products a node instead of one; kd_single-inl.h and kd_packet-inl.h go the usual way,
// without culling in their leaves.

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
#include "core/accel/kd_tree.h"
#include "core/base/cancel.h"
#include "core/traverse/finish-inl.h"
#include "core/traverse/packet_leaf-inl.h"
#include "core/traverse/ray_box_leaf-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// ---- The two trees, as boxes with two children

class BinaryBvhView {
 public:
  explicit BinaryBvhView(const IndexedGeometry& scene) : bvh_(*scene.binary_bvh) {}
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
  uint32_t Children(uint32_t node, const Box3f&, Box3f* left, Box3f* right) const {
    const uint32_t first = bvh_.nodes[node].first;
    *left = bvh_.nodes[first].box();
    *right = bvh_.nodes[first + 1].box();
    return first;
  }
  // Whether a box entered after the nearest hit may be left out.
  bool boxes_bound_hits() const { return true; }
  static constexpr uint32_t kStack = kMaxBinaryBvhDepth + 1;

 private:
  const BinaryBvh& bvh_;
};

class KdTreeView {
 public:
  explicit KdTreeView(const IndexedGeometry& scene)
      : tree_(*scene.kd_tree), triangles_(scene.kd_leaves ? &*scene.kd_leaves : nullptr) {}
  bool empty() const { return tree_.empty(); }
  Box3f root_box() const { return tree_.bounds; }
  bool is_leaf(uint32_t node) const { return tree_.nodes[node].is_leaf(); }
  bool LeafOf(uint32_t node, const Box3f&, LeafRange* range, Box3f* leaf_box) const {
    if (tree_.nodes[node].is_empty_leaf()) return false;
    const KdLeaf& leaf = tree_.leaves[tree_.nodes[node].leaf()];
    *range = {{tree_.ids.data(), tree_.ids.size()}, triangles_, leaf.first, leaf.count};
    *leaf_box = leaf.box();
    return true;
  }
  uint32_t Children(uint32_t node, const Box3f& box, Box3f* left, Box3f* right) const {
    const KdNode n = tree_.nodes[node];
    *left = *right = box;
    left->hi[n.axis()] = n.split();
    right->lo[n.axis()] = n.split();
    return n.first_child();
  }
  bool boxes_bound_hits() const { return !tree_.perfect(); }
  static constexpr uint32_t kStack = kKdStackSize;

 private:
  const KdTree& tree_;
  const LeafTriangles* const triangles_;
};

// ---- One ray

template <class Tree, bool kAny>
class CulledSingleWalk {
 public:
  CulledSingleWalk(const IndexedGeometry& scene, const LeafCulling& culling, const TraceRay& query,
                   WalkStats* stats)
      : tree_(scene),
        stats_(stats),
        leaf_(scene, culling, query, stats),
        limit_(query.ray.segment ? kSegmentEnd : std::numeric_limits<float>::infinity()) {}

  Hit Run() {
    if (tree_.empty()) return best_;
    // Not initialized: a box's default is not nothing.
    alignas(Pending) std::byte room[(Tree::kStack + 1) * sizeof(Pending)];
    Pending* const stack = reinterpret_cast<Pending*>(room);
    int depth = 0;
    Push({0, tree_.root_box(), 0}, stack, &depth);
    while (depth > 0) {
      const Pending at = stack[--depth];
      if (Bounds() && at.entry > limit_) continue;
      if (tree_.is_leaf(at.node)) {
        if (VisitLeaf(at)) break;
        continue;
      }
      ++stats_->nodes;
      Pending left, right;
      left.node = tree_.Children(at.node, at.box, &left.box, &right.box);
      right.node = left.node + 1;
      const bool left_met = Meets(&left), right_met = Meets(&right);
      if (left_met && right_met) {
        const bool left_first = left.entry <= right.entry;
        stack[depth++] = left_first ? right : left;
        stack[depth++] = left_first ? left : right;
      } else if (left_met || right_met) {
        stack[depth++] = left_met ? left : right;
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

  bool Meets(Pending* at) const {
    at->entry = BoxEntry(leaf_.box_ray(), at->box);
    const float exit = BoxExit(leaf_.box_ray(), at->box) * kBoxExitScale + kBoxExitShift;
    return at->entry <= exit && 0 <= exit && !(Bounds() && at->entry > limit_);
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
  RayBoxLeaf<kAny> leaf_;
  float limit_;
  Hit best_;
};

template <bool kAny>
bool TraceCulledSingle(const IndexedGeometry& scene, const LeafCulling& culling,
                       std::span<const TraceRay> rays, std::span<Hit> hits,
                       const CancelToken* cancel, WalkStats* stats) {
  for (size_t i = 0; i < rays.size(); ++i) {
    if (i % kPollInterval == 0 && cancel != nullptr && cancel->cancelled()) return false;
    hits[i] = culling.tree == CulledTree::kBinaryBvh
                  ? CulledSingleWalk<BinaryBvhView, kAny>(scene, culling, rays[i], stats).Run()
                  : CulledSingleWalk<KdTreeView, kAny>(scene, culling, rays[i], stats).Run();
  }
  return true;
}

// ---- Packets

template <class Tree, bool kAny>
class CulledPacketWalk {
 public:
  CulledPacketWalk(const IndexedGeometry& scene, const LeafCulling& culling, RayPacket& packet,
                   WalkStats* stats)
      : tree_(scene),
        culling_(culling),
        stats_(stats),
        lanes_(scene, packet, stats),
        leaf_(scene, culling, lanes_, stats),
        limit_(lanes_.first_limit()) {}

  bool has_frustum() const { return leaf_.slopes().valid(); }

  // Returns false if `cancel` fired.
  bool Run(const CancelToken* cancel) {
    if (tree_.empty()) return true;
    // Not initialized: a box's default is not nothing.
    alignas(Pending) std::byte room[(Tree::kStack + 1) * sizeof(Pending)];
    Pending* const stack = reinterpret_cast<Pending*>(room);
    int depth = 0;
    Pending root = {0, 0, tree_.root_box(), 0};
    if (Meets(0, &root)) stack[depth++] = root;
    uint64_t visited = 0;
    while (depth > 0) {
      const Pending at = stack[--depth];
      if (++visited % kPollInterval == 0 && cancel != nullptr && cancel->cancelled()) return false;
      if (tree_.is_leaf(at.node)) {
        if (VisitLeaf(at)) return true;
        continue;
      }
      ++stats_->nodes;
      Pending left, right;
      left.node = tree_.Children(at.node, at.box, &left.box, &right.box);
      right.node = left.node + 1;
      const bool left_met = Meets(at.first_group, &left);
      const bool right_met = Meets(at.first_group, &right);
      if (left_met && right_met) {
        const bool left_first = left.entry <= right.entry;
        stack[depth++] = left_first ? right : left;
        stack[depth++] = left_first ? left : right;
      } else if (left_met || right_met) {
        stack[depth++] = left_met ? left : right;
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

  // The lanes of a group that may hit something in the box, given relative to the origin.
  HWY_INLINE uint32_t LanesMeet(uint32_t group, const Vec3f& lo, const Vec3f& hi, V* entry) const {
    auto met = lanes_.LanesMeet(group, lo, hi, entry);
    if (Bounds()) met = hn::And(met, lanes_.WithinLimits(group, *entry));
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
        const uint32_t met = LanesMeet(g, lo, hi, &entry);
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
      met[g] = lanes_.active(g) == 0 ? 0 : LanesMeet(g, lo, hi, &entry);
      some |= met[g];
    }
    if (some == 0) return false;
    ++stats_->leaves;
    leaf_.Visit(range, met, at.first_group, kAny ? lanes_.first_limit() : limit_);
    if constexpr (kAny) {
      return lanes_.live() == 0;
    } else {
      limit_ = lanes_.LargestLimit();
      return false;
    }
  }

  const Tree tree_;
  const LeafCulling& culling_;
  WalkStats* const stats_;
  PacketLanes<kAny> lanes_;
  PacketLeaf<kAny> leaf_;
  float limit_;  // No live lane looks beyond this.
};

// The lanes first .. first + count - 1 of a packet, as a packet.
inline void CopyLanes(const RayPacket& from, int first, int count, RayPacket* to) {
  to->origin = from.origin;
  to->segments = from.segments;
  to->mask = from.mask;
  to->origin_source = from.origin_source;
  to->count = count;
  std::copy_n(from.target_x + first, count, to->target_x);
  std::copy_n(from.target_y + first, count, to->target_y);
  std::copy_n(from.target_z + first, count, to->target_z);
  std::copy_n(from.target_source + first, count, to->target_source);
}

template <class Tree, bool kAny>
bool TraceCulledTree(const IndexedGeometry& scene, const LeafCulling& culling, RayPacket& packet,
                     const CancelToken* cancel, WalkStats* stats) {
  // Packets of fewer rays than this are better off alone.
  constexpr int kLeastSplit = 4;
  {
    CulledPacketWalk<Tree, kAny> walk(scene, culling, packet, stats);
    if (walk.has_frustum()) return walk.Run(cancel);
  }
  if (culling.split == PacketSplit::kSingleRays || packet.count <= kLeastSplit) {
    for (int i = 0; i < packet.count; ++i) {
      if (cancel != nullptr && cancel->cancelled()) return false;
      const TraceRay ray = {packet.ray(i), packet.mask, packet.origin_source,
                            packet.segments ? packet.target_source[i] : kNoTriangle};
      const Hit hit = CulledSingleWalk<Tree, kAny>(scene, culling, ray, stats).Run();
      packet.triangle[i] = hit.triangle;
      if constexpr (!kAny) packet.t[i] = hit.t;
    }
    return true;
  }
  const auto part = std::make_unique<RayPacket>();
  for (int first = 0; first < packet.count;) {
    const int half = packet.count / 2;
    const int count = first == 0 ? half : packet.count - half;
    CopyLanes(packet, first, count, part.get());
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
  const bool done =
      culling.tree == CulledTree::kBinaryBvh
          ? TraceCulledTree<BinaryBvhView, kAny>(scene, culling, packet, cancel, stats)
          : TraceCulledTree<KdTreeView, kAny>(scene, culling, packet, cancel, stats);
  if (!done) return false;
  if (!kAny && packet.want_barycentrics) {
    ReadyTriangles ready(scene.geometry, packet.origin, /*weights=*/true);
    FinishHits(ready, packet);
  }
  return true;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
