// SPDX-License-Identifier: Apache-2.0
//
// The corner rays' walk of relevant triangles tracing (paper 002, section 3): of one tile, or of
// several tiles of one origin side by side, four lanes of a register each. A tile goes through the
// very cells that it would go through alone, and in that order: which child comes first is the
// origin's matter.
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
//    for the H of these ends, which may be smaller than H before the plane: what is lost runs into
//    the far child. So the walk must end before it comes to that child (`last` below): if it does
//    come to it, the corners are not coherent, whatever stands there.
//  * Else they are not coherent.
// "Before" and "beyond" are certain: parameters compare with kBoxExitScale and kBoxExitShift to
// spare (core/geometry/box_ray.h, 2), and what is in doubt counts as neither. So every cell that
// meets H is visited, up to where the walk may stop:
//  * segments: beyond their ends;
//  * rays without end: beyond the scene, or, for closest hits, beyond a triangle that covers the
//    shaft (rtt_list-inl.h). H with the ends at its plane, and a little further, holds the part of
//    each ray that counts: in this part a closer triangle's box begins (kd_tree.h, 2), and in one
//    of the cells there the triangle stands. With perfect splits it need not stand in those cells
//    (kd_tree.h, 3), but only in nodes whose `reach` meets this H, since the triangle's whole box
//    does: others are passed by, told by the box around H (kHullMargin), but never one of `last`;
//    and all cells are walked.
// Hence the rule for shadows: every end must lie in the shaft (RttShaft verifies it), whether the
// receivers are coplanar or not; and that for first hits: a covering triangle, or a walk through
// the whole scene.
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_RTT_WALK_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_RTT_WALK_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_RTT_WALK_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_RTT_WALK_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <limits>
#include <optional>
#include <span>

#include "core/accel/kd_tree.h"
#include "core/geometry/box_ray.h"
#include "core/traverse/leaf_range.h"
#include "core/traverse/rtt_list-inl.h"
#include "core/traverse/rtt_shaft-inl.h"
#include "core/traverse/single-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Tiles that fit side by side into a register.
constexpr int kMaxRttTiles = static_cast<int>(hn::MaxLanes(hn::CappedTag<float, 16>()) / 4);

// A tile's rays, its shaft, and what its walk gathers.
struct RttTile {
  static constexpr int kMaxParts = 4;

  std::span<const RttRays> rays() const { return {parts, static_cast<size_t>(part_count)}; }

  RttRays parts[kMaxParts];
  int part_count = 0;
  RttShaft shaft;
  std::optional<RttList> list;
};

template <int kTiles>
class RttWalk {
 public:
  // The tiles have one origin and one kind of target. All is kept by reference.
  // REQUIRES: 1 <= count <= kTiles; shafts are bound, lists are there.
  RttWalk(const IndexedGeometry& scene, RttTile* tiles, int count, WalkStats* stats,
          PacketPoll* poll)
      : scene_(scene),
        tree_(*scene.kd_tree),
        tiles_(tiles),
        count_(count),
        origin_(tiles[0].shaft.origin()),
        stats_(stats),
        poll_(poll),
        perfect_(tree_.perfect()) {
    HWY_ALIGN float inv[4 * kTiles];
    for (int axis = 0; axis < 3; ++axis) {
      for (int i = 0; i < 4 * kTiles; ++i) {
        // Lanes out of use copy the first tile's, and are never asked about.
        const RttShaft& shaft = tiles[i / 4 < count ? i / 4 : 0].shaft;
        inv[i] = SlabReciprocal(shaft.direction(i % 4)[axis]);
      }
      inv_[axis] = hn::Load(D(), inv);
    }
  }

  // By tile (bit i for tile i): whether its list now holds every triangle that its rays may meet.
  // Where the poll has fired, no list need.
  uint32_t Run() {
    const uint32_t all = kEveryTile & ((1u << 4 * count_) - 1);
    if (tree_.empty()) return Narrow(all);
    const D d;
    for (int i = 0; i < kTiles; ++i) {
      const RttShaft& shaft = tiles_[i < count_ ? i : 0].shaft;
      std::fill_n(limit_ + 4 * i, 4, shaft.segments() ? kSegmentEnd : shaft.EndOf(tree_.bounds));
    }
    walking_ = all;
    parted_ = hulls_known_ = 0;
    Pending at = {0, all, 0, hn::Zero(d), hn::Load(d, limit_)};
    Pending stack[kKdStackSize];
    int depth = 0;
    while (true) {
      if (poll_->Stops()) return 0;
      // First of all: the corners were cut for the node's sibling alone, and what of H is lost by
      // that is walked nowhere else, whatever this node holds.
      Part(at.tiles & at.last);
      at.tiles &= walking_;
      if (perfect_) at.tiles &= ~PassedBy(at.node, at.tiles);
      if (at.tiles != 0) {
        const KdNode node = tree_.nodes[at.node];
        if (!node.is_leaf()) {
          ++stats_->nodes;
          if (Enter(node, &at, &stack[depth], &depth)) continue;
        } else if (!node.is_empty_leaf()) {
          VisitLeaf(tree_.leaves[node.leaf()], at.tiles);
        }
      }
      do {
        if (depth == 0) return Narrow(all & ~parted_);
        at = stack[--depth];
        at.tiles &= walking_ & ~OfTiles(hn::Gt(at.entry, hn::Load(d, limit_)));
      } while (at.tiles == 0);
    }
  }

