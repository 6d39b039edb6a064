// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/process_usage.h"

#include <unistd.h>

#include <vector>

#include "gtest/gtest.h"

namespace sightline {
namespace {

TEST(ProcessUsageTest, DescriptorsAreCounted) {
  const ProcessUsage before = MeasureProcess();
  std::vector<int> opened;
  for (int i = 0; i < 7; ++i) opened.push_back(dup(STDERR_FILENO));
  const ProcessUsage with = MeasureProcess();
  for (const int fd : opened) close(fd);
  EXPECT_EQ(with.open_descriptors, before.open_descriptors + 7);
  EXPECT_EQ(MeasureProcess().open_descriptors, before.open_descriptors);
  EXPECT_GT(before.max_descriptors, before.open_descriptors);
}

TEST(ProcessUsageTest, MemoryAndTimeAreThere) {
  const ProcessUsage before = MeasureProcess();
  EXPECT_GT(before.resident_bytes, uint64_t{1} << 20);
  EXPECT_GE(before.threads, 1u);
  constexpr size_t kBytes = 64 << 20;
  const std::vector<char> touched(kBytes, 1);
  const ProcessUsage with = MeasureProcess();
  EXPECT_GE(with.resident_bytes, before.resident_bytes + kBytes / 2) << touched[kBytes / 2];
  EXPECT_GE(with.cpu_seconds, before.cpu_seconds);
}

}  // namespace
}  // namespace sightline
