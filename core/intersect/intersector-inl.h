// SPDX-License-Identifier: Apache-2.0
//
// The papers' ray-triangle tests (intersector.h), each written once for whatever holds a number: a
// float, a double, a register of floats, or a float with a bound of its error
// (intersector_check.cc). The kind of number is an Ops class: V, M (what a comparison gives) and
// the operations. Rows are read through a functor p(i), so that a test that ends early has not
// loaded them.
//
// A test ends as soon as no lane can hit: after t, after u, as the papers' do. Without kEdges it
// ends after t in any case: the rays are known to pass within the triangle's edges, and weights are
// not wanted.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_INTERSECT_INTERSECTOR_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_INTERSECT_INTERSECTOR_INL_H_
#undef SIGHTLINE_CORE_INTERSECT_INTERSECTOR_INL_H_
#else
#define SIGHTLINE_CORE_INTERSECT_INTERSECTOR_INL_H_
#endif

#include <immintrin.h>

#include <cmath>
#include <limits>

#include "core/geometry/vec3.h"
#include "core/intersect/intersector.h"
#include "core/intersect/predicate-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// ---- Kinds of numbers

template <class T>
struct ScalarOps {
  using V = T;
  using M = bool;
  static HWY_INLINE V Set(float x) { return static_cast<V>(x); }
  static HWY_INLINE V Add(V a, V b) { return a + b; }
  static HWY_INLINE V Sub(V a, V b) { return a - b; }
  static HWY_INLINE V Mul(V a, V b) { return a * b; }
  static HWY_INLINE V Div(V a, V b) { return a / b; }
  static HWY_INLINE V Neg(V a) { return -a; }
  static HWY_INLINE V Abs(V a) { return std::abs(a); }
  // `a`, turned by the sign of `by`.
  static HWY_INLINE V Turn(V a, V by) { return std::signbit(by) ? -a : a; }
  static HWY_INLINE M Le(V a, V b) { return a <= b; }
  static HWY_INLINE M Gt(V a, V b) { return a > b; }
  static HWY_INLINE M And(M a, M b) { return a && b; }
  static HWY_INLINE bool None(M m) { return !m; }
};

template <class D>
struct LaneOps {
  using V = hn::Vec<D>;
  using M = hn::Mask<D>;
  static HWY_INLINE V Set(float x) { return hn::Set(D(), x); }
  static HWY_INLINE V Add(V a, V b) { return hn::Add(a, b); }
  static HWY_INLINE V Sub(V a, V b) { return hn::Sub(a, b); }
  static HWY_INLINE V Mul(V a, V b) { return hn::Mul(a, b); }
  static HWY_INLINE V Div(V a, V b) { return hn::Div(a, b); }
  static HWY_INLINE V Neg(V a) { return hn::Neg(a); }
  static HWY_INLINE V Abs(V a) { return hn::Abs(a); }
  static HWY_INLINE V Turn(V a, V by) { return hn::Xor(a, hn::And(by, hn::Set(D(), -0.0f))); }
  static HWY_INLINE M Le(V a, V b) { return hn::Le(a, b); }
  static HWY_INLINE M Gt(V a, V b) { return hn::Gt(a, b); }
  static HWY_INLINE M And(M a, M b) { return hn::And(a, b); }
  static HWY_INLINE bool None(M m) { return hn::AllFalse(D(), m); }
};

template <class O>
struct TestedRay {
  Vec3V<typename O::V> o, d;
  typename O::V t_max;
};

template <class O>
struct Tested {
  typename O::M hit;
  typename O::V t, u, v;  // Where hit.
};

// ---- Shared steps

