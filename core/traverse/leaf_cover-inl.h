// SPDX-License-Identifier: Apache-2.0
//
// The triangles of a leaf that block every ray of a set, told from the box around the set's points
// alone, sixteen triangles at a time. Where one stands before all of them, as a ceiling does,
// points are answered before they have been laid out for any walk.
//
// Why a box is enough. What the predicate asks of a point P, on which side of a triangle's edges,
// as seen from the origin, and of its plane P lies, are linear forms in P: each is positive
// throughout a box if it is at the box's corners. The float stage (core/intersect/predicate-inl.h)
// evaluates a form by fused multiply-adds, one for each axis; rounding is monotone, so its least
// value over the corners is that at the corner which is chosen axis by axis, by the sign of the
// form's component. Beyond the stage's bound, taken of the farthest corner, it is certain.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_LEAF_COVER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_LEAF_COVER_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_LEAF_COVER_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_LEAF_COVER_INL_H_
#endif

#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>

#include "core/accel/indexed_geometry.h"
#include "core/base/check.h"
#include "core/geometry/box3.h"
#include "core/intersect/predicate-inl.h"
#include "core/traverse/leaf_corners-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/shaft_lanes-inl.h"
#include "core/traverse/trace_ray.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// The least value of form·p over all p between `lo` and `hi`.
HWY_INLINE ShaftV LeastOver(const Vec3V<ShaftV>& form, const Vec3V<ShaftV>& lo,
                            const Vec3V<ShaftV>& hi) {
  const Vec3V<ShaftV> corner = {hn::IfNegativeThenElse(form.x, hi.x, lo.x),
                                hn::IfNegativeThenElse(form.y, hi.y, lo.y),
                                hn::IfNegativeThenElse(form.z, hi.z, lo.z)};
  return DotV(form, corner);
}

// What a leaf's triangles (bit i for triangle i) are to all segments from a common origin to points
// of a box, or all rays from points of the box along a common direction.
struct LeafSides {
  uint32_t within[3] = {};  // All are on the triangle's side of the edge from this corner on.
  uint32_t beyond = 0;      // Its plane stands between origin and box, or before the rays.
  uint32_t turned = 0;      // Its corners run the other way about as those rays see them,
  uint32_t certain = 0;     // and whether they do is certain.
};

// The forms of as many triangles as a vector has lanes. Each is positive where they block, beyond a
// bound: of edges ((A-O)×(B-A))·(P-O), or ((B-A)×D)·(A-P) along a direction; of the plane N·(P-A),
// or N·(A-P).
template <bool kParallel>
struct SideForms {
  using V = ShaftV;
  using V3 = Vec3V<V>;

  // By `common`, the origin or the direction.
  HWY_INLINE SideForms(const LeafView& leaf, uint32_t first, const V3& common) : origin(common) {
    const ShaftD d;
    const V units = hn::Set(d, kFloatUnits), underflow = hn::Set(d, kFloatUnderflow);
    for (int e = 0; e < 3; ++e) corner[e] = LeafCorner(leaf, e, first);
    const V3 along[3] = {SubV(corner[1], corner[0]), SubV(corner[2], corner[1]),
                         SubV(corner[0], corner[2])};
    const V along1[3] = {Norm1V(along[0]), Norm1V(along[1]), Norm1V(along[2])};
    plane = CrossV(along[0], along[1]);
    plane_bound = hn::MulAdd(units, hn::Mul(along1[0], along1[1]), underflow);
    const V3 first_apex = SubV(corner[0], common);
    turn = DotV(plane, kParallel ? common : first_apex);
    turn_bound = hn::MulAdd(plane_bound, NormInfV(kParallel ? common : first_apex), underflow);
    // Triangles are turned so that their forms are positive where they block: the origin is behind
    // them, or the direction leads through them.
    flip = hn::And(turn, hn::SignBit(d));
    plane = Turned(plane);
    const V common1 = Norm1V(common);
    for (int e = 0; e < 3; ++e) {
      const V3 apex = e == 0 ? first_apex : SubV(corner[e], common);
      edge[e] = Turned(kParallel ? CrossV(along[e], common) : CrossV(apex, along[e]));
      edge_bound[e] =
          hn::MulAdd(units, hn::Mul(kParallel ? common1 : Norm1V(apex), along1[e]), underflow);
    }
  }

  // P-O or A-P, for an edge; P-A or A-P, for the plane.
  HWY_INLINE V3 AtEdge(int e, const V3& p) const {
    return kParallel ? SubV(corner[e], p) : SubV(p, origin);
  }
  HWY_INLINE V3 AtPlane(const V3& p) const {
    return kParallel ? SubV(corner[0], p) : SubV(p, corner[0]);
  }

  V3 origin, corner[3], edge[3], plane;
  V edge_bound[3], plane_bound, turn, turn_bound;
  V flip;  // A sign.

 private:
  HWY_INLINE V3 Turned(const V3& form) const {
    return {hn::Xor(form.x, flip), hn::Xor(form.y, flip), hn::Xor(form.z, flip)};
  }
};

// Whether form·p is certainly positive over all p between two corners of a box, taken in any order.
HWY_INLINE uint32_t PositiveOver(const Vec3V<ShaftV>& form, ShaftV form_bound,
                                 const Vec3V<ShaftV>& from, const Vec3V<ShaftV>& to) {
  const ShaftD d;
  const ShaftV bound =
      hn::MulAdd(form_bound, hn::Max(NormInfV(from), NormInfV(to)), hn::Set(d, kFloatUnderflow));
  return MaskBits(d, hn::Gt(LeastOver(form, from, to), bound));
}

