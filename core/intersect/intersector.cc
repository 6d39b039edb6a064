// SPDX-License-Identifier: Apache-2.0
#include "core/intersect/intersector.h"

#include <limits>
#include <string>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "core/base/check.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/intersect/intersector.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: this comes before everything that is compiled once per target.
#include "hwy/foreach_target.h"
// clang-format on

#include "core/intersect/intersector-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

// Calls f with the intersector as a constant.
template <class F>
auto WithIntersector(Intersector kind, const F& f) {
  switch (kind) {
    case Intersector::kHavelHerout:
      return f(std::integral_constant<Intersector, Intersector::kHavelHerout>());
    case Intersector::kHavelHeroutDivided:
      return f(std::integral_constant<Intersector, Intersector::kHavelHeroutDivided>());
    case Intersector::kWald:
      return f(std::integral_constant<Intersector, Intersector::kWald>());
    case Intersector::kShevtsov:
      return f(std::integral_constant<Intersector, Intersector::kShevtsov>());
    case Intersector::kKenslerShirley:
      return f(std::integral_constant<Intersector, Intersector::kKenslerShirley>());
    case Intersector::kHavelHeroutDotProduct:
      return f(std::integral_constant<Intersector, Intersector::kHavelHeroutDotProduct>());
    case Intersector::kExact:
      SIGHTLINE_CHECK(kind != Intersector::kExact) << "the predicate has no prepared triangles";
      break;
    case Intersector::kMoellerTrumbore:
      break;
  }
  return f(std::integral_constant<Intersector, Intersector::kMoellerTrumbore>());
}

bool IntersectOne(Intersector kind, const PreparedTriangle& triangle, Vec3f o, Vec3f d, float t_max,
                  IntersectorHit* hit) {
  return WithIntersector(kind, [&](auto constant) HWY_ATTR {
    const auto r = TestOne<constant()>(triangle.value, o, d, t_max);
    if (r.hit) *hit = {r.t, r.u, r.v};
    return r.hit;
  });
}

// Lanes first .. first + lanes, as far as there are.
template <class D>
HWY_INLINE void StoreHits(const Tested<LaneOps<D>>& r, size_t first, size_t count,
                          const IntersectorHits& hits) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  HWY_ALIGN float t[hn::MaxLanes(D())], u[hn::MaxLanes(D())], v[hn::MaxLanes(D())];
  const uint32_t bits = MaskBits(d, r.hit);
  hn::Store(r.t, d, t);
  hn::Store(r.u, d, u);
  hn::Store(r.v, d, v);
  for (size_t i = 0; i < lanes && first + i < count; ++i) {
    hits.hit[first + i] = (bits >> i) & 1;
    if (hits.hit[first + i] == 0) continue;
    hits.t[first + i] = t[i];
    hits.u[first + i] = u[i];
    hits.v[first + i] = v[i];
  }
}

void IntersectRaysInLanes(Intersector kind, const PreparedTriangle& triangle,
                          const IntersectorRays& rays, const IntersectorHits& hits) {
  using D = hn::CappedTag<float, kMaxIntersectorLanes>;
  const D d;
  WithIntersector(kind, [&](auto constant) HWY_ATTR {
    for (size_t i = 0; i < rays.count; i += hn::Lanes(d)) {
      StoreHits<D>(
          TestRaysInLanes<constant(), D>(triangle.value, rays, i, hn::LoadU(d, rays.t_max + i)), i,
          rays.count, hits);
    }
    return true;
  });
}

void IntersectTrianglesInLanes(Intersector kind, const PreparedTriangles& triangles, Vec3f origin,
                               Vec3f direction, float t_max, const IntersectorHits& hits) {
  using D = hn::CappedTag<float, kMaxIntersectorLanes>;
  const D d;
  WithIntersector(kind, [&](auto constant) HWY_ATTR {
    for (size_t i = 0; i < triangles.count; i += hn::Lanes(d)) {
      StoreHits<D>(TestTrianglesInLanes<constant(), D>(triangles, i, origin, direction, t_max), i,
                   triangles.count, hits);
    }
    return true;
  });
}