 private:
  using D = hn::CappedTag<float, 4 * kTiles>;
  using V = hn::Vec<D>;
  using M = hn::Mask<D>;
  static_assert(hn::MaxLanes(D()) == 4 * kTiles, "a tile is four lanes of the register");

  // A product and a sum in doubles are off by 2^-53 each of the largest number in them.
  static constexpr double kHullMargin = 0x1p-50;

  // Tiles are named by the bit of their first lane.
  static constexpr uint32_t kEveryTile = 0x1111u & ((1u << (4 * kTiles)) - 1);

  struct Pending {  // The stack is not initialized.
    uint32_t node;
    uint32_t tiles;
    uint32_t last;  // Tiles whose corners were cut before it.
    V entry, exit;
  };

  // The tiles all four of whose lanes are set.
  static HWY_INLINE uint32_t OfTiles(M mask) {
    const uint32_t bits = MaskBits(D(), mask);
    return bits & bits >> 1 & bits >> 2 & bits >> 3 & kEveryTile;
  }
  static uint32_t Narrow(uint32_t tiles) {
    uint32_t narrow = 0;
    for (int i = 0; i < kTiles; ++i) narrow |= (tiles >> 4 * i & 1) << i;
    return narrow;
  }
  // a < b, whatever their roundings.
  static HWY_INLINE M Before(V a, V b) {
    const D d;
    return hn::Lt(hn::MulAdd(a, hn::Set(d, kBoxExitScale), hn::Set(d, kBoxExitShift)), b);
  }

  // Of some tiles, those for which nothing below the node counts.
  uint32_t PassedBy(uint32_t node, uint32_t tiles) const {
    const Box3f& reach = tree_.reach[node];
    uint32_t passed = 0;
    for (uint32_t left = tiles & hulls_known_; left != 0; left &= left - 1) {
      const int bit = std::countr_zero(left);
      const auto& [lo, hi] = hulls_[bit / 4];
      if (reach.lo.x > hi.x || reach.hi.x < lo.x || reach.lo.y > hi.y || reach.hi.y < lo.y ||
          reach.lo.z > hi.z || reach.hi.z < lo.z) {
        passed |= 1u << bit;
      }
    }
    return passed;
  }

  // Finds the box around a tile's H, cut behind a triangle that covers it, where there is one.
  void BoundHull(int bit) {
    const RttTile& tile = tiles_[bit / 4];
    const double end = double{tile.list->limit()} + kBoxExitShift;
    if (!(end < std::numeric_limits<double>::infinity())) return;
    const Vec3d origin = ToDouble(origin_);
    Box3d hull = {origin, origin};
    double size = MaxAbs(origin_);
    for (int i = 0; i < 4; ++i) {
      const Vec3d along = ToDouble(tile.shaft.direction(i)) * end;
      for (int k = 0; k < 3; ++k) {
        hull.lo[k] = std::min(hull.lo[k], origin[k] + along[k]);
        hull.hi[k] = std::max(hull.hi[k], origin[k] + along[k]);
        size = std::max(size, std::abs(along[k]));
      }
    }
    for (int k = 0; k < 3; ++k) {
      hull.lo[k] -= size * kHullMargin;
      hull.hi[k] += size * kHullMargin;
    }
    hulls_[bit / 4] = hull;
    hulls_known_ |= 1u << bit;
  }

  // These are not coherent.
  HWY_INLINE void Part(uint32_t tiles) {
    parted_ |= tiles;
    walking_ &= ~tiles;
  }

