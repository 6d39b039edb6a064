// SPDX-License-Identifier: Apache-2.0
//
// A program of ours run as a process of its own; killed when the object goes.
//
// Thread safety: one thread.
//
//   ChildProcess child({SIGHTLINED_BINARY, "--check-config"}, [&] { dup2(log, STDERR_FILENO); });
//   child.Signal(SIGTERM);
//   EXPECT_EQ(child.Wait(), 0);
#ifndef SIGHTLINE_TESTS_SUPPORT_CHILD_PROCESS_H_
#define SIGHTLINE_TESTS_SUPPORT_CHILD_PROCESS_H_

#include <sys/types.h>

#include <functional>
#include <string>
#include <vector>

namespace sightline::testing_support {

class ChildProcess {
 public:
  // `arguments` begin with the program's path. `before` runs in the child ahead of the program: to
  // lay its standard streams, or to set limits of its own.
  ChildProcess(std::vector<std::string> arguments, const std::function<void()>& before);
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;
  ~ChildProcess() { Kill(); }

  pid_t pid() const { return pid_; }
  void Signal(int signal) const;
  // Its exit code, or 1000 and the signal that ended it. REQUIRES: called once.
  int Wait();
  // Ends it now, and waits until it is gone; nothing after Wait.
  void Kill();

 private:
  pid_t pid_ = 0;  // 0: waited for.
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_SUPPORT_CHILD_PROCESS_H_
