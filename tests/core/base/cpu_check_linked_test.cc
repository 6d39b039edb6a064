// SPDX-License-Identifier: Apache-2.0
#include "core/base/cancel.h"
#include "gtest/gtest.h"

// Weak: alone it does not pull anything out of an archive.
extern "C" __attribute__((weak)) bool sightline_cpu_check_ran;

namespace sightline {
namespace {

TEST(CpuCheckLinkedTest, EveryBinaryThatLinksCoreRunsTheCheck) {
  CancelToken token;  // Any use of core.
  EXPECT_FALSE(token.cancelled());
  ASSERT_NE(&sightline_cpu_check_ran, nullptr);
  EXPECT_TRUE(sightline_cpu_check_ran);
}

}  // namespace
}  // namespace sightline
