// SPDX-License-Identifier: Apache-2.0
//
// Relevant triangles tracing (paper 002) on the kd-tree: the four corner rays of a tile's shaft
// walk together, and gather the triangles that a ray between them may meet. As long as they go
// through the same cells, no ray between them can go through another; its answer is the list's.
// Where they part, the tile's rays walk one by one.
//
// Coherence. Let S_i be the corner rays, cut at some ends, H the hull of the origin and those ends,
// and say of a cell C that H∩C is the hull of the S_i∩C, whose beginnings lie in one plane (or in
// the origin) and are cut by it from the same side. It holds for the root's cell, taken as all of
// space. A plane through the origin has all of H on one side, or the corners part. Else:
//  * All S_i∩C end before it: H∩C is on the near side, and the far child needs no visit.
//  * All begin beyond it: likewise.
//  * All cross it: the near part is the hull of the parts before the crossings, since the other
//    edges of H between the two sides would have to leave a plane through the origin and two
//    corners; so is the far part, and its beginnings lie in the plane. Both are visited.
//  * All begin before it, but not all surely cross: cut the S_i there. The near part is as before,
//    for the H of these ends. The far child must then never be needed (`last` below): if the walk
//    comes to it, the corners are not coherent.
//  * Else they are not coherent.
// "Before" and "beyond" are certain: parameters compare with kBoxExitScale and kBoxExitShift to
// spare (core/geometry/box_ray.h, 2), and what is in doubt counts as neither. So every cell that
// meets H is visited, up to where the walk may stop:
//  * segments: beyond their ends;
//  * rays without end: beyond the scene, or, for closest hits, beyond a triangle that covers the
//    shaft (rtt_list-inl.h). H with the ends at its plane, and a little further, holds the part of
//    each ray that counts: in this part a closer triangle's box begins (kd_tree.h, 2), and in one
//    of the cells there the triangle stands.
// Hence the rule for shadows: every end must lie in the shaft (RttShaft verifies it), whether the
// receivers are coplanar or not; and that for first hits: a covering triangle, or a walk through
// the whole scene.

#if defined(SIGHTLINE_CORE_TRAVERSE_RTT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_RTT_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_RTT_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_RTT_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <iterator>
#include <limits>
#include <numeric>
#include <span>

#include "core/accel/kd_tree.h"
#include "core/base/cancel.h"
#include "core/base/check.h"
#include "core/geometry/box_ray.h"
#include "core/traverse/finish-inl.h"
#include "core/traverse/kd_single-inl.h"
#include "core/traverse/leaf_range.h"
#include "core/traverse/packet_lanes-inl.h"
#include "core/traverse/rtt.h"
#include "core/traverse/rtt_list-inl.h"
#include "core/traverse/rtt_shaft-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// The corner rays' walk.
class RttWalk {
 public:
  RttWalk(const IndexedGeometry& scene, const RttShaft& shaft, RttList& list, WalkStats* stats)
      : scene_(scene), tree_(*scene.kd_tree), shaft_(shaft), list_(list), stats_(stats) {
    const D d;
    for (int axis = 0; axis < 3; ++axis) {
      HWY_ALIGN float inv[4];
      for (int i = 0; i < 4; ++i) inv[i] = SlabReciprocal(shaft.direction(i)[axis]);
      inv_[axis] = hn::Load(d, inv);
    }
  }