// Objects are not asked, nor whether a triangle is a ray's own. also(first lane, forms) is called
// for each vector of triangles.
template <bool kParallel, class Also>
HWY_INLINE LeafSides SidesOf(const LeafView& leaf, Vec3f common, const Box3f& box,
                             const Also& also) {
  using V3 = Vec3V<ShaftV>;
  const ShaftD d;
  const V3 from = Broadcast(d, common.x, common.y, common.z);
  V3 lo = Broadcast(d, box.lo.x, box.lo.y, box.lo.z);
  V3 hi = Broadcast(d, box.hi.x, box.hi.y, box.hi.z);
  if constexpr (kParallel) std::swap(lo, hi);  // They are taken from corners.
  LeafSides all;
  for (uint32_t first = 0; first < leaf.count; first += static_cast<uint32_t>(hn::Lanes(d))) {
    const SideForms<kParallel> forms(leaf, first, from);
    const uint32_t left = leaf.count - first;
    const uint32_t lanes = left < hn::Lanes(d) ? (1u << left) - 1 : (1u << hn::Lanes(d)) - 1;
    const uint32_t certain = lanes & MaskBits(d, hn::Gt(hn::Abs(forms.turn), forms.turn_bound));
    for (int e = 0; e < 3; ++e) {
      all.within[e] |=
          PositiveOver(forms.edge[e], forms.edge_bound[e], forms.AtEdge(e, lo), forms.AtEdge(e, hi))
          << first;
    }
    all.beyond |= (certain & PositiveOver(forms.plane, forms.plane_bound, forms.AtPlane(lo),
                                          forms.AtPlane(hi)))
                  << first;
    all.certain |= certain << first;
    all.turned |= MaskBits(d, hn::Lt(forms.turn, hn::Zero(d))) << first;
    also(first, forms);
  }
  return all;
}

// Triangles that block all, and those that would, were it not for one edge.
struct LeafCovers {
  explicit LeafCovers(const LeafSides& sides) : turned(sides.turned) {
    const auto& within = sides.within;
    whole = sides.beyond & within[0] & within[1] & within[2];
    for (int e = 0; e < 3; ++e) {
      but_edge[e] = sides.beyond & within[(e + 1) % 3] & within[(e + 2) % 3] & ~within[e];
    }
  }

  uint32_t whole;        // Some may be missing.
  uint32_t but_edge[3];  // By that edge's first corner.
  uint32_t turned;
};

// Another triangle that blocks what triangle i does not, as far as it is edge `e` alone that keeps
// i from blocking all: one that has the same edge, lies on its other side and is kept by it alone,
// too. A point's sides of that edge are each other's contrary for the two, to the last bit, and
// where it lies on neither both block it (watertight; paper 002's triangles that share an edge).
inline uint32_t OtherSide(const LeafView& leaf, const LeafCovers& covers, uint32_t i, int e) {
  const Vec3f from = leaf.corner(e, i), to = leaf.corner((e + 1) % 3, i);
  for (int f = 0; f < 3; ++f) {
    for (uint32_t left = covers.but_edge[f] & ~(1u << i); left != 0; left &= left - 1) {
      const uint32_t j = std::countr_zero(left);
      const bool alike = (covers.turned >> i & 1) == (covers.turned >> j & 1);
      const Vec3f first = leaf.corner(f, j), second = leaf.corner((f + 1) % 3, j);
      if (alike ? from == second && to == first : from == first && to == second) return j;
    }
  }
  return kMaxLeafTriangles;
}

HWY_INLINE bool Holds(std::span<const uint32_t> row, uint32_t value) {
  const hn::RebindToUnsigned<ShaftD> d;
  auto any = hn::FirstN(d, 0);
  size_t i = 0;
  for (; i + hn::Lanes(d) <= row.size(); i += hn::Lanes(d)) {
    any = hn::Or(any, hn::Eq(hn::LoadU(d, row.data() + i), hn::Set(d, value)));
  }
  for (; i < row.size(); ++i) {
    if (row[i] == value) return true;
  }
  return !hn::AllFalse(d, any);
}

// As CoverPointsFn says.
template <bool kParallel>
bool CoverPoints(const IndexedGeometry& scene, ChildRef leaf_ref, Vec3f common,
                 uint32_t common_source, uint32_t mask, const Box3f& box,
                 std::span<const uint32_t> sources, WalkStats* stats) {
  SIGHTLINE_DCHECK(scene.bvh.HoldsLeaf(leaf_ref)) << "leaf " << leaf_ref.bits();
  if (box.empty() || MustAskObjects(scene.geometry, mask)) return false;
  const LeafView leaf(scene, leaf_ref);
  ++stats->leaves;
  stats->shaft.triangles += leaf.count;
  const auto may_block = [&](uint32_t i) {
    return leaf.id(i) != common_source && !Holds(sources, leaf.id(i));
  };
  const auto answer = [&](uint32_t relevant) {
    stats->shaft.relevant += relevant;
    return true;
  };
  const LeafCovers covers(
      SidesOf<kParallel>(leaf, common, box, [](uint32_t, const auto&) HWY_ATTR {}));
  for (uint32_t left = covers.whole; left != 0; left &= left - 1) {
    if (may_block(std::countr_zero(left))) return answer(1);
  }
  for (int e = 0; e < 3; ++e) {
    for (uint32_t left = covers.but_edge[e]; left != 0; left &= left - 1) {
      const uint32_t i = std::countr_zero(left), j = OtherSide(leaf, covers, i, e);
      if (j < kMaxLeafTriangles && may_block(i) && may_block(j)) return answer(2);
    }
  }
  return false;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
