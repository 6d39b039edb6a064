// SPDX-License-Identifier: Apache-2.0
//
// Commands of `sightline`, run in this process against the embedded server or one on a free port.
//
// Thread safety: one test at a time.
#ifndef SIGHTLINE_TESTS_INTEGRATION_CLI_CLI_TESTING_H_
#define SIGHTLINE_TESTS_INTEGRATION_CLI_CLI_TESTING_H_

#include <algorithm>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/exit_code.h"
#include "client/cli/formats/file.h"
#include "client/cli/formats/npy.h"
#include "client/cli/run.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "server/server.h"
#include "tests/support/temp_dir.h"

namespace sightline::cli {

struct RunResult {
  int code = 0;
  std::string out, err;
};

inline RunResult RunCommand(const std::vector<std::string>& args) {
  std::ostringstream out, err;
  RunResult result;
  result.code = RunCli(args, out, err);
  result.out = out.str();
  result.err = err.str();
  return result;
}

class CliTest : public testing::Test {
 protected:
  // A server on a free port; --server for it.
  static std::string ServerFlag(const Server& server) {
    return absl::StrCat("--server=127.0.0.1:", server.port());
  }
  static std::unique_ptr<Server> StartServer() {
    ServerOptions options;
    options.listen = {"127.0.0.1:0"};
    options.log_level = LogLevel::kError;
    absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(options);
    EXPECT_TRUE(server.ok()) << server.status();
    return server.ok() ? *std::move(server) : nullptr;
  }

  std::string Write(const std::string& name, const std::string& bytes) {
    EXPECT_TRUE(WriteFile(dir_.File(name), bytes).ok());
    return dir_.File(name);
  }
  std::string WriteDoubles(const std::string& name, const std::vector<double>& values,
                           size_t columns) {
    const size_t shape[] = {values.size() / columns, columns};
    return Write(name, FormatNpy<double>(shape, values));
  }
  std::string Read(const std::string& path) {
    const absl::StatusOr<std::string> bytes = ReadFile(path);
    EXPECT_TRUE(bytes.ok()) << bytes.status();
    return bytes.ok() ? *bytes : "";
  }
  // Runs a command that must work.
  RunResult Good(const std::vector<std::string>& args) {
    RunResult result = RunCommand(args);
    EXPECT_EQ(result.code, 0) << result.err;
    return result;
  }
  // Runs a command that must end with `code` and one line on standard error that says `words`.
  void Bad(int code, const std::vector<std::string>& args, const std::vector<std::string>& words) {
    const RunResult result = RunCommand(args);
    EXPECT_EQ(result.code, code) << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    for (const std::string& word : words) EXPECT_THAT(result.err, testing::HasSubstr(word));
    EXPECT_EQ(result.out, "");
  }
  std::string File(const std::string& name) { return dir_.File(name); }

  testing_support::TempDir dir_;
};

// Two walls and a floor with a hole in one wall; 10 triangles.
inline constexpr char kSmallObj[] =
    "o floor\nv 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\nf 1 2 3 4\n"
    "o wall\nv 5 0 0\nv 5 4 0\nv 5 4 3\nv 5 0 3\nf 5 6 7 8\nv 5 6 0\nv 5 10 0\nv 5 10 3\nv 5 6 "
    "3\nf 9 10 11 12\n"
    "o roof\nv 5 0 3\nv 9 0 4\nv 9 10 4\nv 5 10 3\nf 13 14 15 16\n"
    "o post\nv 2 2 0\nv 2.5 2 0\nv 2.25 2.5 0\nv 2.25 2.25 5\nf 17 18 20\nf 18 19 20\n";

}  // namespace sightline::cli

#endif  // SIGHTLINE_TESTS_INTEGRATION_CLI_CLI_TESTING_H_