  // Whether the list now holds every triangle that the rays may meet.
  bool Run() {
    if (tree_.empty()) return true;
    const D d;
    end_ = shaft_.segments() ? kSegmentEnd : shaft_.EndOf(tree_.bounds);
    Pending at = {0, false, hn::Zero(d), hn::Set(d, end_)};
    Pending stack[kKdStackSize];
    int depth = 0;
    while (true) {
      if (at.last) return false;
      const KdNode node = tree_.nodes[at.node];
      if (!node.is_leaf()) {
        ++stats_->nodes;
        switch (Enter(node, &at, &stack[depth])) {
          case Children::kParted:
            return false;
          case Children::kBoth:
            ++depth;
            continue;
          case Children::kOne:
            continue;
        }
      }
      if (!node.is_empty_leaf()) {
        if (!VisitLeaf(tree_.leaves[node.leaf()])) return false;
        if (list_.blocker() != kNoTriangle) return true;
      }
      do {
        if (depth == 0) return true;
        at = stack[--depth];
      } while (Surely(hn::Gt(at.entry, hn::Set(d, std::min(end_, list_.limit())))));
    }
  }

 private:
  using D = hn::CappedTag<float, 4>;
  using V = hn::Vec<D>;
  using M = hn::Mask<D>;

  struct Pending {
    uint32_t node;
    bool last;  // The corners were cut before it.
    V entry, exit;
  };
  enum class Children { kOne, kBoth, kParted };

  static HWY_INLINE bool Surely(M mask) { return hn::AllTrue(D(), mask); }
  // a < b, whatever their roundings.
  static HWY_INLINE M Before(V a, V b) {
    const D d;
    return hn::Lt(hn::MulAdd(a, hn::Set(d, kBoxExitScale), hn::Set(d, kBoxExitShift)), b);
  }

  // Goes to the one child, or to the nearer one and puts the other into *pending.
  HWY_INLINE Children Enter(KdNode node, Pending* at, Pending* pending) const {
    const D d;
    const int axis = node.axis();
    const float x = node.split() - shaft_.origin()[axis];
    if (x == 0) {
      // The plane goes through the origin: the shaft lies on one side of it, but for the origin
      // itself, where no triangle is hit.
      const V none = hn::Zero(d), endless = hn::Set(d, std::numeric_limits<float>::infinity());
      const bool above = Surely(hn::And(hn::Gt(inv_[axis], none), hn::Lt(inv_[axis], endless)));
      const bool below =
          Surely(hn::And(hn::Lt(inv_[axis], none), hn::Gt(inv_[axis], hn::Neg(endless))));
      if (!above && !below) return Children::kParted;
      at->node = node.first_child() + above;
      return Children::kOne;
    }
    const V t = hn::Mul(hn::Set(d, x), inv_[axis]);
    if (!hn::AllFalse(d, hn::Eq(t, hn::Zero(d)))) return Children::kParted;  // Underflow.
    const V never = hn::Set(d, std::numeric_limits<float>::infinity());
    const V cross = hn::IfThenElse(hn::Gt(t, hn::Zero(d)), t, never);
    const uint32_t near = node.first_child() + (x < 0), far = node.first_child() + (x > 0);
    if (Surely(hn::Or(Before(at->exit, cross), hn::Eq(cross, never)))) {
      at->node = near;
      return Children::kOne;
    }
    if (Surely(Before(cross, at->entry))) {
      at->node = far;
      return Children::kOne;
    }
    if (!Surely(Before(at->entry, cross))) return Children::kParted;
    const bool all_cross = Surely(Before(cross, at->exit));
    const V cut = hn::Min(cross, at->exit);
    *pending = {far, at->last || !all_cross, cut, at->exit};
    *at = {near, false, at->entry, cut};
    return Children::kBoth;
  }

  // False: there are too many relevant triangles.
  bool VisitLeaf(const KdLeaf& kd_leaf) {
    ++stats_->leaves;
    const LeafRange range = LeafRange::Of(tree_.LeafIds(kd_leaf));
    for (uint32_t at = 0; at < range.count; at += kMaxLeafTriangles) {
      const RangeView some(scene_.geometry, range, at);
      const LeafView& view = some.leaf;
      if (!list_.Add(view)) return false;
    }
    return true;
  }

  const IndexedGeometry& scene_;
  const KdTree& tree_;
  const RttShaft& shaft_;
  RttList& list_;
  WalkStats* const stats_;
  V inv_[3];
  float end_ = 0;
};