template <class O, class V = typename O::V>
HWY_INLINE V Dot3(const Vec3V<V>& a, const Vec3V<V>& b) {
  return O::Add(O::Add(O::Mul(a.x, b.x), O::Mul(a.y, b.y)), O::Mul(a.z, b.z));
}
template <class O, class V = typename O::V>
HWY_INLINE Vec3V<V> Cross3(const Vec3V<V>& a, const Vec3V<V>& b) {
  return {O::Sub(O::Mul(a.y, b.z), O::Mul(a.z, b.y)), O::Sub(O::Mul(a.z, b.x), O::Mul(a.x, b.z)),
          O::Sub(O::Mul(a.x, b.y), O::Mul(a.y, b.x))};
}
template <class O, class V = typename O::V>
HWY_INLINE Vec3V<V> Sub3(const Vec3V<V>& a, const Vec3V<V>& b) {
  return {O::Sub(a.x, b.x), O::Sub(a.y, b.y), O::Sub(a.z, b.z)};
}
template <class O, class R>
HWY_INLINE Vec3V<typename O::V> Row3(const R& p, int first) {
  return {p(first), p(first + 1), p(first + 2)};
}
// a·b + w with four products' order of sums: (ax bx + ay by) + (az bz + w).
template <class O, class V = typename O::V>
HWY_INLINE V Dot4(const Vec3V<V>& a, const Vec3V<V>& b, V w) {
  return O::Add(O::Add(O::Mul(a.x, b.x), O::Mul(a.y, b.y)), O::Add(O::Mul(a.z, b.z), w));
}
// 0 <= x.
template <class O, class V = typename O::V>
HWY_INLINE typename O::M NotNegative(V x) {
  return O::Le(O::Set(0.0f), x);
}
// -0 becomes +0.
template <class O, class V = typename O::V>
HWY_INLINE V PlainZero(V x) {
  return O::Add(x, O::Set(0.0f));
}

// A distance that is none: with a determinant that all but vanishes the quotient may be +inf, or
// NaN where it is 0 times the reciprocal's +inf. Weights that are divided do not let it through,
// those whose division is deferred do.
template <class O, class V = typename O::V>
HWY_INLINE typename O::M IsFinite(V t) {
  return O::Gt(O::Set(std::numeric_limits<float>::infinity()), t);
}

// The conditions of paper 003's equation (10) on t', u', v' and det, and the division at the end.
// `scaled_u` and `scaled_v` are called when they are needed.
template <class O, bool kEdges, class FU, class FV, class V = typename O::V>
HWY_INLINE Tested<O> DeferredTest(V det, V scaled_t, V t_max, const FU& scaled_u,
                                  const FV& scaled_v) {
  const V size = O::Abs(det);
  const V ts = O::Turn(scaled_t, det);
  Tested<O> r;
  r.t = r.u = r.v = O::Set(0.0f);
  r.hit = O::And(NotNegative<O>(ts), O::Le(ts, O::Mul(size, t_max)));
  if (O::None(r.hit)) return r;
  if constexpr (!kEdges) {
    r.t = PlainZero<O>(O::Mul(scaled_t, O::Div(O::Set(1.0f), det)));
    r.hit = O::And(r.hit, O::And(O::Gt(size, O::Set(0.0f)), IsFinite<O>(r.t)));
    return r;
  }
  const V u = scaled_u();
  const V us = O::Turn(u, det);
  r.hit = O::And(r.hit, O::And(NotNegative<O>(us), O::Le(us, size)));
  if (O::None(r.hit)) return r;
  const V v = scaled_v();
  const V vs = O::Turn(v, det);
  r.hit = O::And(r.hit, O::And(NotNegative<O>(vs), O::Le(O::Add(us, vs), size)));
  r.hit = O::And(r.hit, O::Gt(size, O::Set(0.0f)));
  if (O::None(r.hit)) return r;
  const V reciprocal = O::Div(O::Set(1.0f), det);
  r.t = PlainZero<O>(O::Mul(scaled_t, reciprocal));
  r.hit = O::And(r.hit, IsFinite<O>(r.t));
  r.u = PlainZero<O>(O::Mul(u, reciprocal));
  r.v = PlainZero<O>(O::Mul(v, reciprocal));
  return r;
}

