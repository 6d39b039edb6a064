// SPDX-License-Identifier: Apache-2.0
//
// The triangles of a leaf as the search for a patch asks for them (patch_cover-inl.h): what each is
// to the box of points, and where its edges lead that the box reaches over.
//
// Thread safety: plain values, pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_PATCH_LEAF_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_PATCH_LEAF_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_PATCH_LEAF_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_PATCH_LEAF_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/accel/indexed_geometry.h"
#include "core/geometry/box3.h"
#include "core/intersect/predicate-inl.h"
#include "core/traverse/leaf_cover-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/shaft_lanes-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// A byte for each triangle of a leaf.
using PatchD = hn::CappedTag<uint8_t, kMaxLeafTriangles>;
static_assert(hn::MaxLanes(PatchD()) == kMaxLeafTriangles);

// All ones where a bit is set.
HWY_INLINE hn::Vec<PatchD> BytesOf(uint32_t bits) {
  const uint8_t bytes[8] = {static_cast<uint8_t>(bits), static_cast<uint8_t>(bits >> 8)};
  return hn::VecFromMask(PatchD(), hn::LoadMaskBits(PatchD(), bytes));
}
HWY_INLINE uint32_t BitsOf(hn::Vec<PatchD> bytes) {
  return MaskBits(PatchD(), hn::Ne(bytes, hn::Zero(PatchD())));
}

// Bits are by triangle. An edge is open if it is not certain that all of the box is on the
// triangle's side of it.
struct PatchLeaf {
  static constexpr uint8_t kNoLane = 0x80;  // Looks up 0.

  ChildRef ref;
  uint32_t beyond, certain, turned;  // As in LeafSides.
  uint32_t middle;                   // Those with the middle of the box within their edges.
  uint32_t lone;    // Those with an open edge without a mate, or with one on the same side of it.
  uint32_t out[3];  // By edge: where it is open, and its mate is in another leaf.
  uint32_t members, done;  // Of a patch; and those whose mates have been taken, too.
  // By edge: the mate in this leaf, if that one's is open there; or kNoLane.
  alignas(16) uint8_t from[3][kMaxLeafTriangles];
  alignas(64) float at_middle[3][kMaxLeafTriangles];  // Edges' forms (SideForms).

  // Members, and all that they lead to over open edges within the leaf.
  HWY_INLINE uint32_t Closure() const {
    const PatchD d;
    const hn::Vec<PatchD> to[3] = {hn::Load(d, from[0]), hn::Load(d, from[1]),
                                   hn::Load(d, from[2])};
    hn::Vec<PatchD> in = BytesOf(members);
    for (uint32_t bits = members;;) {
      in = hn::Or(in,
                  hn::Or(hn::TableLookupBytes(in, to[0]),
                         hn::Or(hn::TableLookupBytes(in, to[1]), hn::TableLookupBytes(in, to[2]))));
      const uint32_t more = BitsOf(in);
      if (more == bits) return bits;
      bits = more;
    }
  }

  // The edge that the middle lies farthest beyond.
  HWY_INLINE int FarthestEdge(uint32_t lane) const {
    int farthest = 0;
    for (int e = 1; e < 3; ++e) {
      if (at_middle[e][lane] < at_middle[farthest][lane]) farthest = e;
    }
    return farthest;
  }

  // The triangle that the middle lies least far beside.
  HWY_INLINE uint32_t Nearest() const {
    uint32_t nearest = 0;
    float best = -std::numeric_limits<float>::infinity();
    for (uint32_t i = 0; i < ref.leaf_count(); ++i) {
      const float least = std::min(at_middle[0][i], std::min(at_middle[1][i], at_middle[2][i]));
      nearest = least > best ? i : nearest;
      best = std::max(best, least);
    }
    return nearest;
  }
};

