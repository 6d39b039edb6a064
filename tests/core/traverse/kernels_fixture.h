// SPDX-License-Identifier: Apache-2.0
//
// A test of the walks that runs once for every instruction set of this machine.
//
// Thread safety: as GoogleTest's fixtures.
//
//   class HullCutTest : public KernelsFixture {};
//   SIGHTLINE_FOR_EACH_TARGET(HullCutTest);
//   TEST_P(HullCutTest, LosesNothing) { kernels().cut_hull(...); }
#ifndef SIGHTLINE_TESTS_CORE_TRAVERSE_KERNELS_FIXTURE_H_
#define SIGHTLINE_TESTS_CORE_TRAVERSE_KERNELS_FIXTURE_H_

#include <string>
#include <vector>

#include "core/traverse/kernels.h"
#include "gtest/gtest.h"

namespace sightline::testing_support {

class KernelsFixture : public testing::TestWithParam<SimdTarget> {
 protected:
  const Kernels& kernels() const { return KernelsFor(GetParam()); }
};

inline std::vector<SimdTarget> AvailableTargets() {
  std::vector<SimdTarget> targets = {SimdTarget::kAvx2};
  if (SimdTargetAvailable(SimdTarget::kAvx512)) targets.push_back(SimdTarget::kAvx512);
  return targets;
}

inline std::string TargetName(const testing::TestParamInfo<SimdTarget>& info) {
  return info.param == SimdTarget::kAvx2 ? "Avx2" : "Avx512";
}

}  // namespace sightline::testing_support

#define SIGHTLINE_FOR_EACH_TARGET(Fixture)                                                        \
  INSTANTIATE_TEST_SUITE_P(Targets, Fixture,                                                      \
                           ::testing::ValuesIn(::sightline::testing_support::AvailableTargets()), \
                           ::sightline::testing_support::TargetName)

#endif  // SIGHTLINE_TESTS_CORE_TRAVERSE_KERNELS_FIXTURE_H_