// The conditions of equation (3) on t, u and v, divided already. `det` is only asked whether it is
// zero: 1 / 0 would let t = inf·0 = NaN miss, but t = inf hit.
template <class O, bool kEdges, class FU, class FV, class V = typename O::V>
HWY_INLINE Tested<O> DividedTest(V det, V t, V t_max, const FU& get_u, const FV& get_v) {
  Tested<O> r;
  r.t = r.u = r.v = O::Set(0.0f);
  r.hit = O::And(NotNegative<O>(t), O::Le(t, t_max));
  if (O::None(r.hit)) return r;
  if constexpr (!kEdges) {
    r.hit = O::And(r.hit, O::And(O::Gt(O::Abs(det), O::Set(0.0f)), IsFinite<O>(t)));
    r.t = PlainZero<O>(t);
    return r;
  }
  const V one = O::Set(1.0f);
  const V u = get_u();
  r.hit = O::And(r.hit, O::And(NotNegative<O>(u), O::Le(u, one)));
  if (O::None(r.hit)) return r;
  const V v = get_v();
  r.hit = O::And(r.hit, O::And(NotNegative<O>(v), O::Le(O::Add(u, v), one)));
  r.hit = O::And(r.hit, O::Gt(O::Abs(det), O::Set(0.0f)));
  r.t = PlainZero<O>(t);
  r.u = PlainZero<O>(u);
  r.v = PlainZero<O>(v);
  return r;
}

// ---- Preparing triangles (paper 003: equations 11, 6 and 8)

// Whether the test goes by Havel and Herout's three planes.
constexpr bool HasThreePlanes(Intersector kind) {
  return kind == Intersector::kHavelHerout || kind == Intersector::kHavelHeroutDivided ||
         kind == Intersector::kHavelHeroutDotProduct;
}

// Writes rows 0 .. 8 (or 11) of out. `axis` is r for the projecting tests; the others ignore it.
template <class O, class V = typename O::V>
HWY_INLINE void Prepare(Intersector kind, int axis, const Vec3V<V>& a, const Vec3V<V>& b,
                        const Vec3V<V>& c, V* out) {
  const V zero = O::Set(0.0f);
  for (int i = 0; i < kPreparedFloats; ++i) out[i] = zero;
  const auto put = [out](int at, const Vec3V<V>& v) HWY_ATTR {
    out[at] = v.x;
    out[at + 1] = v.y;
    out[at + 2] = v.z;
  };
  if (kind == Intersector::kKenslerShirley || kind == Intersector::kMoellerTrumbore) {
    put(0, a);
    put(3, b);
    put(6, c);
    return;
  }
  const Vec3V<V> ab = Sub3<O>(b, a), ac = Sub3<O>(c, a);
  if (HasThreePlanes(kind)) {
    const Vec3V<V> n = Cross3<O>(ab, ac);
    const V reciprocal = O::Div(O::Set(1.0f), Dot3<O>(n, n));
    const Vec3V<V> acn = Cross3<O>(ac, n), nab = Cross3<O>(n, ab);
    const Vec3V<V> n1 = {O::Mul(acn.x, reciprocal), O::Mul(acn.y, reciprocal),
                         O::Mul(acn.z, reciprocal)};
    const Vec3V<V> n2 = {O::Mul(nab.x, reciprocal), O::Mul(nab.y, reciprocal),
                         O::Mul(nab.z, reciprocal)};
    put(0, n);
    out[3] = Dot3<O>(a, n);
    put(4, n1);
    out[7] = O::Neg(Dot3<O>(n1, a));
    put(8, n2);
    out[11] = O::Neg(Dot3<O>(n2, a));
    return;
  }
  // p, q, r follow cyclically, so the projected determinant is N's component along r.
  const auto turn = [axis](const Vec3V<V>& v) HWY_ATTR -> Vec3V<V> {
    return axis == 0   ? Vec3V<V>{v.y, v.z, v.x}
           : axis == 1 ? Vec3V<V>{v.z, v.x, v.y}
                       : Vec3V<V>{v.x, v.y, v.z};
  };
  const Vec3V<V> n = turn(Cross3<O>(ab, ac)), ta = turn(a), tab = turn(ab), tac = turn(ac);
  const V reciprocal = O::Div(O::Set(1.0f), n.z);
  const V np = O::Mul(n.x, reciprocal), nq = O::Mul(n.y, reciprocal);
  out[0] = np;
  out[1] = nq;
  out[2] = O::Add(O::Add(O::Mul(ta.x, np), O::Mul(ta.y, nq)), ta.z);
  if (kind == Intersector::kWald) {
    out[3] = O::Mul(tac.y, reciprocal);
    out[4] = O::Neg(O::Mul(tac.x, reciprocal));
    out[5] = O::Mul(O::Sub(O::Mul(ta.y, tac.x), O::Mul(ta.x, tac.y)), reciprocal);
    out[6] = O::Neg(O::Mul(tab.y, reciprocal));
    out[7] = O::Mul(tab.x, reciprocal);
    out[8] = O::Mul(O::Sub(O::Mul(ta.x, tab.y), O::Mul(ta.y, tab.x)), reciprocal);
  } else {
    out[3] = ta.x;
    out[4] = ta.y;
    out[5] = O::Mul(tab.x, reciprocal);
    out[6] = O::Mul(tab.y, reciprocal);
    out[7] = O::Mul(tac.x, reciprocal);
    out[8] = O::Mul(tac.y, reciprocal);
  }
  out[kPreparedAxis] = O::Set(static_cast<float>(axis));
}