// The mates of a leaf's triangles along one of their edges. Bits of lanes past the last triangle
// say nothing.
struct MateLanes {
  hn::Vec<PatchD> lane;                         // Of those in the same leaf.
  uint32_t inside = 0, none = 0, same_way = 0;  // In the same leaf; LeafMate.
};
HWY_INLINE MateLanes MatesAlong(const LeafMate* row, ChildRef leaf) {
  const hn::RebindToUnsigned<ShaftD> d;
  const hn::Rebind<uint8_t, decltype(d)> part;
  static_assert(sizeof(LeafMate) == sizeof(uint32_t));
  const uint32_t count = leaf.leaf_count();
  MateLanes mates;
  alignas(16) uint8_t lanes[kMaxLeafTriangles];
  for (uint32_t first = 0; first < kMaxLeafTriangles;
       first += static_cast<uint32_t>(hn::Lanes(d))) {
    const auto in = hn::FirstN(d, count > first ? count - first : 0);
    const auto bits = hn::MaskedLoad(in, d, reinterpret_cast<const uint32_t*>(row) + first);
    const auto lane = hn::Sub(hn::ShiftRight<LeafMate::kPlaceShift>(bits),
                              hn::Set(d, LeafMates::PlaceOf(leaf, 0)));
    mates.inside |= MaskBits(d, hn::And(in, hn::Lt(lane, hn::Set(d, count)))) << first;
    mates.none |= MaskBits(d, hn::Eq(bits, hn::Set(d, uint32_t{LeafMate::kNone}))) << first;
    mates.same_way |= MaskBits(d, hn::TestBit(bits, hn::Set(d, uint32_t{LeafMate::kSameWayBit})))
                      << first;
    hn::Store(hn::TruncateTo(part, lane), part, lanes + first);
  }
  mates.lane = hn::And(hn::Load(PatchD(), lanes), hn::Set(PatchD(), uint8_t{15}));
  return mates;
}

// As to segments from `common`, or rays along it; nothing is a member yet. REQUIRES: there are
// mates.
template <bool kParallel>
HWY_NOINLINE void AskPatchLeaf(const IndexedGeometry& scene, ChildRef ref, Vec3f common,
                               const Box3f& box, Vec3f middle, PatchLeaf* leaf) {
  const ShaftD d;
  const LeafView view(scene, ref);
  const Vec3V<ShaftV> at_middle = Broadcast(d, middle.x, middle.y, middle.z);
  uint32_t in_middle = 0;
  const LeafSides sides = SidesOf<kParallel>(
      view, common, box, [&](uint32_t first, const SideForms<kParallel>& forms) HWY_ATTR {
        auto within = hn::FirstN(d, view.count - first);
        for (int e = 0; e < 3; ++e) {
          const Vec3V<ShaftV> at = forms.AtEdge(e, at_middle);
          const ShaftV value = DotV(forms.edge[e], at);
          const ShaftV bound =
              hn::MulAdd(forms.edge_bound[e], NormInfV(at), hn::Set(d, kFloatUnderflow));
          within = hn::And(within, hn::Gt(value, bound));
          hn::Store(value, d, leaf->at_middle[e] + first);
        }
        in_middle |= MaskBits(d, within) << first;
      });
  leaf->ref = ref;
  leaf->beyond = sides.beyond;
  leaf->certain = sides.certain;
  leaf->turned = sides.turned;
  leaf->middle = in_middle;
  leaf->members = leaf->done = leaf->lone = 0;
  const PatchD db;
  const uint32_t all = (1u << view.count) - 1;
  const auto turned = BytesOf(sides.turned), no_lane = hn::Set(db, PatchLeaf::kNoLane);
  hn::Vec<PatchD> mate[3], across[3];  // In this leaf, along each edge; and only where it is open.
  for (int e = 0; e < 3; ++e) {
    const uint32_t open = ~sides.within[e] & all;
    const MateLanes mates = MatesAlong(scene.bvh.mates.of(ref, e), ref);
    mate[e] = hn::Or(mates.lane, hn::AndNot(BytesOf(mates.inside), no_lane));
    across[e] = hn::Or(mate[e], hn::AndNot(BytesOf(open), no_lane));
    // On the other side of the edge is a mate that is turned as this one is, unless both run along
    // it the same way.
    const uint32_t fold =
        (BitsOf(hn::TableLookupBytes(turned, mate[e])) ^ sides.turned ^ mates.same_way) &
        mates.inside;
    leaf->lone |= open & (fold | mates.none);
    leaf->out[e] = open & ~mates.inside & ~mates.none;
  }
  const auto lane = hn::Iota(db, 0);
  for (int e = 0; e < 3; ++e) {
    // Whether the mate leads here over its edge f.
    const auto leads = [&](int f) HWY_ATTR {
      return hn::Eq(hn::TableLookupBytes(across[f], mate[e]), lane);
    };
    const auto led =
        hn::AndNot(hn::Eq(mate[e], no_lane), hn::Or(leads(0), hn::Or(leads(1), leads(2))));
    hn::Store(hn::IfThenElse(led, mate[e], no_lane), db, leaf->from[e]);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
