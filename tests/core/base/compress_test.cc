// SPDX-License-Identifier: Apache-2.0
//
// Chosen lanes come first, whichever are chosen, on each instruction set that this machine has.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/core/base/compress_test.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: it has to come before what it compiles for every target.
#include "hwy/foreach_target.h"
// clang-format on

#include <cstdint>
#include <vector>

#include "core/base/compress-inl.h"
#include "gtest/gtest.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace {

template <class D>
void ExpectChosenFirst(D d) {
  using T = hn::TFromD<D>;
  constexpr size_t kLanes = hn::MaxLanes(d);
  HWY_ALIGN T from[kLanes], to[kLanes];
  for (size_t i = 0; i < kLanes; ++i) from[i] = static_cast<T>(100 + i);
  for (uint32_t mask = 0; mask < 1u << kLanes; ++mask) {
    uint8_t bits[8];  // As many as LoadMaskBits may read.
    for (size_t i = 0; i < sizeof(bits); ++i) bits[i] = static_cast<uint8_t>(mask >> (8 * (i % 4)));
    std::vector<T> wanted;
    for (size_t i = 0; i < kLanes; ++i) {
      if ((mask >> i & 1) != 0) wanted.push_back(from[i]);
    }
    const auto expect = [&](hn::Vec<D> compressed) HWY_ATTR {
      hn::Store(compressed, d, to);
      ASSERT_EQ(std::vector<T>(to, to + wanted.size()), wanted) << mask;
    };
    expect(CompressLanes(d, hn::Load(d, from), hn::LoadMaskBits(d, bits)));
    if constexpr (kLanes == 8) expect(CompressLanesByBits(d, hn::Load(d, from), mask));
    if (testing::Test::HasFatalFailure()) return;
  }
}

void ExpectChosenFirstOfAll() {
  ExpectChosenFirst(hn::CappedTag<float, 8>());
  ExpectChosenFirst(hn::CappedTag<uint32_t, 8>());
  ExpectChosenFirst(hn::CappedTag<float, 16>());
  ExpectChosenFirst(hn::CappedTag<uint32_t, 16>());
  ExpectChosenFirst(hn::CappedTag<uint32_t, 4>());
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline {
namespace {

HWY_EXPORT(ExpectChosenFirstOfAll);

TEST(CompressTest, ChosenLanesComeFirst) {
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    HWY_DYNAMIC_DISPATCH(ExpectChosenFirstOfAll)();
  }
  hwy::SetSupportedTargetsForTest(0);
}

}  // namespace
}  // namespace sightline
#endif  // HWY_ONCE
