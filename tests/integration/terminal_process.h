// SPDX-License-Identifier: Apache-2.0
//
// A tool of ours as a process whose standard error is a terminal, so that it says what it is about;
// killed when the object goes.
//
// Thread safety: one thread.
//
//   TerminalProcess load({SIGHTLINE_LOAD_BINARY, server_flag, "--scene=box"});
//   ASSERT_TRUE(load.Says("warming up"));
//   load.Signal(SIGINT);
//   EXPECT_EQ(load.Wait(), 0);
#ifndef SIGHTLINE_TESTS_INTEGRATION_TERMINAL_PROCESS_H_
#define SIGHTLINE_TESTS_INTEGRATION_TERMINAL_PROCESS_H_

#include <fcntl.h>
#include <stdlib.h>  // NOLINT(modernize-deprecated-headers): posix_openpt is POSIX.
#include <unistd.h>

#include <fstream>
#include <iterator>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "tests/support/child_process.h"
#include "tests/support/temp_dir.h"

namespace sightline {

class TerminalProcess {
 public:
  // `arguments` begin with the program's path.
  explicit TerminalProcess(std::vector<std::string> arguments)
      : terminal_(posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC)) {
    EXPECT_EQ(grantpt(terminal_), 0);
    EXPECT_EQ(unlockpt(terminal_), 0);
    const std::string own = ptsname(terminal_), out = dir_.File("out");
    child_.emplace(std::move(arguments), [&] {
      dup2(open(own.c_str(), O_RDWR | O_NOCTTY), STDERR_FILENO);
      dup2(open(out.c_str(), O_WRONLY | O_CREAT, 0600), STDOUT_FILENO);
    });
  }
  TerminalProcess(const TerminalProcess&) = delete;
  TerminalProcess& operator=(const TerminalProcess&) = delete;
  ~TerminalProcess() {
    child_.reset();
    close(terminal_);
  }

  // Reads until it has said `text`, or ended without.
  testing::AssertionResult Says(const std::string& text) {
    while (said_.find(text) == std::string::npos) {
      if (!Read()) return testing::AssertionFailure() << "it said: " << said_;
    }
    return testing::AssertionSuccess();
  }
  void Signal(int signal) const { child_->Signal(signal); }
  // Its exit code, or 1000 and the signal that ended it.
  int Wait() {
    while (Read()) {
    }
    return child_->Wait();
  }
  // All that came to its terminal so far.
  const std::string& said() const { return said_; }
  // All that it printed. REQUIRES: Wait has returned.
  std::string out() const {
    std::ifstream file(dir_.File("out"));
    return {std::istreambuf_iterator<char>(file), {}};
  }

 private:
  // False once nobody has the terminal's other side any more.
  bool Read() {
    char bytes[4096];
    const ssize_t got = read(terminal_, bytes, sizeof(bytes));
    if (got > 0) said_.append(bytes, static_cast<size_t>(got));
    return got > 0;
  }

  const testing_support::TempDir dir_;
  const int terminal_;
  std::optional<testing_support::ChildProcess> child_;
  std::string said_;
};

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_INTEGRATION_TERMINAL_PROCESS_H_
