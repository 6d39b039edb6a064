// SPDX-License-Identifier: Apache-2.0
#include "core/intersect/intersector_check.h"

#include <cmath>
#include <limits>

#include "core/base/check.h"
#include "core/intersect/intersector-inl.h"

namespace sightline {
namespace {

namespace simd = HWY_NAMESPACE;  // The baseline's, of which only scalar code is used.

constexpr double kUnit = 0x1p-24;
constexpr double kUnderflow = 0x1p-150;
constexpr double kEnlarge = 1 + 0x1p-40;
constexpr double kNoBound = std::numeric_limits<double>::infinity();

// A float and a bound of its error (intersector_check.h).
struct Tracked {
  float x = 0;
  double e = 0;
};

// A comparison's outcome as floats have it, and whether no error within the bounds changes it.
struct Verdict {
  bool value = false;
  bool certain = false;
};

Tracked Rounded(float x, double e) {
  if (!std::isfinite(x) || !(e >= 0)) return {x, kNoBound};
  return {x, e * kEnlarge};
}

struct TrackedOps {
  using V = Tracked;
  using M = Verdict;
  static V Set(float x) { return {x, 0}; }
  static V Add(V a, V b) {
    const float x = a.x + b.x;
    return Rounded(x, a.e + b.e + kUnit * std::abs(static_cast<double>(x)));
  }
  static V Sub(V a, V b) { return Add(a, Neg(b)); }
  static V Mul(V a, V b) {
    const float x = a.x * b.x;
    // An endless ray's t_max, times a determinant whose sign is known.
    if (b.e == 0 && std::isinf(b.x)) return {x, std::abs(a.x) > a.e ? 0 : kNoBound};
    const double da = std::abs(static_cast<double>(a.x)), db = std::abs(static_cast<double>(b.x));
    return Rounded(
        x, da * b.e + db * a.e + a.e * b.e + kUnit * std::abs(static_cast<double>(x)) + kUnderflow);
  }
  static V Div(V a, V b) {
    const float x = a.x / b.x;
    const double room = std::abs(static_cast<double>(b.x)) - b.e;
    if (!(room > 0)) return {x, kNoBound};
    const double quotient = std::abs(static_cast<double>(a.x) / static_cast<double>(b.x));
    return Rounded(
        x, (a.e + quotient * b.e) / room + kUnit * std::abs(static_cast<double>(x)) + kUnderflow);
  }
  static V Neg(V a) { return {-a.x, a.e}; }
  static V Abs(V a) { return {std::abs(a.x), a.e}; }
  static V Turn(V a, V by) {
    return {std::signbit(by.x) ? -a.x : a.x,
            std::abs(static_cast<double>(by.x)) > by.e ? a.e : kNoBound};
  }
  static M Le(V a, V b) { return {a.x <= b.x, Apart(a, b)}; }
  static M Gt(V a, V b) { return {a.x > b.x, Apart(a, b)}; }
  static M And(M a, M b) {
    return {a.value && b.value,
            (a.certain && b.certain) || (a.certain && !a.value) || (b.certain && !b.value)};
  }
  // Only certainty ends a test, so that the result is known as well as it can be.
  static bool None(M m) { return m.certain && !m.value; }

 private:
  static bool Apart(V a, V b) {
    const double errors = a.e + b.e;
    return std::isfinite(errors) &&
           std::abs(static_cast<double>(b.x) - static_cast<double>(a.x)) > errors * kEnlarge;
  }
};

using Vec3t = simd::Vec3V<Tracked>;

Vec3t Exact(Vec3f v) { return {{v.x, 0}, {v.y, 0}, {v.z, 0}}; }

Vec3t Turned(const Vec3t& v, int axis) {
  return axis == 0 ? Vec3t{v.y, v.z, v.x} : axis == 1 ? Vec3t{v.z, v.x, v.y} : v;
}

struct Rows {
  const Tracked* value;
  Tracked operator()(int i) const { return value[i]; }
};

template <Intersector kKind>
simd::Tested<TrackedOps> Run(const Tracked* rows, const simd::TestedRay<TrackedOps>& ray) {
  return simd::Test<kKind, TrackedOps>(Rows{rows}, ray);
}

}  // namespace

IntersectorCheck CheckIntersector(Intersector intersector, const PredicateRay& ray, Vec3f a,
                                  Vec3f b, Vec3f c) {
  SIGHTLINE_CHECK(intersector != Intersector::kExact) << "the predicate has no error";
  const PreparedTriangle prepared = PrepareTriangle(intersector, a, b, c);
  const bool projects = intersector == Intersector::kWald || intersector == Intersector::kShevtsov;
  const int axis = projects ? static_cast<int>(prepared.value[kPreparedAxis]) : 2;
  Tracked rows[kPreparedFloats];
  simd::Prepare<TrackedOps>(intersector, axis, Exact(a), Exact(b), Exact(c), rows);

  Vec3t direction = Exact(ray.RoundedDirection());
  if (ray.segment) {
    for (Tracked* const d : {&direction.x, &direction.y, &direction.z}) {
      d->e = kUnit * std::abs(static_cast<double>(d->x));
    }
  }
  const float t_max = ray.segment ? 1.0f : std::numeric_limits<float>::infinity();
  const simd::TestedRay<TrackedOps> tracked = {
      Turned(Exact(ray.origin), axis), Turned(direction, axis), {t_max, 0}};
  simd::Tested<TrackedOps> r;
  switch (intersector) {
    case Intersector::kHavelHerout:
    case Intersector::kHavelHeroutDotProduct:  // The same operations, in the same order.
      r = Run<Intersector::kHavelHerout>(rows, tracked);
      break;
    case Intersector::kHavelHeroutDivided:
      r = Run<Intersector::kHavelHeroutDivided>(rows, tracked);
      break;
    case Intersector::kWald:
      r = Run<Intersector::kWald>(rows, tracked);
      break;
    case Intersector::kShevtsov:
      r = Run<Intersector::kShevtsov>(rows, tracked);
      break;
    case Intersector::kKenslerShirley:
      r = Run<Intersector::kKenslerShirley>(rows, tracked);
      break;
    case Intersector::kExact:
    case Intersector::kMoellerTrumbore:
      r = Run<Intersector::kMoellerTrumbore>(rows, tracked);
      break;
  }
  IntersectorCheck check;
  check.hit = r.hit.value;
  check.certain = r.hit.certain;
  if (check.hit) {
    check.at = {r.t.x, r.u.x, r.v.x};
    check.t_error = r.t.e;
    check.u_error = r.u.e;
    check.v_error = r.v.e;
  }
  return check;
}

}  // namespace sightline
