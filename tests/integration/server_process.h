// SPDX-License-Identifier: Apache-2.0
//
// sightlined itself, as a process of its own with its log on a pipe; killed when the object goes.
//
// Thread safety: one thread.
//
//   ServerProcess process({"--listen=127.0.0.1:0", "--repository", dir.path()});
//   const int port = process.Port();
//   process.Signal(SIGKILL);
#ifndef SIGHTLINE_TESTS_INTEGRATION_SERVER_PROCESS_H_
#define SIGHTLINE_TESTS_INTEGRATION_SERVER_PROCESS_H_

#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/match.h"
#include "gtest/gtest.h"

namespace sightline {

class ServerProcess {
 public:
  // `before` runs in the child before sightlined does: to set limits of its own.
  explicit ServerProcess(std::vector<std::string> arguments,
                         const std::function<void()>& before = nullptr) {
    int ends[2];
    EXPECT_EQ(pipe(ends), 0);
    arguments.insert(arguments.begin(), SIGHTLINED_BINARY);
    std::vector<char*> argv;
    argv.reserve(arguments.size() + 1);
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    pid_ = fork();
    if (pid_ == 0) {
      dup2(ends[1], STDERR_FILENO);
      dup2(ends[1], STDOUT_FILENO);
      close(ends[0]);
      close(ends[1]);
      if (before) before();
      execv(argv[0], argv.data());
      _exit(127);
    }
    close(ends[1]);
    log_ = fdopen(ends[0], "r");
  }
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;
  ~ServerProcess() {
    if (pid_ > 0) {
      kill(pid_, SIGKILL);
      waitpid(pid_, nullptr, 0);
    }
    if (drain_.joinable()) drain_.join();
    std::fclose(log_);
  }
  // The first line with `text` in it, or everything there was.
  std::string ReadUntil(const std::string& text) {
    std::string all;
    char line[4096];
    while (std::fgets(line, sizeof(line), log_) != nullptr) {
      if (absl::StrContains(line, text)) return line;
      all += line;
    }
    return all;
  }
  // Waits until it serves; the port. What it logs from then on is dropped: a full pipe would stop
  // it.
  int Port() {
    const std::string serving = ReadUntil("event=serving");
    drain_ = std::thread([this] {
      char dropped[4096];
      while (std::fread(dropped, 1, sizeof(dropped), log_) > 0) {
      }
    });
    const size_t at = serving.find("port=");
    EXPECT_NE(at, std::string::npos) << serving;
    const size_t metrics = serving.find("metrics_port=");
    if (metrics != std::string::npos) metrics_port_ = std::atoi(serving.c_str() + metrics + 13);
    return at == std::string::npos ? 0 : std::atoi(serving.c_str() + at + 5);
  }
  // Once Port() has returned; 0 without --metrics-listen.
  int metrics_port() const { return metrics_port_; }
  pid_t pid() const { return pid_; }
  void Signal(int signal) const { kill(pid_, signal); }
  int Wait() {
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
  }

 private:
  pid_t pid_ = 0;
  int metrics_port_ = 0;
  std::FILE* log_ = nullptr;
  std::thread drain_;
};

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_INTEGRATION_SERVER_PROCESS_H_
