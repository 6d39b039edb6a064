// SPDX-License-Identifier: Apache-2.0
//
// A triangle and a vector of a shaft's rays: the exact predicate, in the stages that the forms of
// shaft_leaf-inl.h allow. Floats decide nearly always; the side of the plane, and then of the
// edges, is asked of doubles, sixteen points at a time, and what is left of the predicate itself,
// ray by ray.
//
// Thread safety: pure functions of a walk's own state.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_TEST_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_TEST_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_TEST_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_TEST_INL_H_
#endif

#include <bit>
#include <cstdint>

#include "core/intersect/predicate.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/plane_side-inl.h"
#include "core/traverse/shaft_leaf-inl.h"
#include "core/traverse/shaft_rays-inl.h"
#include "core/traverse/trace_ray.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// A pair of a triangle and some rays, numbered as its list has it: those that floats leave in
// doubt, a bit each.
struct PairInDoubt {
  uint32_t pair, rays;
};

// Rays: a shaft's, or what has their Own, Point, common and segments (occluded_packet-inl.h).
template <bool kAny, bool kParallel, class Rays = ShaftRays<kAny, kParallel>>
class ShaftTest {
 public:
  using V = ShaftV;
  using M = ShaftM;

  // Which rays the triangle certainly blocks, which perhaps, and which certainly run within its
  // edges.
  struct Floats {
    M hit, open, inside;
  };

  // Triangles of `leaf`, whose forms are `forms`.
  ShaftTest(const Rays& rays, const LeafView& leaf, const LeafForms& forms)
      : rays_(rays), leaf_(leaf), forms_(forms) {}

  // What floats say of triangle i and the rays from `at` on, kVectors vectors of them: each term of
  // the triangle is fetched once.
  template <size_t kVectors>
  HWY_INLINE void InFloats(uint32_t i, size_t at, Floats (&said)[kVectors]) const {
    const auto term = [i](const float* row) HWY_ATTR { return hn::Set(ShaftD(), row[i]); };
    Ask(term, SomeRays{rays_, at}, said);
  }
  HWY_INLINE Floats InFloats(uint32_t i, size_t at) const {
    Floats said[1];
    InFloats(i, at, said);
    return said[0];
  }

  // What floats say of one ray and a vector of triangles, from `first` on; anything of those that
  // are not relevant.
  HWY_INLINE Floats OfTriangles(size_t lane, uint32_t first) const {
    const auto term = [first](const float* row)
                          HWY_ATTR { return hn::LoadU(ShaftD(), row + first); };
    Floats said[1];
    Ask(term, OneRay{rays_, lane}, said);
    return said[0];
  }