// ---- The tests. For the projecting ones the ray's axes are turned to p, q, r.

template <class O, bool kDeferred, bool kEdges, class R, class V = typename O::V>
HWY_INLINE Tested<O> TestHavelHerout(const R& p, const TestedRay<O>& ray) {
  const Vec3V<V> n = Row3<O>(p, 0);
  const V det = Dot3<O>(ray.d, n);
  // d - O·N in the order of the dot-product instruction on (-nx, -ny, -nz, d) and (ox, oy, oz, 1).
  const V scaled_t = O::Sub(O::Sub(p(3), O::Mul(n.z, ray.o.z)),
                            O::Add(O::Mul(n.x, ray.o.x), O::Mul(n.y, ray.o.y)));
  if constexpr (kDeferred) {
    const auto point = [&]() HWY_ATTR -> Vec3V<V> {
      return {O::Add(O::Mul(ray.o.x, det), O::Mul(scaled_t, ray.d.x)),
              O::Add(O::Mul(ray.o.y, det), O::Mul(scaled_t, ray.d.y)),
              O::Add(O::Mul(ray.o.z, det), O::Mul(scaled_t, ray.d.z))};
    };
    return DeferredTest<O, kEdges>(
        det, scaled_t, ray.t_max,
        [&]() HWY_ATTR { return Dot4<O>(point(), Row3<O>(p, 4), O::Mul(det, p(7))); },
        [&]() HWY_ATTR { return Dot4<O>(point(), Row3<O>(p, 8), O::Mul(det, p(11))); });
  } else {
    const V t = O::Mul(scaled_t, O::Div(O::Set(1.0f), det));
    const auto point = [&]() HWY_ATTR -> Vec3V<V> {
      return {O::Add(ray.o.x, O::Mul(t, ray.d.x)), O::Add(ray.o.y, O::Mul(t, ray.d.y)),
              O::Add(ray.o.z, O::Mul(t, ray.d.z))};
    };
    return DividedTest<O, kEdges>(
        det, t, ray.t_max, [&]() HWY_ATTR { return Dot4<O>(point(), Row3<O>(p, 4), p(7)); },
        [&]() HWY_ATTR { return Dot4<O>(point(), Row3<O>(p, 8), p(11)); });
  }
}

