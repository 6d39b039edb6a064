// SPDX-License-Identifier: Apache-2.0
//
// Rays with one origin walk the kd-tree together. Inner nodes are put to the whole packet by
// interval arithmetic: its cell's interval runs from the least entry to the greatest exit of its
// lanes. In a leaf, lanes that miss the leaf's own box are left out (paper 000, section 2).
//
// The interval test is exact about floats: a lane's parameter at a split is fl(x·inv) with x common
// and inv between the packet's extremes, and rounding is monotone, so it lies between the two end
// products; a packet enters whatever one of its lanes would.

#if defined(SIGHTLINE_CORE_TRAVERSE_KD_PACKET_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_KD_PACKET_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_KD_PACKET_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_KD_PACKET_INL_H_
#endif

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/accel/kd_tree.h"
#include "core/base/cancel.h"
#include "core/traverse/finish-inl.h"
#include "core/traverse/kd_single-inl.h"
#include "core/traverse/leaf_range.h"
#include "core/traverse/packet_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <bool kAny>
class KdPacketWalk {
 public:
  KdPacketWalk(const IndexedGeometry& scene, RayPacket& packet, WalkStats* stats)
      : scene_(scene),
        tree_(*scene.kd_tree),
        stats_(stats),
        lanes_(scene, packet, stats),
        limit_(lanes_.first_limit()),
        // With perfect splits a cell's entry says nothing about distances (kd_tree.h, 3).
        cells_bound_(kAny || !tree_.perfect()) {
    for (int axis = 0; axis < 3; ++axis) ranges_[axis] = lanes_.Reciprocals(axis);
  }

  // Returns false if `cancel` fired.
  bool Run(const CancelToken* cancel) {
    if (tree_.empty()) return true;
    Pending at = {0, -std::numeric_limits<float>::infinity(),
                  std::numeric_limits<float>::infinity()};
    for (int axis = 0; axis < 3; ++axis) {
      const Range& range = ranges_[axis];
      if (!range.usable) continue;
      const Span entry = At(axis, range.negative ? tree_.bounds.hi[axis] : tree_.bounds.lo[axis]);
      const Span exit = At(axis, range.negative ? tree_.bounds.lo[axis] : tree_.bounds.hi[axis]);
      at.entry = std::max(at.entry, entry.least);
      at.exit = std::min(at.exit, exit.most);
    }
    if (!MayHoldHit(at.entry, at.exit)) return true;
    Pending stack[kKdStackSize];
    int depth = 0;
    uint64_t visited = 0;
    while (true) {
      if (++visited % kPollInterval == 0 && cancel != nullptr && cancel->cancelled()) return false;
      const KdNode node = tree_.nodes[at.node];
      if (!node.is_leaf()) {
        ++stats_->nodes;
        if (Enter(node, &at, stack, &depth)) continue;
      } else if (!node.is_empty_leaf() && VisitLeaf(tree_.leaves[node.leaf()])) {
        return true;
      }
      do {
        if (depth == 0) return true;
        at = stack[--depth];
      } while (IsBehind(at));
    }
  }

 private:
  using D = hn::CappedTag<float, 16>;
  using V = hn::Vec<D>;

  struct Pending {  // Trivial: the stack is not initialized.
    uint32_t node;
    float entry, exit;  // No lane enters before, or leaves after.
  };
  using Range = typename PacketLanes<kAny>::ReciprocalRange;
  struct Span {
    float least, most;
  };

  // The lanes' parameters at a plane. REQUIRES: the axis is usable.
  HWY_INLINE Span At(int axis, float plane) const {
    const float x = plane - lanes_.origin()[axis];
    const float a = x * ranges_[axis].least, b = x * ranges_[axis].most;
    return {a < b ? a : b, a < b ? b : a};
  }

