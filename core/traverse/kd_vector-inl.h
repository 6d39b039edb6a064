// SPDX-License-Identifier: Apache-2.0
//
// One vector of a packet's rays (eight, or sixteen with AVX-512) through the kd-tree, each with an
// interval of its own: what conventional SIMD ray tracing does with packets of four (paper 002,
// section 2.4), as wide as today's registers are.
//
// Every lane enters what it would enter alone (kd_single-inl.h): the same products, the same
// margins, cut short by its own nearest hit. A lane's interval becomes empty where it does not go,
// and stays so below, since entries only grow and exits only shrink: no mask is kept beside it.
// Rays have one origin, so that the child on its side comes first for all of them.
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_KD_VECTOR_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_KD_VECTOR_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_KD_VECTOR_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_KD_VECTOR_INL_H_
#endif

#include <limits>

#include "core/accel/kd_tree.h"
#include "core/base/cancel.h"
#include "core/intersect/box_ray-inl.h"
#include "core/traverse/kd_single-inl.h"
#include "core/traverse/leaf_range.h"
#include "core/traverse/packet_lanes-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <bool kAny>
class KdVectorWalk {
 public:
  // All are kept by reference.
  KdVectorWalk(const IndexedGeometry& scene, PacketLanes<kAny>& lanes, WalkStats* stats)
      : scene_(scene),
        tree_(*scene.kd_tree),
        stats_(stats),
        lanes_(lanes),
        // With perfect splits a cell's entry says nothing about distances (kd_tree.h, 3).
        cells_bound_(kAny || !tree_.perfect()) {}

  // The active lanes of a group. Returns false if `cancel` fired.
  bool Run(uint32_t group, const CancelToken* cancel) {
    if (tree_.empty() || lanes_.active(group) == 0) return true;
    const D d;
    group_ = group;
    for (int axis = 0; axis < 3; ++axis) {
      inv_[axis] = hn::Load(d, lanes_.inv_row(axis) + group * hn::Lanes(d));
    }
    Pending at = {0, hn::Zero(d), hn::Zero(d)};
    RootInterval(&at.entry, &at.exit);
    if (!SomeMayHit(&at)) return true;
    Pending stack[kKdStackSize];
    int depth = 0;
    PacketPoll poll(cancel);
    while (true) {
      if (poll.Stops()) return false;
      const KdNode node = tree_.nodes[at.node];
      if (!node.is_leaf()) {
        ++stats_->nodes;
        if (Enter(node, &at, stack, &depth)) continue;
      } else if (!node.is_empty_leaf()) {
        VisitLeaf(tree_.leaves[node.leaf()], &poll);
        if (poll.stopped()) return false;
        if (kAny && lanes_.active(group) == 0) return true;
      }
      do {
        if (depth == 0) return true;
        at = stack[--depth];
      } while (!SomeMayHit(&at));
    }
  }

 private:
  using D = hn::CappedTag<float, 16>;
  using V = hn::Vec<D>;
  using M = hn::Mask<D>;

  struct Pending {  // The stack is not initialized.
    uint32_t node;
    V entry, exit;
  };

  // MayHoldHit of every lane.
  static HWY_INLINE M MayHold(V entry, V exit) {
    const D d;
    return hn::Le(hn::Max(entry, hn::Zero(d)), ExitWithMargin(d, exit));
  }

  // BoxEntry and BoxExit of the root's cell.
  HWY_INLINE void RootInterval(V* entry, V* exit) const {
    const D d;
    *entry = hn::Set(d, -std::numeric_limits<float>::infinity());
    *exit = hn::Set(d, std::numeric_limits<float>::infinity());
    const Vec3f lo = tree_.bounds.lo - lanes_.origin(), hi = tree_.bounds.hi - lanes_.origin();
    for (int k = 0; k < 3; ++k) {
      CutSlab(d, inv_[k], hn::Set(d, lo[k]), hn::Set(d, hi[k]), entry, exit);
    }
  }

  // Empties the intervals of lanes for which nothing there can count any more. False: of all.
  HWY_INLINE bool SomeMayHit(Pending* at) const {
    const D d;
    V entry = at->entry;
    if (!cells_bound_) {
      const Box3f& reach = tree_.reach[at->node];
      lanes_.LanesMeet(group_, reach.lo - lanes_.origin(), reach.hi - lanes_.origin(), &entry);
    }
    at->exit = hn::IfThenElse(lanes_.WithinLimits(group_, entry), at->exit,
                              hn::Set(d, -std::numeric_limits<float>::infinity()));
    return !hn::AllFalse(d, MayHold(at->entry, at->exit));
  }

  // Goes to the child on the origin's side if some lane may hit something there, and leaves the
  // other one on the stack if some lane may there, too. False: neither may.
  HWY_INLINE bool Enter(KdNode node, Pending* at, Pending* stack, int* depth) const {
    const D d;
    const int axis = node.axis();
    const float x = node.split() - lanes_.origin()[axis];
    const V inv = inv_[axis], t = hn::Mul(hn::Set(d, x), inv);
    // Along the ray: what is before the plane and what is beyond it. NaN is passed over.
    const V before = hn::Min(t, at->exit), beyond = hn::Max(t, at->entry);
    Pending lower = {node.first_child(), hn::IfNegativeThenElse(inv, beyond, at->entry),
                     hn::IfNegativeThenElse(inv, at->exit, before)};
    Pending upper = {node.first_child() + 1, hn::IfNegativeThenElse(inv, at->entry, beyond),
                     hn::IfNegativeThenElse(inv, before, at->exit)};
    const bool upper_first = x < 0;
    const Pending& near = upper_first ? upper : lower;
    const Pending& far = upper_first ? lower : upper;
    const bool near_met = !hn::AllFalse(d, MayHold(near.entry, near.exit));
    const bool far_met = !hn::AllFalse(d, MayHold(far.entry, far.exit));
    if (!near_met) {
      *at = far;
      return far_met;
    }
    if (far_met) stack[(*depth)++] = far;
    *at = near;
    return true;
  }

  // Leaves off when the poll fires.
  void VisitLeaf(const KdLeaf& kd_leaf, PacketPoll* poll) {
    const Vec3f lo = kd_leaf.box().lo - lanes_.origin(), hi = kd_leaf.box().hi - lanes_.origin();
    V entry;
    M met = lanes_.LanesMeet(group_, lo, hi, &entry);
    if (cells_bound_) met = hn::And(met, lanes_.WithinLimits(group_, entry));
    uint32_t in_leaf = MaskBits(D(), met) & lanes_.active(group_);
    if (in_leaf == 0) return;
    ++stats_->leaves;
    const LeafRange range = LeafRange::Of(scene_, kd_leaf);
    for (uint32_t at = 0; at < range.count && in_leaf != 0; at += kMaxLeafTriangles) {
      if (at > 0 && poll->Stops()) return;
      const RangeView some(scene_.geometry, range, at);
      const LeafView& view = some.leaf;
      FacingTriangle facing[kMaxLeafTriangles];
      const uint32_t count = TurnTriangles(lanes_, view, (1u << view.count) - 1, facing);
      for (uint32_t i = 0; i < count && in_leaf != 0; ++i) {
        in_leaf &= ~lanes_.Test(view, facing[i], group_, in_leaf);
      }
    }
  }

  const IndexedGeometry& scene_;
  const KdTree& tree_;
  WalkStats* const stats_;
  PacketLanes<kAny>& lanes_;
  const bool cells_bound_;
  uint32_t group_ = 0;
  V inv_[3];
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
