// SPDX-License-Identifier: Apache-2.0
//
// sightlined itself, as a process of its own with its log on a pipe; killed when the object goes.
//
// Thread safety: one thread, except that HasSaid may be called from any.
//
//   ServerProcess process({"--listen=127.0.0.1:0", "--repository", dir.path()});
//   const int port = process.Port();
//   EXPECT_FALSE(process.HasSaid("level=warning"));
//   process.Signal(SIGKILL);
#ifndef SIGHTLINE_TESTS_INTEGRATION_SERVER_PROCESS_H_
#define SIGHTLINE_TESTS_INTEGRATION_SERVER_PROCESS_H_

#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/string_view.h"
#include "core/base/mutex.h"
#include "gtest/gtest.h"
#include "tests/support/child_process.h"

namespace sightline {

class ServerProcess {
 public:
  // `before` runs in the child before sightlined does: to set limits of its own.
  explicit ServerProcess(std::vector<std::string> arguments,
                         const std::function<void()>& before = nullptr) {
    int ends[2];
    EXPECT_EQ(pipe(ends), 0);
    arguments.insert(arguments.begin(), SIGHTLINED_BINARY);
    child_.emplace(std::move(arguments), [&] {
      dup2(ends[1], STDERR_FILENO);
      dup2(ends[1], STDOUT_FILENO);
      close(ends[0]);
      close(ends[1]);
      if (before) before();
    });
    close(ends[1]);
    log_ = fdopen(ends[0], "r");
  }
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;
  ~ServerProcess() {
    child_->Kill();  // What it logs then comes to its end.
    if (drain_.joinable()) drain_.join();
    std::fclose(log_);
  }
  // The first line with `text` in it, or everything there was.
  std::string ReadUntil(const std::string& text) {
    std::string all;
    char line[4096];
    while (std::fgets(line, sizeof(line), log_) != nullptr) {
      Keep(line);
      if (absl::StrContains(line, text)) return line;
      all += line;
    }
    return all;
  }
  // Everything, the first line with `text` in it the last.
  std::string ReadThrough(const std::string& text) {
    std::string all;
    char line[4096];
    while (std::fgets(line, sizeof(line), log_) != nullptr) {
      Keep(line);
      all += line;
      if (absl::StrContains(line, text)) break;
    }
    return all;
  }
  // Waits until it serves; the port. What it logs from then on is read as it comes: a full pipe
  // would cost it lines.
  int Port() {
    const std::string serving = ReadUntil("event=serving");
    drain_ = std::thread([this] {
      char line[4096];
      while (std::fgets(line, sizeof(line), log_) != nullptr) Keep(line);
    });
    const size_t at = serving.find("port=");
    EXPECT_NE(at, std::string::npos) << serving;
    const size_t metrics = serving.find("metrics_port=");
    if (metrics != std::string::npos) metrics_port_ = std::atoi(serving.c_str() + metrics + 13);
    return at == std::string::npos ? 0 : std::atoi(serving.c_str() + at + 5);
  }
  // Once Port() has returned; 0 without --metrics-listen.
  int metrics_port() const { return metrics_port_; }
  // Whether `text` is in what was read of its log so far, or in the last mebibyte of that.
  bool HasSaid(absl::string_view text) const {
    MutexLock lock(mutex_);
    return absl::StrContains(said_, text);
  }
  pid_t pid() const { return child_->pid(); }
  void Signal(int signal) const { child_->Signal(signal); }
  int Wait() { return child_->Wait(); }

 private:
  void Keep(const char* line) {
    constexpr size_t kMostKept = 1 << 20;
    MutexLock lock(mutex_);
    said_ += line;
    // Half of it at a time, so that each byte is moved once or twice.
    if (said_.size() > 2 * kMostKept) said_.erase(0, kMostKept);
  }

  std::optional<testing_support::ChildProcess> child_;
  int metrics_port_ = 0;
  std::FILE* log_ = nullptr;
  std::thread drain_;
  mutable Mutex mutex_;
  std::string said_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_INTEGRATION_SERVER_PROCESS_H_
