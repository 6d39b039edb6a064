// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/papers/intersector_passes.h"

#include <bit>
#include <limits>

#include "core/base/check.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/bench/papers/intersector_passes.cc"
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

constexpr float kFar = std::numeric_limits<float>::infinity();

template <Intersector kKind, bool kWorst>
uint64_t PassOne(const bench::PassData& data) {
  uint64_t hits = 0;
  for (size_t r = 0; r < data.origins.size(); ++r) {
    const Vec3f o = data.origins[r], d = data.directions[r];
    float nearest = kFar;
    for (size_t i = 0; i < data.triangles.size(); ++i) {
      const auto test = TestOne<kKind>(data.triangles.data()[i].value, o, d, nearest);
      if (!test.hit) continue;
      ++hits;
      if (!kWorst) nearest = test.t;
    }
  }
  return hits;
}

template <bool kWorst>
uint64_t PassDotProduct(const bench::PassData& data) {
  uint64_t hits = 0;
  for (size_t r = 0; r < data.origins.size(); ++r) {
    const DotProductRay ray = DotProductRay::Make(data.origins[r], data.directions[r]);
    float nearest = kFar;
    for (size_t i = 0; i < data.triangles.size(); ++i) {
      const auto test = TestByDotProducts(data.triangles.data()[i].value, ray, nearest);
      if (!test.hit) continue;
      ++hits;
      if (!kWorst) nearest = test.t;
    }
  }
  return hits;
}

template <Intersector kKind, class D, bool kWorst>
uint64_t PassTriangles(const bench::PassData& data) {
  const D d;
  PreparedTriangles triangles = {{}, data.triangles.size()};
  for (int k = 0; k < kPreparedFloats; ++k) triangles.value[k] = data.triangle_rows[k].data();
  uint64_t hits = 0;
  for (size_t r = 0; r < data.origins.size(); ++r) {
    const Vec3f o = data.origins[r], dir = data.directions[r];
    float nearest = kFar;
    for (size_t i = 0; i < triangles.count; i += hn::Lanes(d)) {
      const auto test = TestTrianglesInLanes<kKind, D>(triangles, i, o, dir, nearest);
      if (hn::AllFalse(d, test.hit)) continue;
      hits += hn::CountTrue(d, test.hit);
      if (kWorst) continue;
      nearest = hn::GetLane(hn::MinOfLanes(d, hn::IfThenElse(test.hit, test.t, hn::Set(d, kFar))));
    }
  }
  return hits;
}

template <Intersector kKind, class D, bool kWorst>
uint64_t PassRays(const bench::PassData& data) {
  const D d;
  const auto row = [&](int k) { return data.ray_rows[k].data(); };
  const IntersectorRays rays = {
      {row(0), row(1), row(2)}, {row(3), row(4), row(5)}, nullptr, data.origins.size()};
  uint64_t hits = 0;
  for (size_t r = 0; r < rays.count; r += hn::Lanes(d)) {
    auto nearest = hn::Set(d, kFar);
    for (size_t i = 0; i < data.triangles.size(); ++i) {
      const auto test = TestRaysInLanes<kKind, D>(data.triangles.data()[i].value, rays, r, nearest);
      if (hn::AllFalse(d, test.hit)) continue;
      hits += hn::CountTrue(d, test.hit);
      if (!kWorst) nearest = hn::IfThenElse(test.hit, test.t, nearest);
    }
  }
  return hits;
}

template <Intersector kKind, bool kWorst>
uint64_t PassOfKind(const bench::PassSpec& spec, const bench::PassData& data) {
  using bench::PassForm;
  if (spec.form == PassForm::kOne) {
    // The ray is laid out once, as the paper has it.
    if constexpr (kKind == Intersector::kHavelHeroutDotProduct) return PassDotProduct<kWorst>(data);
    return PassOne<kKind, kWorst>(data);
  }
#if HWY_TARGET == HWY_AVX3
  using D = hn::CappedTag<float, 16>;
  return spec.form == PassForm::kRays ? PassRays<kKind, D, kWorst>(data)
                                      : PassTriangles<kKind, D, kWorst>(data);
#else
  using D4 = hn::CappedTag<float, 4>;
  using D8 = hn::CappedTag<float, 8>;
  if (spec.form == PassForm::kRays) {
    return spec.lanes == 4 ? PassRays<kKind, D4, kWorst>(data) : PassRays<kKind, D8, kWorst>(data);
  }
  return spec.lanes == 4 ? PassTriangles<kKind, D4, kWorst>(data)
                         : PassTriangles<kKind, D8, kWorst>(data);
#endif
}

template <Intersector kKind>
uint64_t PassOfSpec(const bench::PassSpec& spec, const bench::PassData& data) {
  return spec.worst ? PassOfKind<kKind, true>(spec, data) : PassOfKind<kKind, false>(spec, data);
}

