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

#include "core/accel/indexed_geometry.h"
#include "core/base/check.h"
#include "core/geometry/box3.h"
#include "core/intersect/predicate-inl.h"
#include "core/traverse/leaf_corners-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/point_box-inl.h"
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
struct LeafCovers {
  uint32_t whole = 0;         // They block all of them.
  uint32_t but_edge[3] = {};  // Or would, were it not for an edge: that from this corner on.
  uint32_t turned = 0;        // Their corners run the other way about as those rays see them.
};

// By `common`, the origin or, if kParallel, the direction. Objects are not asked, nor whether a
// triangle is a ray's own. Some that block all may be missing.
template <bool kParallel>
HWY_INLINE LeafCovers CoversOf(const LeafView& leaf, Vec3f common, const Box3f& box) {
  using V = ShaftV;
  using V3 = Vec3V<V>;
  const ShaftD d;
  const V units = hn::Set(d, kFloatUnits), underflow = hn::Set(d, kFloatUnderflow);
  const V3 from = Broadcast(d, common.x, common.y, common.z);
  const V3 lo = Broadcast(d, box.lo.x, box.lo.y, box.lo.z);
  const V3 hi = Broadcast(d, box.hi.x, box.hi.y, box.hi.z);
  LeafCovers all;
  for (uint32_t first = 0; first < leaf.count; first += static_cast<uint32_t>(hn::Lanes(d))) {
    const V3 corner[3] = {LeafCorner(leaf, 0, first), LeafCorner(leaf, 1, first),
                          LeafCorner(leaf, 2, first)};
    const V3 along[3] = {SubV(corner[1], corner[0]), SubV(corner[2], corner[1]),
                         SubV(corner[0], corner[2])};
    const V along1[3] = {Norm1V(along[0]), Norm1V(along[1]), Norm1V(along[2])};
    const V3 normal = CrossV(along[0], along[1]);
    const V normal_bound = hn::MulAdd(units, hn::Mul(along1[0], along1[1]), underflow);
    const V3 first_apex = SubV(corner[0], from);
    // Triangles are turned so that their forms are positive where they block: the origin is behind
    // them, or the direction leads through them.
    const V turn = DotV(normal, kParallel ? from : first_apex);
    const V turn_bound =
        hn::MulAdd(normal_bound, NormInfV(kParallel ? from : first_apex), underflow);
    const V flip = hn::And(turn, hn::SignBit(d));
    // Whether form·p is certainly positive over all p between `least` and `most`.
    const auto positive = [d, flip, underflow](const V3& form, V form_bound, const V3& least,
                                               const V3& most) HWY_ATTR {
      const V bound = hn::MulAdd(form_bound, hn::Max(NormInfV(least), NormInfV(most)), underflow);
      const V3 turned = {hn::Xor(form.x, flip), hn::Xor(form.y, flip), hn::Xor(form.z, flip)};
      return MaskBits(d, hn::Gt(LeastOver(turned, least, most), bound));
    };
    uint32_t within[3], beyond = MaskBits(d, hn::Gt(hn::Abs(turn), turn_bound));
    if constexpr (kParallel) {
      // ((B-A)×D)·(A-P) for each edge, N·(A-P): the origins are before the plane.
      const V from1 = Norm1V(from);
      for (int e = 0; e < 3; ++e) {
        within[e] = positive(CrossV(along[e], from),
                             hn::MulAdd(units, hn::Mul(along1[e], from1), underflow),
                             SubV(corner[e], hi), SubV(corner[e], lo));
      }
      beyond &= positive(normal, normal_bound, SubV(corner[0], hi), SubV(corner[0], lo));
    } else {
      // ((A-O)×(B-A))·(P-O) for each edge, N·(P-A): the points are beyond the plane.
      const V3 apex[3] = {first_apex, SubV(corner[1], from), SubV(corner[2], from)};
      for (int e = 0; e < 3; ++e) {
        within[e] = positive(CrossV(apex[e], along[e]),
                             hn::MulAdd(units, hn::Mul(Norm1V(apex[e]), along1[e]), underflow),
                             SubV(lo, from), SubV(hi, from));
      }
      beyond &= positive(normal, normal_bound, SubV(lo, corner[0]), SubV(hi, corner[0]));
    }
    const uint32_t left = leaf.count - first;
    if (left < hn::Lanes(d)) beyond &= (1u << left) - 1;
    all.whole |= (beyond & within[0] & within[1] & within[2]) << first;
    for (int e = 0; e < 3; ++e) {
      all.but_edge[e] |= (beyond & within[(e + 1) % 3] & within[(e + 2) % 3] & ~within[e]) << first;
    }
    all.turned |= MaskBits(d, hn::Lt(turn, hn::Zero(d))) << first;
  }
  return all;
}

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
                 uint32_t common_source, uint32_t mask, std::span<const Vec3f> points,
                 std::span<const uint32_t> sources, WalkStats* stats) {
  SIGHTLINE_DCHECK(scene.bvh.HoldsLeaf(leaf_ref)) << "leaf " << leaf_ref.bits();
  if (points.empty() || MustAskObjects(scene.geometry, mask)) return false;
  const ShaftD d;
  static_assert(sizeof(Vec3f) == 3 * sizeof(float));
  const float* const rows = &points.data()->x;
  PointBox around;
  size_t i = 0;
  for (; i + hn::Lanes(d) <= points.size(); i += hn::Lanes(d)) {
    Vec3V<ShaftV> p;
    hn::LoadInterleaved3(d, rows + 3 * i, p.x, p.y, p.z);
    around.Take(p);
  }
  Box3f box = around.box();
  for (; i < points.size(); ++i) box.Extend(points[i]);
  const LeafView leaf(scene, leaf_ref);
  ++stats->leaves;
  stats->shaft.triangles += leaf.count;
  const auto may_block = [&](uint32_t i) {
    return leaf.id(i) != common_source && !Holds(sources, leaf.id(i));
  };
  const auto answer = [&](uint32_t relevant) {
    stats->shaft.relevant += relevant;
    const size_t blocks = (points.size() + kShaftBlockRays - 1) / kShaftBlockRays;
    stats->shaft.covers += blocks;
    stats->shaft.pairs += blocks;
    return true;
  };
  const LeafCovers covers = CoversOf<kParallel>(leaf, common, box);
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