template <class O, bool kEdges, class R, class V = typename O::V>
HWY_INLINE Tested<O> TestWald(const R& p, const TestedRay<O>& ray) {
  const V np = p(0), nq = p(1);
  const V det = O::Add(O::Add(O::Mul(np, ray.d.x), O::Mul(nq, ray.d.y)), ray.d.z);
  const V scaled_t =
      O::Sub(p(2), O::Add(O::Add(O::Mul(np, ray.o.x), O::Mul(nq, ray.o.y)), ray.o.z));
  const V t = O::Mul(scaled_t, O::Div(O::Set(1.0f), det));
  const auto weight = [&](int at) HWY_ATTR {
    const V pp = O::Add(ray.o.x, O::Mul(t, ray.d.x)), pq = O::Add(ray.o.y, O::Mul(t, ray.d.y));
    return O::Add(O::Add(O::Mul(pp, p(at)), O::Mul(pq, p(at + 1))), p(at + 2));
  };
  return DividedTest<O, kEdges>(
      det, t, ray.t_max, [&]() HWY_ATTR { return weight(3); },
      [&]() HWY_ATTR { return weight(6); });
}

template <class O, bool kEdges, class R, class V = typename O::V>
HWY_INLINE Tested<O> TestShevtsov(const R& p, const TestedRay<O>& ray) {
  const V np = p(0), nq = p(1);
  const V det = O::Add(O::Add(O::Mul(np, ray.d.x), O::Mul(nq, ray.d.y)), ray.d.z);
  const V scaled_t =
      O::Sub(p(2), O::Add(O::Add(O::Mul(np, ray.o.x), O::Mul(nq, ray.o.y)), ray.o.z));
  const auto tp = [&]() HWY_ATTR {
    return O::Sub(O::Mul(scaled_t, ray.d.x), O::Mul(det, O::Sub(p(3), ray.o.x)));
  };
  const auto tq = [&]() HWY_ATTR {
    return O::Sub(O::Mul(scaled_t, ray.d.y), O::Mul(det, O::Sub(p(4), ray.o.y)));
  };
  return DeferredTest<O, kEdges>(
      det, scaled_t, ray.t_max,
      [&]() HWY_ATTR { return O::Sub(O::Mul(p(8), tp()), O::Mul(p(7), tq())); },
      [&]() HWY_ATTR { return O::Sub(O::Mul(p(5), tq()), O::Mul(p(6), tp())); });
}

template <class O, bool kEdges, class R, class V = typename O::V>
HWY_INLINE Tested<O> TestKenslerShirley(const R& p, const TestedRay<O>& ray) {
  const Vec3V<V> a = Row3<O>(p, 0);
  const Vec3V<V> ab = Sub3<O>(Row3<O>(p, 3), a), ca = Sub3<O>(a, Row3<O>(p, 6));
  const Vec3V<V> n = Cross3<O>(ca, ab);  // AB × AC.
  const V det = Dot3<O>(n, ray.d);
  const V reciprocal = O::Div(O::Set(1.0f), det);
  const Vec3V<V> oa = Sub3<O>(a, ray.o);
  const V t = O::Mul(Dot3<O>(n, oa), reciprocal);
  const auto across = [&]() HWY_ATTR { return Cross3<O>(ray.d, oa); };
  return DividedTest<O, kEdges>(
      det, t, ray.t_max, [&]() HWY_ATTR { return O::Mul(Dot3<O>(across(), ca), reciprocal); },
      [&]() HWY_ATTR { return O::Mul(Dot3<O>(across(), ab), reciprocal); });
}

