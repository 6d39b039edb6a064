// SPDX-License-Identifier: Apache-2.0
#include "server/base/log.h"

#include <fcntl.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <string>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "core/base/check.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

// Standard error on a pipe of one page, for as long as it lives.
class StderrPipe {
 public:
  StderrPipe() : old_(dup(STDERR_FILENO)) {
    FlushLog();
    EXPECT_EQ(pipe(ends_), 0);
    EXPECT_GT(fcntl(ends_[1], F_SETPIPE_SZ, 4096), 0);
    dup2(ends_[1], STDERR_FILENO);
    SetLogLevel(LogLevel::kInfo);
  }
  ~StderrPipe() {
    Restore();
    close(ends_[0]);
    close(old_);
    SetLogLevel(LogLevel::kOff);
  }
  StderrPipe(const StderrPipe&) = delete;
  StderrPipe& operator=(const StderrPipe&) = delete;

  // Everything up to a line with `last` in it.
  std::string ReadUntil(absl::string_view last) const {
    std::string all;
    char bytes[4096];
    while (!absl::StrContains(all, last) || all.back() != '\n') {
      const ssize_t n = read(ends_[0], bytes, sizeof(bytes));
      if (n <= 0) break;
      all.append(bytes, static_cast<size_t>(n));
    }
    return all;
  }

 private:
  void Restore() const {
    dup2(old_, STDERR_FILENO);
    close(ends_[1]);
  }

  const int old_;
  int ends_[2] = {-1, -1};
};

TEST(LogTest, ALineHasTimeLevelEventAndQuotedFields) {
  const StderrPipe pipe;
  Log(LogLevel::kDebug, "below");
  Log(LogLevel::kWarning, "said", {{"plain", "a-1"}, {"odd", "a \"b\"\n"}});
  EXPECT_TRUE(FlushLog());
  const std::string text = pipe.ReadUntil("said");
  EXPECT_TRUE(absl::StartsWith(text, "time=2")) << text;
  EXPECT_TRUE(absl::EndsWith(text, "Z level=warning event=said plain=a-1 odd=\"a \\\"b\\\"\\n\"\n"))
      << text;
}

TEST(LogTest, LongValuesAreCut) {
  const StderrPipe pipe;
  Log(LogLevel::kInfo, "long", {{"name", std::string(100'000, 'x')}, {"then", "end"}});
  const std::string text = pipe.ReadUntil("then=end");
  EXPECT_LT(text.size(), 1200u);
  EXPECT_TRUE(absl::StrContains(text, "x... (100000 bytes)\" then=end")) << text;
}

// Nobody reads: whoever logs goes on, the oldest lines go, and it is said how many.
TEST(LogTest, AFullPipeHoldsNobodyUp) {
  const uint64_t dropped_before = DroppedLogLines();
  constexpr int kLines = 5000;
  const StderrPipe pipe;
  for (int i = 0; i < kLines; ++i) Log(LogLevel::kInfo, "line", {{"number", absl::StrCat(i)}});
  EXPECT_FALSE(FlushLog(absl::ZeroDuration()));
  const uint64_t dropped = DroppedLogLines() - dropped_before;
  EXPECT_GT(dropped, 1000u);
  const std::string text = pipe.ReadUntil(absl::StrCat("number=", kLines - 1, "\n"));
  EXPECT_TRUE(FlushLog());
  int lines = 0;
  for (size_t at = 0; (at = text.find("event=line ", at)) != std::string::npos; ++at) ++lines;
  EXPECT_EQ(static_cast<uint64_t>(lines) + dropped, uint64_t{kLines});
  const std::string told = "level=warning event=log_lines_dropped lines=";
  const size_t at = text.find(told);
  ASSERT_NE(at, std::string::npos);
  int said = 0;
  for (size_t found = at; found != std::string::npos; found = text.find(told, found + 1)) {
    said += std::atoi(text.c_str() + found + told.size());
  }
  EXPECT_EQ(static_cast<uint64_t>(said), DroppedLogLines() - dropped_before);
}

// What nobody waits for any more does not stand in the way of later ones.
TEST(LogTest, AFlushThatWasGivenUpLeavesTheNextOnesAlone) {
  const uint64_t dropped_before = DroppedLogLines();
  const StderrPipe pipe;
  constexpr int kLinesBefore = 200, kLines = 3000;  // More than a page, more than the queue.
  for (int i = 0; i < kLinesBefore; ++i) Log(LogLevel::kInfo, "line", {{"number", "before"}});
  EXPECT_FALSE(FlushLog(absl::ZeroDuration()));
  for (int i = 0; i < kLines; ++i) Log(LogLevel::kInfo, "line", {{"number", absl::StrCat(i)}});
  const std::string text = pipe.ReadUntil(absl::StrCat("number=", kLines - 1, "\n"));
  EXPECT_TRUE(FlushLog());
  uint64_t lines = 0;
  for (size_t at = 0; (at = text.find("event=line ", at)) != std::string::npos; ++at) ++lines;
  EXPECT_EQ(lines + DroppedLogLines() - dropped_before, uint64_t{kLinesBefore + kLines});
  EXPECT_TRUE(FlushLog(absl::ZeroDuration()));
}

TEST(LogDeathTest, AFailedCheckWritesWhatWasLoggedBefore) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_DEATH(
      {
        SetLogLevel(LogLevel::kInfo);
        for (int i = 0; i < 100; ++i) Log(LogLevel::kInfo, "before", {{"n", absl::StrCat(i)}});
        SIGHTLINE_CHECK(1 > 2) << "after";
      },
      "event=before n=99\n.*check failed: 1 > 2 after");
}

}  // namespace
}  // namespace sightline