  HWY_INLINE bool IsBehind(const Pending& at) const {
    if (cells_bound_) return at.entry > limit_;
    const Box3f& reach = tree_.reach[at.node];
    for (int axis = 0; axis < 3; ++axis) {
      if (!ranges_[axis].usable) continue;
      const float face = ranges_[axis].negative ? reach.hi[axis] : reach.lo[axis];
      if (At(axis, face).least > limit_) return true;
    }
    return false;
  }

  // As KdSingleWalk's.
  HWY_INLINE bool Enter(KdNode node, Pending* at, Pending* stack, int* depth) const {
    const int axis = node.axis();
    const Range& range = ranges_[axis];
    Pending near = *at, far = *at;
    if (range.usable) {
      const Span t = At(axis, node.split());
      near.exit = t.most < at->exit ? t.most : at->exit;
      far.entry = t.least > at->entry ? t.least : at->entry;
    }
    // Where the axis tells nothing, the origin's side comes first.
    const uint32_t lower_is_far =
        range.usable ? range.negative : lanes_.origin()[axis] > node.split();
    near.node = node.first_child() + lower_is_far;
    far.node = node.first_child() + 1 - lower_is_far;
    const bool near_met = MayHoldHit(near.entry, near.exit);
    const bool far_met = MayHoldHit(far.entry, far.exit) && !IsBehind(far);
    if (!near_met) {
      *at = far;
      return far_met;
    }
    if (far_met) stack[(*depth)++] = far;
    *at = near;
    return true;
  }

  // The lanes of a group that may hit something in the leaf's box, given relative to the origin.
  HWY_INLINE uint32_t LanesMeet(uint32_t group, const Vec3f& box_lo, const Vec3f& box_hi) const {
    V entry;
    auto met = lanes_.LanesMeet(group, box_lo, box_hi, &entry);
    if (cells_bound_) met = hn::And(met, lanes_.WithinLimits(group, entry));
    return MaskBits(D(), met) & lanes_.active(group);
  }

  // Returns true when no lane is left to answer.
  bool VisitLeaf(const KdLeaf& kd_leaf) {
    const Vec3f lo = kd_leaf.box().lo - lanes_.origin(), hi = kd_leaf.box().hi - lanes_.origin();
    uint32_t in_leaf[RayPacket::kMaxRays / 8], some = 0;
    for (uint32_t group = 0; group < lanes_.groups(); ++group) {
      in_leaf[group] = lanes_.active(group) == 0 ? 0 : LanesMeet(group, lo, hi);
      some |= in_leaf[group];
    }
    if (some == 0) return false;
    ++stats_->leaves;
    const LeafRange range = LeafRange::Of(scene_, kd_leaf);
    for (uint32_t at = 0; at < range.count; at += kMaxLeafTriangles) {
      const RangeView some(scene_.geometry, range, at);
      const LeafView& view = some.leaf;
      FacingTriangle facing[kMaxLeafTriangles];
      const uint32_t count = TurnTriangles(lanes_, view, (1u << view.count) - 1, facing);
      for (uint32_t group = 0; group < lanes_.groups() && count > 0; ++group) {
        for (uint32_t i = 0; i < count && in_leaf[group] != 0; ++i) {
          in_leaf[group] &= ~lanes_.Test(view, facing[i], group, in_leaf[group]);
        }
      }
    }
    if constexpr (kAny) {
      return lanes_.live() == 0;
    } else {
      limit_ = lanes_.LargestLimit();
      return false;
    }
  }

  const IndexedGeometry& scene_;
  const KdTree& tree_;
  WalkStats* const stats_;
  PacketLanes<kAny> lanes_;
  float limit_;  // No live lane looks beyond this.
  const bool cells_bound_;
  Range ranges_[3];
};

template <bool kAny>
bool TraceKdPacket(const IndexedGeometry& scene, RayPacket& packet, const CancelToken* cancel,
                   WalkStats* stats) {
  if (packet.count == 0) return true;
  KdPacketWalk<kAny> walk(scene, packet, stats);
  if (!walk.Run(cancel)) return false;
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