// The rays of one packet are put to a list of triangles.
template <bool kAny>
void PutToList(const SceneGeometry& geometry, std::span<const uint32_t> ids, int first, int count,
               PacketLanes<kAny>& lanes) {
  const hn::CappedTag<float, 16> d;
  const uint32_t width = static_cast<uint32_t>(hn::Lanes(d));
  const uint32_t begin = static_cast<uint32_t>(first) / width;
  const uint32_t end = (static_cast<uint32_t>(first + count) + width - 1) / width;
  const LeafRange range = LeafRange::Of(ids);
  for (uint32_t at = 0; at < range.count; at += kMaxLeafTriangles) {
    const RangeView some(geometry, range, at);
    const LeafView& view = some.leaf;
    FacingTriangle facing[kMaxLeafTriangles];
    const uint32_t turned = TurnTriangles(lanes, view, (1u << view.count) - 1, facing);
    for (uint32_t group = begin; group < end; ++group) {
      for (uint32_t i = 0; i < turned && lanes.active(group) != 0; ++i) {
        lanes.Test(view, facing[i], group, lanes.active(group));
      }
    }
  }
}

// Answers what it can of some packets of rays with one origin, and walks with the rest.
template <bool kAny>
class RttTracer {
 public:
  RttTracer(const IndexedGeometry& scene, const RttOptions& options, const CancelToken* cancel,
            WalkStats* stats)
      : scene_(scene), options_(options), cancel_(cancel), stats_(stats) {}

  // Tiles of a packet. Returns false if the token fired.
  bool TracePacket(RayPacket& packet) {
    PacketLanes<kAny> lanes(scene_, packet, stats_);
    const int tile = std::min(options_.tile_rays, packet.count);
    int left[RayPacket::kMaxRays], left_count = 0;
    for (int first = 0; first < packet.count; first += tile) {
      if (cancel_ != nullptr && cancel_->cancelled()) return false;
      const int count = std::min(tile, packet.count - first);
      const RttRays rays = {&packet, first, count};
      if (!AnswerTile({&rays, 1}, &lanes)) {
        for (int i = first; i < first + count; ++i) left[left_count++] = i;
      }
    }
    if (left_count > 0 && !WalkWith(std::span<const int>(left, left_count), packet)) return false;
    Finish(packet);
    return true;
  }

  // All packets as one tile.
  bool TraceTogether(std::span<RayPacket> packets) {
    if (cancel_ != nullptr && cancel_->cancelled()) return false;
    RttRays rays[kMaxPackets];
    for (size_t i = 0; i < packets.size(); ++i) {
      PadTargets(packets[i]);
      rays[i] = {&packets[i], 0, packets[i].count};
    }
    RttShaft shaft;
    const std::span<const RttRays> all(rays, packets.size());
    ++stats_->tiles;
    bool gathered = shaft.Bound(all);
    RttList list(scene_, shaft, all, kAny, options_.shared_edges, stats_);
    gathered = gathered && RttWalk(scene_, shaft, list, stats_).Run();
    Count(gathered, list);
    int every[RayPacket::kMaxRays];
    std::iota(std::begin(every), std::end(every), 0);
    for (RayPacket& packet : packets) {
      PacketLanes<kAny> lanes(scene_, packet, stats_);
      if (gathered) {
        Answer(list, {&packet, 0, packet.count}, &lanes);
      } else if (!WalkWith(std::span<const int>(every, packet.count), packet)) {
        return false;
      }
      Finish(packet);
    }
    return true;
  }

  static constexpr size_t kMaxPackets = 16;

 private:
  static void PadTargets(RayPacket& packet) {
    const int lanes = 16;
    for (int i = packet.count; i % lanes != 0; ++i) {
      packet.target_x[i] = packet.target_x[packet.count - 1];
      packet.target_y[i] = packet.target_y[packet.count - 1];
      packet.target_z[i] = packet.target_z[packet.count - 1];
      packet.target_source[i] = kNoTriangle;
    }
  }

