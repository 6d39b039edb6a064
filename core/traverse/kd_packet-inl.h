// SPDX-License-Identifier: Apache-2.0
//
// Rays with one origin walk the kd-tree together. Inner nodes are put to the whole packet by
// interval arithmetic: its cell's interval runs from the least entry to the greatest exit of its
// lanes. In a leaf, lanes that miss the leaf's own box are left out (paper 000, section 2).
//
// The interval test is exact about floats: a lane's parameter at a split is fl(x·inv) with x common
// and inv between the packet's extremes, and rounding is monotone, so it lies between the two end
// products; a packet enters whatever one of its lanes would.
//
// Rays of a camera share nearly all nodes where triangles are large, and the interval is as good as
// a ray. Where they are small, or rays end on points all over a scene, every lane is put to every
// leaf's box; so a packet that has come to more than its budget leaves off, and its vectors of rays
// walk by themselves (kd_vector-inl.h), no further than the hits found so far.
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_KD_PACKET_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_KD_PACKET_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_KD_PACKET_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_KD_PACKET_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "core/accel/kd_tree.h"
#include "core/base/cancel.h"
#include "core/traverse/finish-inl.h"
#include "core/traverse/kd_single-inl.h"
#include "core/traverse/kd_vector-inl.h"
#include "core/traverse/leaf_range.h"
#include "core/traverse/packet_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// What a packet may come to: nodes, and leaves at the price of kKdLeafPrice nodes. Where rays share
// little the budget is lost: with 200, 400 and 800 instead of none (all vectors by themselves) a
// picture of the room at 640×480 takes 1.09, 1.10 and 1.15 times as long, the plants' shadows at
// 320×240 1.03, 1.01 and 1.16 times, and one of the room at 2048×1560 0.80, 0.67 and 0.58 times.
constexpr int64_t kKdPacketBudget = 400;
constexpr int64_t kKdLeafPrice = 8;
// Rays that are fewer walk a vector at a time from the start: sixty-four together were no better.
constexpr int kLeastKdPacketRays = 128;

template <bool kAny>
class KdPacketWalk {
 public:
  // Of the vectors of lanes in `groups` (bit i for group i). All are kept by reference.
  KdPacketWalk(const IndexedGeometry& scene, PacketLanes<kAny>& lanes, uint32_t groups,
               WalkStats* stats)
      : scene_(scene),
        tree_(*scene.kd_tree),
        stats_(stats),
        lanes_(lanes),
        asked_(groups),
        limit_(lanes_.first_limit()),
        // With perfect splits a cell's entry says nothing about distances (kd_tree.h, 3).
        cells_bound_(kAny || !tree_.perfect()) {
    for (int axis = 0; axis < 3; ++axis) ranges_[axis] = lanes_.Reciprocals(axis);
  }

  enum class End { kDone, kCancelled, kOverBudget };

  // Not done: what was found counts, but may not be all.
  End Run(const CancelToken* cancel) {
    if (tree_.empty()) return End::kDone;
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
    if (!MayHoldHit(at.entry, at.exit)) return End::kDone;
    Pending stack[kKdStackSize];
    int depth = 0;
    if (cancel != nullptr && cancel->cancelled()) return End::kCancelled;
    PacketPoll poll(cancel);
    for (int64_t budget = kKdPacketBudget; budget > 0; --budget) {
      const KdNode node = tree_.nodes[at.node];
      if (!node.is_leaf()) {
        ++stats_->nodes;
        if (Enter(node, &at, stack, &depth)) continue;
      } else if (!node.is_empty_leaf()) {
        budget -= kKdLeafPrice - 1;
        const bool all_done = VisitLeaf(tree_.leaves[node.leaf()], &poll);
        if (poll.stopped()) return End::kCancelled;
        if (all_done) return End::kDone;
      }
      do {
        if (depth == 0) return End::kDone;
        at = stack[--depth];
      } while (IsBehind(at));
    }
    return End::kOverBudget;
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

  // Returns true when no lane is left to answer. Leaves off when the poll fires.
  bool VisitLeaf(const KdLeaf& kd_leaf, PacketPoll* poll) {
    const Vec3f lo = kd_leaf.box().lo - lanes_.origin(), hi = kd_leaf.box().hi - lanes_.origin();
    uint32_t in_leaf[RayPacket::kMaxRays / 8], some = 0;
    for (uint32_t left = asked_; left != 0; left &= left - 1) {
      const uint32_t group = static_cast<uint32_t>(std::countr_zero(left));
      in_leaf[group] = lanes_.active(group) == 0 ? 0 : LanesMeet(group, lo, hi);
      some |= in_leaf[group];
    }
    if (some == 0) return false;
    ++stats_->leaves;
    const LeafRange range = LeafRange::Of(scene_, kd_leaf);
    for (uint32_t at = 0; at < range.count; at += kMaxLeafTriangles) {
      if (poll->Stops()) return false;
      const RangeView some(scene_.geometry, range, at);
      const LeafView& view = some.leaf;
      FacingTriangle facing[kMaxLeafTriangles];
      const uint32_t count = TurnTriangles(lanes_, view, (1u << view.count) - 1, facing);
      for (uint32_t left = count > 0 ? asked_ : 0; left != 0; left &= left - 1) {
        const uint32_t group = static_cast<uint32_t>(std::countr_zero(left));
        for (uint32_t i = 0; i < count && in_leaf[group] != 0; ++i) {
          in_leaf[group] &= ~lanes_.Test(view, facing[i], group, in_leaf[group]);
        }
      }
    }
    if constexpr (kAny) {
      for (uint32_t left = asked_; left != 0; left &= left - 1) {
        if (lanes_.active(static_cast<uint32_t>(std::countr_zero(left))) != 0) return false;
      }
      return true;
    } else {
      limit_ = lanes_.LargestLimit(asked_);
      return false;
    }
  }

  const IndexedGeometry& scene_;
  const KdTree& tree_;
  WalkStats* const stats_;
  PacketLanes<kAny>& lanes_;
  const uint32_t asked_;
  float limit_;  // No live lane looks beyond this.
  const bool cells_bound_;
  Range ranges_[3];
};

// The vectors of lanes in `groups`, together if that goes well. Returns false if `cancel` fired.
template <bool kAny>
bool WalkKdTree(const IndexedGeometry& scene, PacketLanes<kAny>& lanes, uint32_t groups,
                const CancelToken* cancel, WalkStats* stats) {
  constexpr int kWidth = static_cast<int>(hn::MaxLanes(hn::CappedTag<float, 16>()));
  if (std::popcount(groups) * kWidth >= kLeastKdPacketRays) {
    using Walk = KdPacketWalk<kAny>;
    const auto end = Walk(scene, lanes, groups, stats).Run(cancel);
    if (end != Walk::End::kOverBudget) return end == Walk::End::kDone;
  }
  KdVectorWalk<kAny> walk(scene, lanes, stats);
  for (; groups != 0; groups &= groups - 1) {
    if (!walk.Run(static_cast<uint32_t>(std::countr_zero(groups)), cancel)) return false;
  }
  return true;
}

template <bool kAny>
bool TraceKdPacket(const IndexedGeometry& scene, RayPacket& packet, const CancelToken* cancel,
                   WalkStats* stats) {
  if (packet.count == 0) return true;
  PacketLanes<kAny> lanes(scene, packet, stats);
  const uint32_t all = static_cast<uint32_t>((uint64_t{1} << lanes.groups()) - 1);
  if (!WalkKdTree(scene, lanes, all, cancel, stats)) return false;
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