  // Goes to the one child that tiles are to visit, or to the nearer one and puts the other into
  // *pending. False: no tile is left to visit any.
  HWY_INLINE bool Enter(KdNode node, Pending* at, Pending* pending, int* depth) {
    const D d;
    const int axis = node.axis();
    const float x = node.split() - origin_[axis];
    if (x == 0) {
      // The plane goes through the origin: a shaft lies on one side of it, but for the origin
      // itself, where no triangle is hit.
      const V none = hn::Zero(d), endless = hn::Set(d, std::numeric_limits<float>::infinity());
      const V inv = inv_[axis];
      const uint32_t above = OfTiles(hn::And(hn::Gt(inv, none), hn::Lt(inv, endless))),
                     below = OfTiles(hn::And(hn::Lt(inv, none), hn::Gt(inv, hn::Neg(endless))));
      Part(at->tiles & ~(above | below));
      *pending = *at;
      pending->node = node.first_child() + 1;
      pending->tiles = at->tiles & above;
      at->node = node.first_child();
      at->tiles &= below;
      return Follow(at, pending, depth);
    }
    const V t = hn::Mul(hn::Set(d, x), inv_[axis]);
    const V zero = hn::Zero(d), never = hn::Set(d, std::numeric_limits<float>::infinity());
    const V cross = hn::IfThenElse(hn::Gt(t, zero), t, never);
    const uint32_t underflow = MaskBits(d, hn::Eq(t, zero));
    const uint32_t certain = underflow == 0 ? kEveryTile : OfTiles(hn::Ne(t, zero));
    const uint32_t near_only =
        OfTiles(hn::Or(Before(at->exit, cross), hn::Eq(cross, never))) & certain;
    const uint32_t far_only = OfTiles(Before(cross, at->entry)) & certain & ~near_only;
    const uint32_t both = OfTiles(Before(at->entry, cross)) & certain & ~near_only & ~far_only;
    Part(at->tiles & ~(near_only | far_only | both));
    // Those of `near_only` have their exits before the crossing, those of `far_only` their entries
    // beyond it: for them nothing is cut.
    const V cut = hn::Min(cross, at->exit);
    const uint32_t all_cross = OfTiles(Before(cross, at->exit));
    *pending = {node.first_child() + (x > 0), at->tiles & (far_only | both), both & ~all_cross,
                hn::Max(cut, at->entry), at->exit};
    *at = {node.first_child() + (x < 0), at->tiles & (near_only | both), 0, at->entry, cut};
    return Follow(at, pending, depth);
  }

  // Leaves *pending on the stack, or goes to it where *at has no tile.
  static HWY_INLINE bool Follow(Pending* at, const Pending* pending, int* depth) {
    if (at->tiles == 0) {
      *at = *pending;
      return at->tiles != 0;
    }
    *depth += pending->tiles != 0;
    return true;
  }

  void VisitLeaf(const KdLeaf& kd_leaf, uint32_t tiles) {
    const RttList::D d;
    using VT = hn::Vec<RttList::D>;
    ++stats_->leaves;
    const Vec3V<VT> o = Broadcast(d, origin_.x, origin_.y, origin_.z);
    const LeafRange range = LeafRange::Of(scene_, kd_leaf);
    for (uint32_t at = 0; at < range.count; at += kMaxLeafTriangles) {
      if (at > 0 && poll_->Stops()) return;
      const RangeView some(scene_.geometry, range, at);
      const LeafView& view = some.leaf;
      for (uint32_t first = 0; first < view.count; first += static_cast<uint32_t>(hn::Lanes(d))) {
        const OriginTriangles<VT> t = PrepareTriangles(d, view.rows + first, view.stride, o);
        for (uint32_t left = tiles & walking_; left != 0; left &= left - 1) {
          const int bit = std::countr_zero(left);
          RttList& list = *tiles_[bit / 4].list;
          if (!list.Add(view, first, t)) {
            Part(1u << bit);
          } else if (list.complete()) {
            walking_ &= ~(1u << bit);  // All is known.
          } else if (perfect_) {
            BoundHull(bit);
          } else {
            for (int i = 0; i < 4; ++i) limit_[bit + i] = std::min(limit_[bit + i], list.limit());
          }
        }
      }
    }
  }

  const IndexedGeometry& scene_;
  const KdTree& tree_;
  RttTile* const tiles_;
  const int count_;
  const Vec3f origin_;
  WalkStats* const stats_;
  PacketPoll* const poll_;
  const bool perfect_;
  uint32_t walking_ = 0, parted_ = 0;
  uint32_t hulls_known_ = 0;  // With perfect splits: tiles of which `hulls_` are bounds.
  Box3d hulls_[kTiles];
  V inv_[3];
  HWY_ALIGN float limit_[4 * kTiles];  // Nothing that corners enter after this counts.
};

// As many side by side as there are. REQUIRES: 1 <= count <= kMost.
template <int kMost = kMaxRttTiles>
uint32_t WalkRttTiles(const IndexedGeometry& scene, RttTile* tiles, int count, WalkStats* stats,
                      PacketPoll* poll) {
  if constexpr (kMost > 1) {
    if (count <= kMost / 2) return WalkRttTiles<kMost / 2>(scene, tiles, count, stats, poll);
  }
  return RttWalk<kMost>(scene, tiles, count, stats, poll).Run();
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