  bool AnswerTile(std::span<const RttRays> rays, PacketLanes<kAny>* lanes) {
    ++stats_->tiles;
    RttShaft shaft;
    if (!shaft.Bound(rays)) return false;
    RttList list(scene_, shaft, rays, kAny, options_.shared_edges, stats_);
    const bool gathered = RttWalk(scene_, shaft, list, stats_).Run();
    Count(gathered, list);
    if (gathered) Answer(list, rays[0], lanes);
    return gathered;
  }

  void Count(bool gathered, const RttList& list) {
    stats_->tiles_answered += gathered;
    if (gathered) stats_->relevant_triangles += list.ids().size();
  }

  void Answer(const RttList& list, const RttRays& rays, PacketLanes<kAny>* lanes) {
    AnsweredBy by = AnsweredBy::kShaft;
    if (list.blocker() != kNoTriangle) {
      const uint32_t width = static_cast<uint32_t>(hn::Lanes(hn::CappedTag<float, 16>()));
      const uint32_t end = (static_cast<uint32_t>(rays.first + rays.count) + width - 1) / width;
      for (uint32_t group = static_cast<uint32_t>(rays.first) / width; group < end; ++group) {
        lanes->Block(list.blocker(), group, lanes->active(group));
      }
    } else if (!list.ids().empty()) {
      by = AnsweredBy::kTriangles;
      PutToList(scene_.geometry, list.ids(), rays.first, rays.count, *lanes);
    }
    if (rays.packet->answered_by != nullptr) {
      std::fill_n(rays.packet->answered_by + rays.first, rays.count, by);
    }
  }

  // Each by itself: tiles are left over where triangles are small, and packets gain least there.
  bool WalkWith(std::span<const int> lanes, RayPacket& packet) {
    for (size_t i = 0; i < lanes.size(); ++i) {
      if (i % kPollInterval == 0 && cancel_ != nullptr && cancel_->cancelled()) return false;
      const int lane = lanes[i];
      const TraceRay ray = {
          .ray = packet.ray(lane),
          .mask = packet.mask,
          .from_source = packet.origin_source,
          .to_source = packet.segments ? packet.target_source[lane] : kNoTriangle};
      const Hit hit = KdSingleWalk<kAny>(scene_, ray, stats_).Run();
      packet.t[lane] = hit.t;
      packet.triangle[lane] = hit.triangle;
      if (packet.answered_by != nullptr) packet.answered_by[lane] = AnsweredBy::kRay;
    }
    return true;
  }

  void Finish(RayPacket& packet) {
    if (kAny || !packet.want_barycentrics) return;
    ReadyTriangles ready(scene_.geometry, packet.origin, /*weights=*/true);
    FinishHits(ready, packet);
  }

  const IndexedGeometry& scene_;
  const RttOptions& options_;
  const CancelToken* const cancel_;
  WalkStats* const stats_;
};

template <bool kAny>
bool TraceRtt(const IndexedGeometry& scene, std::span<RayPacket> packets, const RttOptions& options,
              const CancelToken* cancel, WalkStats* stats) {
  RttTracer<kAny> tracer(scene, options, cancel, stats);
  if (options.tile_rays > RayPacket::kMaxRays) {
    SIGHTLINE_CHECK_LE(packets.size(), RttTracer<kAny>::kMaxPackets);
    for (const RayPacket& packet : packets) SIGHTLINE_CHECK_GT(packet.count, 0);
    return packets.empty() || tracer.TraceTogether(packets);
  }
  SIGHTLINE_CHECK(options.tile_rays > 0 && options.tile_rays % 16 == 0) << options.tile_rays;
  for (RayPacket& packet : packets) {
    if (packet.count > 0 && !tracer.TracePacket(packet)) return false;
  }
  return true;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
