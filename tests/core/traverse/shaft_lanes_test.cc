// SPDX-License-Identifier: Apache-2.0
//
// What shafts reckon lane by lane: reciprocals against quotients.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/core/traverse/shaft_lanes_test.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: it has to come before what it compiles for every target.
#include "hwy/foreach_target.h"
// clang-format on

#include <cstddef>
#include <span>

#include "core/traverse/shaft_lanes-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

// Whole vectors.
void Invert(std::span<const float> x, float* inverse) {
  const ShaftD d;
  for (size_t i = 0; i < x.size(); i += hn::Lanes(d)) {
    hn::StoreU(InverseOf(hn::LoadU(d, x.data() + i)), d, inverse + i);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>

#include "core/traverse/simd_target.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::AvailableTargets;
using testing_support::ScaledCount;
using testing_support::TestRng;

// As core/shaft/margins.h counts on: depths are between kLeastDepth and what coordinates allow.
TEST(ShaftLanesTest, InversesAreGoodToThreeAndAThirdRoundings) {
  constexpr double kRoundings = 3.3, kRounding = 0x1p-24;
  for (const SimdTarget target : AvailableTargets()) {
    auto* const invert = target == SimdTarget::kAvx512 ? &N_AVX3::Invert : &N_AVX2::Invert;
    TestRng rng;
    double worst = 0;
    for (int64_t i = ScaledCount(100'000); i > 0; --i) {
      std::array<float, 16> x, inverse;
      for (float& value : x) {
        value = std::ldexp(static_cast<float>(rng.Uniform(1, 2)),
                           static_cast<int>(rng.Below(102)) - 60);
      }
      invert(x, inverse.data());
      for (size_t k = 0; k < x.size(); ++k) {
        const double off = std::abs(double{inverse[k]} * double{x[k]} - 1) / kRounding;
        ASSERT_LE(off, kRoundings) << SimdTargetName(target) << ", x = " << x[k];
        worst = std::max(worst, off);
      }
    }
    std::cout << SimdTargetName(target) << ": within " << worst << " roundings\n";
  }
}

}  // namespace
}  // namespace sightline
#endif  // HWY_ONCE