template <class O, bool kEdges, class R, class V = typename O::V>
HWY_INLINE Tested<O> TestMoellerTrumbore(const R& p, const TestedRay<O>& ray) {
  const Vec3V<V> a = Row3<O>(p, 0);
  const Vec3V<V> ab = Sub3<O>(Row3<O>(p, 3), a), ac = Sub3<O>(Row3<O>(p, 6), a);
  const Vec3V<V> across = Cross3<O>(ray.d, ac);
  const V det = Dot3<O>(ab, across);
  const V reciprocal = O::Div(O::Set(1.0f), det), one = O::Set(1.0f);
  const Vec3V<V> ao = Sub3<O>(ray.o, a);
  Tested<O> r;
  r.t = r.u = r.v = O::Set(0.0f);
  if constexpr (!kEdges) {
    r.t = PlainZero<O>(O::Mul(Dot3<O>(ac, Cross3<O>(ao, ab)), reciprocal));
    r.hit = O::And(NotNegative<O>(r.t), O::Le(r.t, ray.t_max));
    r.hit = O::And(r.hit, O::And(O::Gt(O::Abs(det), O::Set(0.0f)), IsFinite<O>(r.t)));
    return r;
  }
  r.u = PlainZero<O>(O::Mul(Dot3<O>(ao, across), reciprocal));
  r.hit = O::And(NotNegative<O>(r.u), O::Le(r.u, one));
  if (O::None(r.hit)) return r;
  const Vec3V<V> along = Cross3<O>(ao, ab);
  r.v = PlainZero<O>(O::Mul(Dot3<O>(ray.d, along), reciprocal));
  r.hit = O::And(r.hit, O::And(NotNegative<O>(r.v), O::Le(O::Add(r.u, r.v), one)));
  if (O::None(r.hit)) return r;
  r.t = PlainZero<O>(O::Mul(Dot3<O>(ac, along), reciprocal));
  r.hit = O::And(r.hit, O::And(NotNegative<O>(r.t), O::Le(r.t, ray.t_max)));
  r.hit = O::And(r.hit, O::Gt(O::Abs(det), O::Set(0.0f)));
  return r;
}

// One of the tests by its name. REQUIRES: a projecting test's ray is turned.
template <Intersector kKind, class O, bool kEdges = true, class R>
HWY_INLINE Tested<O> Test(const R& p, const TestedRay<O>& ray) {
  if constexpr (kKind == Intersector::kHavelHerout ||
                kKind == Intersector::kHavelHeroutDotProduct) {
    return TestHavelHerout<O, true, kEdges>(p, ray);
  }
  if constexpr (kKind == Intersector::kHavelHeroutDivided) {
    return TestHavelHerout<O, false, kEdges>(p, ray);
  }
  if constexpr (kKind == Intersector::kWald) return TestWald<O, kEdges>(p, ray);
  if constexpr (kKind == Intersector::kShevtsov) return TestShevtsov<O, kEdges>(p, ray);
  if constexpr (kKind == Intersector::kKenslerShirley) return TestKenslerShirley<O, kEdges>(p, ray);
  if constexpr (kKind == Intersector::kMoellerTrumbore) {
    return TestMoellerTrumbore<O, kEdges>(p, ray);
  }
}

template <Intersector kKind>
inline constexpr bool kProjects = kKind == Intersector::kWald || kKind == Intersector::kShevtsov;

// ---- Rows and rays for the kinds of numbers

template <class O>
struct BroadcastRows {  // One triangle for all lanes.
  const float* value;
  HWY_INLINE typename O::V operator()(int i) const { return O::Set(value[i]); }
};
template <class D>
struct LaneRows {  // A triangle in each lane.
  const PreparedTriangles& triangles;
  size_t first;
  HWY_INLINE hn::Vec<D> operator()(int i) const {
    return hn::LoadU(D(), triangles.value[i] + first);
  }
};

// The vector's components along p, q, r.
HWY_INLINE Vec3f TurnedToAxis(Vec3f v, int axis) {
  return axis == 0 ? Vec3f{v.y, v.z, v.x} : axis == 1 ? Vec3f{v.z, v.x, v.y} : v;
}

