// SPDX-License-Identifier: Apache-2.0
//
// sightline-load as a process whose standard error is a terminal (terminal_process.h).
//
// Thread safety: one thread.
//
//   LoadProcess load({server_flag, "--scene=box"});
//   ASSERT_TRUE(load.Says("warming up"));
//   load.Signal(SIGINT);
//   EXPECT_EQ(load.Wait(), 0);
#ifndef SIGHTLINE_TESTS_INTEGRATION_LOAD_LOAD_PROCESS_H_
#define SIGHTLINE_TESTS_INTEGRATION_LOAD_LOAD_PROCESS_H_

#include <string>
#include <utility>
#include <vector>

#include "tests/integration/terminal_process.h"

namespace sightline::load {

class LoadProcess : public TerminalProcess {
 public:
  explicit LoadProcess(std::vector<std::string> arguments)
      : TerminalProcess(WithProgram(std::move(arguments))) {}

 private:
  static std::vector<std::string> WithProgram(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), SIGHTLINE_LOAD_BINARY);
    return arguments;
  }
};

}  // namespace sightline::load

#endif  // SIGHTLINE_TESTS_INTEGRATION_LOAD_LOAD_PROCESS_H_
