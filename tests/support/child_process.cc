// SPDX-License-Identifier: Apache-2.0
#include "tests/support/child_process.h"

#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

namespace sightline::testing_support {

ChildProcess::ChildProcess(std::vector<std::string> arguments,
                           const std::function<void()>& before) {
  std::vector<char*> argv;
  argv.reserve(arguments.size() + 1);
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  pid_ = fork();
  if (pid_ == 0) {
    before();
    execv(argv[0], argv.data());
    _exit(127);
  }
}

void ChildProcess::Signal(int signal) const { kill(pid_, signal); }

int ChildProcess::Wait() {
  int status = 0;
  waitpid(pid_, &status, 0);
  pid_ = 0;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
}

void ChildProcess::Kill() {
  if (pid_ <= 0) return;
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
  pid_ = 0;
}

}  // namespace sightline::testing_support
