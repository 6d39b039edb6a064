// SPDX-License-Identifier: Apache-2.0
#include "client/import/child_process.h"

#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <new>
#include <stdexcept>
#include <string>

#include "gtest/gtest.h"
#include "tests/client/import/import_testing.h"

namespace sightline {
namespace {

TEST(ChildProcessTest, HandsBackWhatTheWorkReturns) {
  std::string large(5'000'000, 'x');
  EXPECT_EQ(RunInChild([&] { return large; }, {}).value_or("error"), large);
  EXPECT_EQ(RunInChild([] { return std::string(); }, {}).value_or("error"), "");
}

TEST(ChildProcessTest, TurnsACrashIntoAnError) {
  EXPECT_IMPORT_ERROR(RunInChild(
                          []() -> std::string {
                            std::raise(SIGSEGV);
                            return "survived";
                          },
                          {})
                          .status(),
                      kDataLoss, "crash");
  EXPECT_IMPORT_ERROR(RunInChild([]() -> std::string { _exit(3); }, {}).status(), kDataLoss,
                      "without an answer");
}

TEST(ChildProcessTest, CarriesExceptions) {
  EXPECT_IMPORT_ERROR(
      RunInChild([]() -> std::string { throw std::runtime_error("no such thing"); }, {}).status(),
      kInvalidArgument, "no such thing");
  EXPECT_IMPORT_ERROR(RunInChild([]() -> std::string { throw std::bad_alloc(); }, {}).status(),
                      kResourceExhausted, "memory");
  EXPECT_IMPORT_ERROR(RunInChild([]() -> std::string { throw 7; }, {}).status(), kInvalidArgument,
                      "unknown exception");
}

TEST(ChildProcessTest, EndsWorkThatTakesTooLong) {
  ChildLimits limits;
  limits.timeout_seconds = 0.2;
  EXPECT_IMPORT_ERROR(RunInChild(
                          []() -> std::string {
                            for (;;) pause();
                          },
                          limits)
                          .status(),
                      kDeadlineExceeded, "0.2 seconds");
}

TEST(ChildProcessTest, EndsWorkThatNobodyWants) {
  CancelToken cancel;
  cancel.Cancel();
  ChildLimits limits;
  limits.cancel = &cancel;
  EXPECT_EQ(RunInChild(
                []() -> std::string {
                  for (;;) pause();
                },
                limits)
                .status()
                .code(),
            absl::StatusCode::kCancelled);
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
}

// A terminal's Ctrl-C goes to the child as well; what comes of it is for the parent to say.
TEST(ChildProcessTest, LeavesSignalsOfTheTerminalToItsParent) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    EXPECT_EQ(RunInChild(
                  [signal]() -> std::string {
                    std::raise(signal);
                    return "goes on";
                  },
                  {})
                  .value_or("error"),
              "goes on");
  }
}

TEST(ChildProcessTest, EndsWorkThatReturnsTooMuch) {
  ChildLimits limits;
  limits.result_bytes = 1000;
  EXPECT_IMPORT_ERROR(RunInChild([] { return std::string(3'000'000, 'x'); }, limits).status(),
                      kResourceExhausted, "1000 bytes");
}

TEST(ChildProcessTest, LeavesNoChildBehind) {
  ASSERT_TRUE(RunInChild([] { return std::string("x"); }, {}).ok());
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
  EXPECT_EQ(errno, ECHILD);
}

}  // namespace
}  // namespace sightline