void PrepareOne(Intersector kind, Vec3f a, Vec3f b, Vec3f c, PreparedTriangle* out) {
  // The axis along which the triangle's shadow is largest; the first of equals.
  const Vec3f n = Cross(b - a, c - a);
  const float x = std::abs(n.x), y = std::abs(n.y), z = std::abs(n.z);
  const int axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
  Prepare<ScalarOps<float>>(kind, axis, {a.x, a.y, a.z}, {b.x, b.y, b.z}, {c.x, c.y, c.z},
                            out->value);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline {
namespace {

constexpr std::array<std::pair<Intersector, absl::string_view>, 8> kNames = {{
    {Intersector::kExact, "EXACT"},
    {Intersector::kHavelHerout, "HAVEL_HEROUT"},
    {Intersector::kHavelHeroutDivided, "HAVEL_HEROUT_DIVIDED"},
    {Intersector::kWald, "WALD"},
    {Intersector::kShevtsov, "SHEVTSOV"},
    {Intersector::kKenslerShirley, "KENSLER_SHIRLEY"},
    {Intersector::kMoellerTrumbore, "MOELLER_TRUMBORE"},
    {Intersector::kHavelHeroutDotProduct, "HAVEL_HEROUT_DOT_PRODUCT"},
}};

bool Wide() {
  static const bool wide = (hwy::SupportedTargets() & HWY_AVX3) != 0;
  return wide;
}

}  // namespace

absl::string_view IntersectorName(Intersector intersector) {
  for (const auto& [kind, name] : kNames) {
    if (kind == intersector) return name;
  }
  return "UNKNOWN";
}

absl::StatusOr<Intersector> ParseIntersector(absl::string_view name) {
  std::string names;
  for (const auto& [kind, text] : kNames) {
    if (absl::EqualsIgnoreCase(name, text)) return kind;
    absl::StrAppend(&names, names.empty() ? "" : ", ", text);
  }
  return absl::InvalidArgumentError(
      absl::StrCat("unknown intersector '", name, "'; there are ", names));
}

PreparedTriangle PrepareTriangle(Intersector intersector, Vec3f a, Vec3f b, Vec3f c) {
  SIGHTLINE_DCHECK(intersector != Intersector::kExact);
  PreparedTriangle prepared;
  N_AVX2::PrepareOne(intersector, a, b, c, &prepared);
  return prepared;
}

bool Intersect(Intersector intersector, const PreparedTriangle& triangle, Vec3f origin,
               Vec3f direction, float t_max, IntersectorHit* hit) {
  return N_AVX2::IntersectOne(intersector, triangle, origin, direction, t_max, hit);
}

bool IntersectRay(Intersector intersector, const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c,
                  IntersectorHit* hit) {
  return Intersect(intersector, PrepareTriangle(intersector, a, b, c), ray.origin,
                   ray.RoundedDirection(),
                   ray.segment ? 1.0f : std::numeric_limits<float>::infinity(), hit);
}

void IntersectRays(Intersector intersector, const PreparedTriangle& triangle,
                   const IntersectorRays& rays, const IntersectorHits& hits) {
  Wide() ? N_AVX3::IntersectRaysInLanes(intersector, triangle, rays, hits)
         : N_AVX2::IntersectRaysInLanes(intersector, triangle, rays, hits);
}

void IntersectTriangles(Intersector intersector, const PreparedTriangles& triangles, Vec3f origin,
                        Vec3f direction, float t_max, const IntersectorHits& hits) {
  Wide()
      ? N_AVX3::IntersectTrianglesInLanes(intersector, triangles, origin, direction, t_max, hits)
      : N_AVX2::IntersectTrianglesInLanes(intersector, triangles, origin, direction, t_max, hits);
}

}  // namespace sightline
#endif  // HWY_ONCE