// Paper 003, section IV: kHavelHerout with the dot-product instruction. It adds (a + b) + (c + d).
struct DotProductRay {
  __m128 o, d;  // (x, y, z, 1) and (x, y, z, 0).
  static HWY_INLINE DotProductRay Make(Vec3f o, Vec3f d) {
    return {_mm_set_ps(1.0f, o.z, o.y, o.x), _mm_set_ps(0.0f, d.z, d.y, d.x)};
  }
};
// REQUIRES: `value` is a PreparedTriangle's.
HWY_INLINE Tested<ScalarOps<float>> TestByDotProducts(const float* value, const DotProductRay& ray,
                                                      float t_max) {
  const __m128 n = _mm_load_ps(value);
  const __m128 turn = _mm_set_ps(1.0f, -1.0f, -1.0f, -1.0f);
  const __m128 det4 = _mm_dp_ps(n, ray.d, 0x7F);
  const __m128 t4 = _mm_dp_ps(_mm_mul_ps(turn, n), ray.o, 0xFF);
  const auto point = [&]() HWY_ATTR {
    return _mm_add_ps(_mm_mul_ps(ray.o, det4), _mm_mul_ps(t4, ray.d));
  };
  return DeferredTest<ScalarOps<float>, /*kEdges=*/true>(
      _mm_cvtss_f32(det4), _mm_cvtss_f32(t4), t_max,
      [&]() HWY_ATTR { return _mm_cvtss_f32(_mm_dp_ps(point(), _mm_load_ps(value + 4), 0xF1)); },
      [&]() HWY_ATTR { return _mm_cvtss_f32(_mm_dp_ps(point(), _mm_load_ps(value + 8), 0xF1)); });
}

// REQUIRES: `value` is a PreparedTriangle's.
template <Intersector kKind>
HWY_INLINE Tested<ScalarOps<float>> TestOne(const float* value, Vec3f o, Vec3f d, float t_max) {
  using O = ScalarOps<float>;
  if constexpr (kKind == Intersector::kHavelHeroutDotProduct) {
    return TestByDotProducts(value, DotProductRay::Make(o, d), t_max);
  }
  if constexpr (kProjects<kKind>) {
    const int axis = static_cast<int>(value[kPreparedAxis]);
    o = TurnedToAxis(o, axis);
    d = TurnedToAxis(d, axis);
  }
  return Test<kKind, O>(BroadcastRows<O>{value}, {{o.x, o.y, o.z}, {d.x, d.y, d.z}, t_max});
}

// Rays first .. first + lanes of `rays`.
template <Intersector kKind, class D>
HWY_INLINE Tested<LaneOps<D>> TestRaysInLanes(const float* value, const IntersectorRays& rays,
                                              size_t first, hn::Vec<D> t_max) {
  using O = LaneOps<D>;
  const D d;
  int p = 0, q = 1, r = 2;
  if constexpr (kProjects<kKind>) {
    r = static_cast<int>(value[kPreparedAxis]);
    p = r == 2 ? 0 : r + 1;
    q = p == 2 ? 0 : p + 1;
  }
  const auto load = [&](const float* const* row) HWY_ATTR -> Vec3V<hn::Vec<D>> {
    return {hn::LoadU(d, row[p] + first), hn::LoadU(d, row[q] + first),
            hn::LoadU(d, row[r] + first)};
  };
  return Test<kKind, O>(BroadcastRows<O>{value}, {load(rays.origin), load(rays.direction), t_max});
}

template <Intersector kKind, class D>
HWY_INLINE Tested<LaneOps<D>> TestTrianglesInLanes(const PreparedTriangles& triangles, size_t first,
                                                   Vec3f o, Vec3f dir, float t_max) {
  using O = LaneOps<D>;
  const D d;
  TestedRay<O> ray = {Broadcast(d, o.x, o.y, o.z), Broadcast(d, dir.x, dir.y, dir.z),
                      hn::Set(d, t_max)};
  if constexpr (kProjects<kKind>) {
    const auto axis = hn::LoadU(d, triangles.value[kPreparedAxis] + first);
    const auto along_x = hn::Eq(axis, hn::Zero(d)), along_y = hn::Eq(axis, hn::Set(d, 1.0f));
    const auto turn = [&](Vec3V<hn::Vec<D>>* v) HWY_ATTR {
      const auto x = v->x, y = v->y, z = v->z;
      v->x = hn::IfThenElse(along_x, y, hn::IfThenElse(along_y, z, x));
      v->y = hn::IfThenElse(along_x, z, hn::IfThenElse(along_y, x, y));
      v->z = hn::IfThenElse(along_x, x, hn::IfThenElse(along_y, y, z));
    };
    turn(&ray.o);
    turn(&ray.d);
  }
  return Test<kKind, O>(LaneRows<D>{triangles, first}, ray);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
