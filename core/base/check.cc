// SPDX-License-Identifier: Apache-2.0
#include "core/base/check.h"

#include <poll.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>

#include "core/base/check_failure.h"

namespace sightline {
namespace {

constexpr int kPatienceMilliseconds = 1000;

std::atomic<void (*)()> before_failure = nullptr;

}  // namespace

void SetBeforeCheckFailure(void (*prepare)()) { before_failure = prepare; }

namespace check_internal {

Failure::Failure(const char* file, int line, const std::string& condition) {
  stream_ << file << ":" << line << ": check failed: " << condition << " ";
}

Failure::~Failure() {
  // Once: what it calls may fail a check, too.
  if (void (*const prepare)() = before_failure.exchange(nullptr)) prepare();
  stream_ << "\n";
  const std::string text = stream_.str();
  // Not through stdio: whoever waits for a pipe that nobody reads holds its lock.
  pollfd out{.fd = STDERR_FILENO, .events = POLLOUT, .revents = 0};
  if (poll(&out, 1, kPatienceMilliseconds) > 0) {
    (void)!write(STDERR_FILENO, text.data(), text.size());
  }
  std::abort();
}

}  // namespace check_internal
}  // namespace sightline
