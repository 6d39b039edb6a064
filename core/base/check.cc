// SPDX-License-Identifier: Apache-2.0
#include "core/base/check.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <climits>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "core/base/check_failure.h"

namespace sightline {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kWritePatience{1000};
// For the thread that prepares, which then has a line of its own to write.
constexpr std::chrono::milliseconds kOthersPatience{3000};

std::atomic<void (*)()> before_failure = nullptr;
std::atomic<bool> awaited = false;  // A `prepare` is set, and its thread not at its end.
thread_local bool preparing = false;

// Whether the file is ready by then. A signal cuts nothing short. Null: waits.
bool IsReady(pollfd* file, Clock::time_point until) {
  while (true) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()).count();
    const int ready =
        poll(file, file == nullptr ? 0 : 1, static_cast<int>(std::max<int64_t>(left, 0)));
    if (ready >= 0 || errno != EINTR) return ready > 0;
  }
}

// Not through stdio: whoever waits for a pipe that nobody reads holds its lock. A pipe that is
// ready takes PIPE_BUF bytes; more might wait for a reader for ever.
void WriteToStderr(std::string_view text) {
  const Clock::time_point until = Clock::now() + kWritePatience;
  while (!text.empty()) {
    pollfd out{.fd = STDERR_FILENO, .events = POLLOUT, .revents = 0};
    if (!IsReady(&out, until)) return;
    const ssize_t written =
        write(STDERR_FILENO, text.data(), std::min<size_t>(text.size(), PIPE_BUF));
    if (written < 0 && errno != EINTR) return;
    if (written > 0) text.remove_prefix(static_cast<size_t>(written));
  }
}

// The end of the process is the other thread's, unless that takes too long.
void AwaitOthers() {
  const Clock::time_point until = Clock::now() + kOthersPatience;
  while (awaited && Clock::now() < until) {
    IsReady(nullptr, std::min(until, Clock::now() + std::chrono::milliseconds(10)));
  }
}

}  // namespace

void SetBeforeCheckFailure(void (*prepare)()) {
  awaited = prepare != nullptr;
  before_failure = prepare;
}

namespace check_internal {

Failure::Failure(const char* file, int line, const std::string& condition) {
  stream_ << file << ":" << line << ": check failed: " << condition << " ";
}

Failure::~Failure() {
  // Once: what it calls may fail a check, too.
  void (*const prepare)() = before_failure.exchange(nullptr);
  if (prepare != nullptr) {
    preparing = true;
    prepare();
  }
  stream_ << "\n";
  WriteToStderr(stream_.str());
  if (prepare != nullptr) {
    awaited = false;
  } else if (!preparing) {
    AwaitOthers();
  }
  std::abort();
}

}  // namespace check_internal
}  // namespace sightline