  // Which of the rays `open`, which floats leave in doubt, triangle i blocks. `ray(lane)` is that
  // of a lane, for the predicate.
  template <class Ray>
  HWY_NOINLINE M Settle(uint32_t i, size_t at, M open, const Ray& ray, WalkStats* stats) const {
    const ShaftD d;
    M beyond = open;
    stats->doubt_double += hn::CountTrue(d, open);
    if (HasPlane()) {
      const V plane = PlaneInDoubles(i, at);
      open = hn::And(open, hn::Ge(plane, hn::Zero(d)));
      // Mostly the points lie on the triangle itself, and all is said.
      if (hn::AllFalse(d, open)) return open;
      beyond = hn::Gt(plane, hn::Zero(d));
    }
    const M inside = InFloats(i, at).inside;
    M hit = hn::And(open, hn::And(inside, beyond));
    M in_doubt = hn::AndNot(hit, open);
    if (!hn::AllFalse(d, hn::AndNot(inside, in_doubt))) {
      const V inner = EdgesInDoubles(i, at);
      open = hn::And(open, hn::Or(inside, hn::Ge(inner, hn::Zero(d))));
      hit = hn::And(open, hn::And(beyond, hn::Or(inside, hn::Gt(inner, hn::Zero(d)))));
      in_doubt = hn::AndNot(hit, open);
    }
    uint32_t bits[2] = {MaskBits(d, hit)};
    for (uint32_t doubt = MaskBits(d, in_doubt); doubt != 0; doubt &= doubt - 1) {
      const uint32_t bit = std::countr_zero(doubt);
      PredicateStage stage;
      if (Blocks(ray(static_cast<int>(at + bit)), leaf_.corner(0, i), leaf_.corner(1, i),
                 leaf_.corner(2, i), &stage)) {
        bits[0] |= 1u << bit;
      }
      stats->doubt_exact += stage == PredicateStage::kExact;
    }
    return hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(bits));
  }

 private:
  static constexpr size_t kLanes = hn::MaxLanes(ShaftD());

  // The rays of a test in its vector k: those that follow one another from `at` on, or one.
  struct SomeRays {
    const Rays& rays;
    size_t at;
    HWY_INLINE Vec3V<V> Own(size_t k) const { return rays.Own(at + k * kLanes); }
    HWY_INLINE Vec3V<V> Point(size_t k) const {
      const size_t i = at + k * kLanes;
      return {rays.Point(0, i), rays.Point(1, i), rays.Point(2, i)};
    }
  };
  struct OneRay {
    const Rays& rays;
    size_t lane;
    HWY_INLINE Vec3V<V> Own(size_t) const { return rays.OwnOf(lane); }
    HWY_INLINE Vec3V<V> Point(size_t) const { return rays.PointOf(lane); }
  };

  // What floats say of pairs of a triangle and a ray, lane by lane: term(row) is the triangles'
  // part of a row of forms or corners.
  template <size_t kVectors, class Term, class OfRays>
  HWY_INLINE void Ask(const Term& term, const OfRays& rays, Floats (&said)[kVectors]) const {
    Vec3V<V> v[kVectors];
    V along[kVectors], inner[kVectors];
    for (size_t k = 0; k < kVectors; ++k) {
      v[k] = rays.Own(k);
      InVectorRegisters(&v[k]);
    }
    for (int e = 0; e < 3; ++e) {
      const Vec3V<V> form = Form(term, forms_.edge[e]);
      if constexpr (kParallel) {
        const V offset = term(forms_.edge_offset[e]);
        for (size_t k = 0; k < kVectors; ++k) {
          along[k] = hn::NegMulAdd(form.z, v[k].z, offset);
          along[k] = hn::NegMulAdd(form.y, v[k].y, along[k]);
          along[k] = hn::NegMulAdd(form.x, v[k].x, along[k]);
        }
      } else {
        for (size_t k = 0; k < kVectors; ++k) along[k] = DotV(form, v[k]);
      }
      for (size_t k = 0; k < kVectors; ++k) {
        inner[k] = e == 0 ? along[k] : hn::Min(inner[k], along[k]);
      }
    }
    const V edge_most = term(forms_.edge_most), edge_least = term(forms_.edge_least);
    for (size_t k = 0; k < kVectors; ++k) {
      // Some form is certainly negative; all are certainly positive.
      said[k].open = hn::Ge(inner[k], edge_least);
      said[k].hit = said[k].inside = hn::Gt(inner[k], edge_most);
    }
    if (!HasPlane()) return;
    // From the triangle's own corner, A: a point's side of the plane by this is good to the
    // triangle's own size, not to its distance from the apex. It settles points that lie near it.
    const Vec3V<V> a = Form(term, forms_.corner);
    const Vec3V<V> normal = Form(term, forms_.normal);
    const V plane_most = term(forms_.plane_most), plane_least = term(forms_.plane_least);
    for (size_t k = 0; k < kVectors; ++k) {
      const V plane = DotV(normal, SubV(rays.Point(k), a));
      said[k].open = hn::And(said[k].open, hn::Ge(plane, plane_least));
      said[k].hit = hn::And(said[k].hit, hn::Gt(plane, plane_most));
    }
  }

  template <class Term>
  static HWY_INLINE Vec3V<V> Form(const Term& term, const float (&rows)[3][kMaxLeafTriangles]) {
    return {term(rows[0]), term(rows[1]), term(rows[2])};
  }

  // Whether a hit depends on the side of the triangle's plane that a point is on.
  bool HasPlane() const { return kParallel || rays_.segments(); }

  Vec3V<V> Points(size_t at) const { return SomeRays{rays_, at}.Point(0); }

  // 1 where the plane is passed, -1 where not, 0 where doubles cannot tell.
  HWY_NOINLINE V PlaneInDoubles(uint32_t i, size_t at) const {
    // N·(P-A) is positive where a segment's end is beyond; a parallel ray's origin is before.
    const float turn = forms_.turn[i];
    const Vec3f a = leaf_.corner(0, i);
    return SideInDoubles(ToDouble(leaf_.corner(1, i)) - ToDouble(a),
                         ToDouble(leaf_.corner(2, i)) - ToDouble(a), kParallel ? -turn : turn, &a,
                         Points(at));
  }

  // 1 where a ray runs within all edges, -1 where it passes one outside, 0 where doubles cannot
  // tell. Rays in the plane of a wall leave every edge of the next wall in doubt.
  HWY_NOINLINE V EdgesInDoubles(uint32_t i, size_t at) const {
    const ShaftD d;
    const Vec3f common = rays_.common();
    V inner = hn::Set(d, 1.0f);
    for (int e = 0; e < 3; ++e) {
      const Vec3f from = leaf_.corner(e, i);
      const Vec3d along = ToDouble(leaf_.corner((e + 1) % 3, i)) - ToDouble(from);
      V side;
      if constexpr (kParallel) {
        // (from - P)·(along×D).
        side = SideInDoubles(along, ToDouble(common), -forms_.turn[i], &from, Points(at));
      } else {
        side = SideInDoubles(ToDouble(from) - ToDouble(common), along, forms_.turn[i],
                             rays_.segments() ? &common : nullptr, Points(at));
      }
      inner = hn::Min(inner, side);
    }
    return inner;
  }

  const Rays& rays_;
  const LeafView& leaf_;
  const LeafForms& forms_;
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