uint64_t AnyPass(const bench::PassSpec& spec, const bench::PassData& data) {
  switch (spec.kind) {
    case Intersector::kHavelHerout:
      return PassOfSpec<Intersector::kHavelHerout>(spec, data);
    case Intersector::kHavelHeroutDivided:
      return PassOfSpec<Intersector::kHavelHeroutDivided>(spec, data);
    case Intersector::kWald:
      return PassOfSpec<Intersector::kWald>(spec, data);
    case Intersector::kShevtsov:
      return PassOfSpec<Intersector::kShevtsov>(spec, data);
    case Intersector::kKenslerShirley:
      return PassOfSpec<Intersector::kKenslerShirley>(spec, data);
    case Intersector::kHavelHeroutDotProduct:
      return PassOfSpec<Intersector::kHavelHeroutDotProduct>(spec, data);
    case Intersector::kMoellerTrumbore:
    case Intersector::kExact:
      break;
  }
  return PassOfSpec<Intersector::kMoellerTrumbore>(spec, data);
}

// kHavelHerout, triangles in lanes; corners are gathered as they lie.
template <class D>
uint64_t PrepareInLanes(const bench::PassData& data) {
  const D d;
  using V = hn::Vec<D>;
  HWY_ALIGN float rows[9][hn::MaxLanes(D())];
  HWY_ALIGN float out[hn::MaxLanes(D())];
  uint64_t sum = 0;
  for (size_t first = 0; first < data.triangles.size(); first += hn::Lanes(d)) {
    for (size_t i = 0; i < hn::Lanes(d); ++i) {
      const Vec3f* const corners = data.corners.data() + 3 * (first + i);
      for (int c = 0; c < 3; ++c) {
        for (int k = 0; k < 3; ++k) rows[3 * c + k][i] = corners[c][k];
      }
    }
    const auto corner = [&](int c) HWY_ATTR -> Vec3V<V> {
      return {hn::Load(d, rows[3 * c]), hn::Load(d, rows[3 * c + 1]), hn::Load(d, rows[3 * c + 2])};
    };
    V prepared[kPreparedFloats];
    Prepare<LaneOps<D>>(Intersector::kHavelHerout, 0, corner(0), corner(1), corner(2), prepared);
    for (const V& row : prepared) {
      hn::Store(row, d, out);
      sum += std::bit_cast<uint32_t>(out[first % hn::Lanes(d)]);
    }
  }
  return sum;
}

uint64_t PrepareLanes(int lanes, const bench::PassData& data) {
#if HWY_TARGET == HWY_AVX3
  (void)lanes;
  return PrepareInLanes<hn::CappedTag<float, 16>>(data);
#else
  return lanes == 4 ? PrepareInLanes<hn::CappedTag<float, 4>>(data)
                    : PrepareInLanes<hn::CappedTag<float, 8>>(data);
#endif
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline::bench {

PassData MakePassData(Intersector kind, const std::vector<std::array<Vec3f, 3>>& triangles,
                      const std::vector<Vec3f>& origins, const std::vector<Vec3f>& directions) {
  SIGHTLINE_CHECK(triangles.size() % 16 == 0 && origins.size() % 16 == 0);
  PassData data;
  data.origins = origins;
  data.directions = directions;
  for (const auto& [a, b, c] : triangles) {
    data.triangles.push_back(PrepareTriangle(kind, a, b, c));
    for (const Vec3f corner : {a, b, c}) data.corners.push_back(corner);
  }
  for (int k = 0; k < kPreparedFloats; ++k) {
    for (const PreparedTriangle& t : data.triangles) data.triangle_rows[k].push_back(t.value[k]);
  }
  for (int k = 0; k < 3; ++k) {
    for (const Vec3f o : origins) data.ray_rows[k].push_back(o[k]);
    for (const Vec3f d : directions) data.ray_rows[3 + k].push_back(d[k]);
  }
  return data;
}

bool HasLanes(int lanes) {
  static const auto supported = hwy::SupportedTargets();  // Asks the CPU, which takes its time.
  return lanes == 4 || lanes == 8 || (lanes == 16 && (supported & HWY_AVX3) != 0);
}

uint64_t RunPass(const PassSpec& spec, const PassData& data) {
  if (spec.lanes == 16) return N_AVX3::AnyPass(spec, data);
  return N_AVX2::AnyPass(spec, data);
}

uint64_t RunPreparation(Intersector kind, int lanes, const PassData& data) {
  if (lanes == 16) return N_AVX3::PrepareLanes(lanes, data);
  if (lanes > 1) return N_AVX2::PrepareLanes(lanes, data);
  uint64_t sum = 0;
  for (size_t i = 0; i < data.triangles.size(); ++i) {
    const Vec3f* const corners = data.corners.data() + 3 * i;
    const PreparedTriangle t = PrepareTriangle(kind, corners[0], corners[1], corners[2]);
    sum += std::bit_cast<uint32_t>(t.value[i % kPreparedFloats]);
  }
  return sum;
}

}  // namespace sightline::bench
#endif  // HWY_ONCE
