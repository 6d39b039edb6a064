// SPDX-License-Identifier: Apache-2.0
#include "core/base/check.h"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "core/base/check_failure.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

enum class Colour : unsigned char { kRed = 7 };
struct Opaque {
  int value;
  bool operator==(const Opaque&) const = default;
};

TEST(CheckTest, PassingChecksEvaluateOnceAndSayNothing) {
  int calls = 0;
  SIGHTLINE_CHECK(++calls == 1) << "unreached " << ++calls;
  SIGHTLINE_CHECK_EQ(++calls, 2) << "unreached";
  EXPECT_EQ(calls, 2);
}

TEST(CheckTest, WorksWithinAnUnbracedIfElse) {
  const bool never = testing::UnitTest::GetInstance() == nullptr;
  bool reached = false;
  if (never)
    SIGHTLINE_CHECK(false);
  else
    reached = true;
  if (never)
    SIGHTLINE_CHECK_EQ(1, 2);
  else
    EXPECT_TRUE(reached);
}

TEST(CheckDeathTest, NamesPlaceConditionAndMessage) {
  EXPECT_DEATH(SIGHTLINE_CHECK(1 > 2) << "leaf " << 42,
               "tests/core/base/check_test.cc:[0-9]+: check failed: 1 > 2 leaf 42");
}

TEST(CheckDeathTest, ComparisonsPrintBothValues) {
  const std::vector<int> three(3);
  EXPECT_DEATH(SIGHTLINE_CHECK_EQ(three.size(), 4u), "three.size\\(\\) == 4u \\(3 against 4\\)");
  EXPECT_DEATH(SIGHTLINE_CHECK_NE(1, 1), "1 against 1");
  EXPECT_DEATH(SIGHTLINE_CHECK_LT(2, 1), "2 against 1");
  EXPECT_DEATH(SIGHTLINE_CHECK_LE(2, 1), "2 against 1");
  EXPECT_DEATH(SIGHTLINE_CHECK_GT(1, 2), "1 against 2");
  EXPECT_DEATH(SIGHTLINE_CHECK_GE(1, 2) << "why", "1 against 2\\) why");
}

TEST(CheckDeathTest, PrintsEnumsBytesAndOpaqueValues) {
  EXPECT_DEATH(SIGHTLINE_CHECK_EQ(Colour::kRed, Colour{8}), "7 against 8");
  EXPECT_DEATH(SIGHTLINE_CHECK_EQ(static_cast<unsigned char>(9), 10), "9 against 10");
  EXPECT_DEATH(SIGHTLINE_CHECK_EQ(Opaque{1}, Opaque{2}), "4 bytes");
}

// The text of a check is longer than its pipe has room for, and nobody reads: the end comes anyway.
TEST(CheckDeathTest, APipeThatNobodyReadsDoesNotHoldUpTheEnd) {
  const auto fail = [] {
    int ends[2] = {};
    if (pipe(ends) != 0 || dup2(ends[1], STDERR_FILENO) < 0) _exit(1);
    // A page is left, and then nothing.
    fcntl(ends[1], F_SETPIPE_SZ, 2 * 4096);
    const std::array<char, 4096> page{};
    if (write(ends[1], page.data(), page.size()) != 4096) _exit(2);
    alarm(30);
    SIGHTLINE_CHECK(false) << std::string(100'000, 'x');
  };
  EXPECT_EXIT(fail(), testing::KilledBySignal(SIGABRT), "");
}

// Long lines come whole where somebody reads them.
TEST(CheckDeathTest, LongTextsAreWrittenToTheirEnd) {
  EXPECT_DEATH(SIGHTLINE_CHECK(false) << std::string(50'000, 'x') << "the end", "xthe end");
}

// What `prepare` has to write is not cut short by another thread whose check fails meanwhile.
TEST(CheckDeathTest, AnotherThreadsFailureWaitsForTheFirst) {
  const auto fail_while_another_fails = [] {
    SetBeforeCheckFailure([] {
      // What the other writes comes through a pipe: once it is there, its abort is next.
      int ends[2] = {}, nothing[2] = {};
      const int to_the_test = dup(STDERR_FILENO);
      if (pipe(ends) != 0 || pipe(nothing) != 0) _exit(1);
      if (to_the_test < 0 || dup2(ends[1], STDERR_FILENO) < 0) _exit(1);
      std::thread([] { SIGHTLINE_CHECK(false) << "second"; }).detach();
      std::string text;
      while (!text.ends_with('\n')) {
        std::array<char, 4096> some{};
        const ssize_t size = read(ends[0], some.data(), some.size());
        if (size <= 0) _exit(1);
        text.append(some.data(), static_cast<size_t>(size));
      }
      if (dup2(to_the_test, STDERR_FILENO) < 0) _exit(1);
      if (write(STDERR_FILENO, text.data(), text.size()) < 0) _exit(1);
      // Nothing is ever written to it: long enough for the other to abort, if it did not wait.
      pollfd never{.fd = nothing[0], .events = POLLIN, .revents = 0};
      poll(&never, 1, 100);
      constexpr std::string_view kLog = "the log's last line\n";
      if (write(STDERR_FILENO, kLog.data(), kLog.size()) < 0) _exit(1);
    });
    SIGHTLINE_CHECK(false) << "first";
  };
  EXPECT_EXIT(fail_while_another_fails(), testing::KilledBySignal(SIGABRT),
              "second\n(.|\n)*the log's last line\n(.|\n)*first\n");
}

// A check that fails within `prepare` waits for nobody.
TEST(CheckDeathTest, AFailureWithinPrepareEndsAtOnce) {
  const auto fail_twice = [] {
    SetBeforeCheckFailure([] {
      alarm(2);
      SIGHTLINE_CHECK(false) << "within";
    });
    SIGHTLINE_CHECK(false) << "first";
  };
  EXPECT_EXIT(fail_twice(), testing::KilledBySignal(SIGABRT), "within");
}

#if defined(SIGHTLINE_DEBUG_CHECKS)
TEST(CheckDeathTest, DebugChecksAreOnInDebugAndSanitizerBuilds) {
  EXPECT_DEATH(SIGHTLINE_DCHECK(false) << "seen", "seen");
  EXPECT_DEATH(SIGHTLINE_DCHECK_EQ(1, 2), "1 against 2");
}
#else
TEST(CheckTest, DebugChecksEvaluateNothingInReleaseBuilds) {
  int calls = 0;
  SIGHTLINE_DCHECK(++calls == 100) << "unreached";
  SIGHTLINE_DCHECK_EQ(++calls, 100);
  EXPECT_EQ(calls, 0);
}
#endif

}  // namespace
}  // namespace sightline
