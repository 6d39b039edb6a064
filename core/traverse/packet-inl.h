// SPDX-License-Identifier: Apache-2.0
//
// Rays with one origin walk together to their closest hits (paper 004, section 3; paper 000 for the
// shared origin's gains); for any hit, occluded_packet-inl.h.
//
// A node's eight boxes are first put to the whole packet by interval arithmetic; a box that
// survives is tried on groups of lanes, from the group that was first to enter the parent
// (first-active-ray test), until one enters. In a leaf, lanes that miss the leaf's own box are left
// out.
//
// The interval test is exact about floats: a lane's slab parameter is fl(x·inv) with x common and
// inv between the packet's extremes, and rounding is monotone, so the lane's value lies between the
// two end products.
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_PACKET_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_PACKET_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_PACKET_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_PACKET_INL_H_
#endif

#include "core/base/cancel.h"
#include "core/intersect/box_ray-inl.h"
#include "core/traverse/finish-inl.h"
#include "core/traverse/packet_lanes-inl.h"
#include "core/traverse/single-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

class PacketWalk {
 public:
  PacketWalk(const IndexedGeometry& scene, RayPacket& packet, WalkStats* stats)
      : scene_(scene), stats_(stats), lanes_(scene, packet, stats), limit_(lanes_.first_limit()) {
    for (int axis = 0; axis < 3; ++axis) ranges_[axis] = lanes_.Reciprocals(axis);
  }

  // Returns false if `cancel` fired.
  bool Run(const CancelToken* cancel) {
    if (scene_.bvh.empty()) return true;
    Pending stack[kBvhStackSize];
    int depth = 0;
    stack[depth++] = {-std::numeric_limits<float>::infinity(), ChildRef::Inner(0).bits(), 0,
                      Slab{}};
    uint64_t visited = 0;
    while (depth > 0) {
      const Pending pending = stack[--depth];
      if (pending.entry > limit_) continue;
      if (++visited % kPollInterval == 0 && cancel != nullptr && cancel->cancelled()) return false;
      const ChildRef ref = ChildRef::FromBits(pending.ref_bits);
      if (ref.is_leaf()) {
        VisitLeaf(ref, pending);
        continue;
      }
      ++stats_->nodes;
      const BvhNode& node = scene_.bvh.nodes[ref.node()];
      HWY_ALIGN float entries[kBvhWidth];
      uint32_t bits = MeetPacket(node, entries);
      const int base = depth;
      for (; bits != 0; bits &= bits - 1) {
        const int i = std::countr_zero(bits);
        const Slab slab = SlabOf(node, i);
        uint32_t group = pending.first_group;
        while (group < lanes_.groups() && !GroupMeets(group, slab)) ++group;
        if (group == lanes_.groups()) continue;
        const Pending child = {entries[i], node.child[i].bits(), group, slab};
        int at = depth++;
        while (at > base && stack[at - 1].entry < child.entry) {
          stack[at] = stack[at - 1];
          --at;
        }
        stack[at] = child;
      }
    }
    return true;
  }

 private:
  using D = hn::CappedTag<float, 16>;
  using V = hn::Vec<D>;
  using M = hn::Mask<D>;

  // A box's faces relative to the origin: lo - o, hi - o.
  struct Slab {
    float lo[3], hi[3];
  };
  struct Pending {  // Trivial: the stack is not initialized.
    float entry;    // No lane enters before this.
    uint32_t ref_bits;
    uint32_t first_group;  // No lane of a group before it enters.
    Slab slab;
  };

  // Which of the node's boxes some lane may enter; their least entries.
  uint32_t MeetPacket(const BvhNode& node, float* entries) const {
    const hn::CappedTag<float, kBvhWidth> d8;
    using V8 = hn::Vec<decltype(d8)>;
    V8 entry = hn::Set(d8, -std::numeric_limits<float>::infinity());
    V8 exit = hn::Set(d8, std::numeric_limits<float>::infinity());
    for (int k = 0; k < 3; ++k) {
      const auto& range = ranges_[k];
      if (!range.usable) continue;
      const V8 o = hn::Set(d8, lanes_.origin()[k]);
      const V8 i0 = hn::Set(d8, range.least), i1 = hn::Set(d8, range.most);
      const V8 near = hn::Sub(hn::Load(d8, node.bounds[range.negative ? k + 3 : k]), o);
      const V8 far = hn::Sub(hn::Load(d8, node.bounds[range.negative ? k : k + 3]), o);
      entry = hn::Max(hn::Min(hn::Mul(near, i0), hn::Mul(near, i1)), entry);
      exit = hn::Min(hn::Max(hn::Mul(far, i0), hn::Mul(far, i1)), exit);
    }
    hn::Store(entry, d8, entries);
    const auto met = hn::And(hn::Le(hn::Max(entry, hn::Zero(d8)), ExitWithMargin(d8, exit)),
                             hn::Le(entry, hn::Set(d8, limit_)));
    return MaskBits(d8, met) & ((1u << node.child_count) - 1);
  }

  Slab SlabOf(const BvhNode& node, int i) const {
    Slab slab;
    for (int k = 0; k < 3; ++k) {
      slab.lo[k] = node.bounds[k][i] - lanes_.origin()[k];
      slab.hi[k] = node.bounds[k + 3][i] - lanes_.origin()[k];
    }
    return slab;
  }

  // The lanes of a group that may enter the box before their limits.
  HWY_INLINE M LanesMeet(uint32_t group, const Slab& slab) const {
    V entry;
    const M met = lanes_.LanesMeet(group, slab.lo, slab.hi, &entry);
    return hn::And(met, lanes_.WithinLimits(group, entry));
  }

  bool GroupMeets(uint32_t group, const Slab& slab) const {
    return lanes_.active(group) != 0 && !hn::AllFalse(D(), LanesMeet(group, slab));
  }

  void VisitLeaf(ChildRef ref, const Pending& pending) {
    ++stats_->leaves;
    const LeafView leaf(scene_, ref);
    FacingTriangle facing[kMaxLeafTriangles];
    const uint32_t count = TurnTriangles(lanes_, leaf, (1u << leaf.count) - 1, facing);
    if (count == 0) return;
    for (uint32_t group = pending.first_group; group < lanes_.groups(); ++group) {
      if (lanes_.active(group) == 0) continue;
      uint32_t in_leaf = MaskBits(D(), LanesMeet(group, pending.slab)) & lanes_.active(group);
      for (uint32_t i = 0; i < count && in_leaf != 0; ++i) {
        in_leaf &= ~lanes_.Test(leaf, facing[i], group, in_leaf);
      }
    }
    limit_ = lanes_.LargestLimit();
  }

  const IndexedGeometry& scene_;
  WalkStats* stats_;
  PacketLanes<false> lanes_;
  float limit_;  // No live lane looks beyond this.
  PacketLanes<false>::ReciprocalRange ranges_[3];
};

inline bool TraceClosestPacket(const IndexedGeometry& scene, RayPacket& packet,
                               const CancelToken* cancel, WalkStats* stats) {
  if (packet.count == 0) return true;
  PacketWalk walk(scene, packet, stats);
  if (!walk.Run(cancel)) return false;
  if (packet.want_barycentrics) {
    ReadyTriangles ready(scene.geometry, packet.origin, /*weights=*/true);
    FinishHits(ready, packet);
  }
  return true;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
