// SPDX-License-Identifier: Apache-2.0
//
// Chosen lanes are stored and no others, whichever are chosen, on each instruction set that this
// machine has.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/core/base/masked_store_test.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: it has to come before what it compiles for every target.
#include "hwy/foreach_target.h"
// clang-format on

#include <cstdint>

#include "core/base/masked_store-inl.h"
#include "gtest/gtest.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace {

template <class D>
void ExpectChosenStored(D d) {
  using T = hn::TFromD<D>;
  constexpr size_t kLanes = hn::MaxLanes(d);
  HWY_ALIGN T row[2 * kLanes];
  for (uint32_t mask = 0; mask < 1u << kLanes; ++mask) {
    uint8_t bits[8];  // As many as LoadMaskBits may read.
    for (size_t i = 0; i < sizeof(bits); ++i) bits[i] = static_cast<uint8_t>(mask >> (8 * (i % 4)));
    for (size_t i = 0; i < 2 * kLanes; ++i) row[i] = static_cast<T>(i);
    StoreWhere(hn::LoadMaskBits(d, bits), hn::Set(d, T{100}), d, row);
    for (size_t i = 0; i < 2 * kLanes; ++i) {
      const bool chosen = i < kLanes && (mask >> i & 1) != 0;
      ASSERT_EQ(row[i], chosen ? T{100} : static_cast<T>(i)) << mask << ", lane " << i;
    }
  }
}

void ExpectChosenStoredOfAll() {
  ExpectChosenStored(hn::CappedTag<float, 16>());
  ExpectChosenStored(hn::CappedTag<uint32_t, 16>());
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline {
namespace {

HWY_EXPORT(ExpectChosenStoredOfAll);

TEST(MaskedStoreTest, ChosenLanesAreStoredAndNoOthers) {
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    HWY_DYNAMIC_DISPATCH(ExpectChosenStoredOfAll)();
  }
  hwy::SetSupportedTargetsForTest(0);
}

}  // namespace
}  // namespace sightline
#endif  // HWY_ONCE
