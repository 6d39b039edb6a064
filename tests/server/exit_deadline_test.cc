// SPDX-License-Identifier: Apache-2.0
#include "server/base/exit_deadline.h"

#include <unistd.h>

#include "gtest/gtest.h"
#include "server/base/log.h"

namespace sightline {
namespace {

// As work would that nobody can stop.
void HangWithDeadline() {
  SetLogLevel(LogLevel::kInfo);
  const ExitDeadline deadline(absl::Milliseconds(1), 70);
  while (true) pause();
}

TEST(ExitDeadlineTest, EndsAProcessThatDoesNotEndItself) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(HangWithDeadline(), ::testing::ExitedWithCode(70),
              "level=error event=cut_short after=1ms");
}

TEST(ExitDeadlineTest, LeavesOneAloneThatIsInTime) {
  const ExitDeadline distant(absl::Hours(48), 70);
  for (int i = 0; i < 100; ++i) {
    const ExitDeadline deadline(absl::Hours(1), 70);
  }
}

}  // namespace
}  // namespace sightline
