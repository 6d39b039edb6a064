// SPDX-License-Identifier: Apache-2.0
//
// How long to wait before trying again: exponentially longer, with jitter, so that many clients of
// one server that comes back do not return in step (a client without back-off was measured at
// 90,000 attempts a second).
//
// Thread safety: none; one Backoff belongs to one caller.
//
//   Backoff backoff({});
//   absl::Duration wait = backoff.Next(status);
#ifndef SIGHTLINE_CLIENT_LIB_BACKOFF_H_
#define SIGHTLINE_CLIENT_LIB_BACKOFF_H_

#include <algorithm>

#include "absl/random/random.h"
#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/lib/status.h"

namespace sightline::client {

struct RetryOptions {
  // How long to go on without any success, from the first failure; 0: one attempt alone.
  absl::Duration give_up_after = absl::Seconds(30);
  absl::Duration initial_delay = absl::Milliseconds(50);
  absl::Duration max_delay = absl::Seconds(5);
  double multiplier = 2.0;
};

class Backoff {
 public:
  explicit Backoff(const RetryOptions& options)
      : options_(options), bound_(options.initial_delay), next_bound_(options.initial_delay) {}

  // A random time between half the current bound and all of it; the bound grows from one call to
  // the next. Never less than what the server asked for, and up to half as much again, so that
  // clients that were refused together do not return together. And never more than `left`, after
  // which no attempt is made, unless the server asked for that.
  absl::Duration Next(const absl::Status& status, absl::Duration left = absl::InfiniteDuration()) {
    bound_ = next_bound_;
    next_bound_ = std::min(bound_ * options_.multiplier, options_.max_delay);
    return Again(status, left);
  }
  // The same, for one more failure of what Next was called for: the bound does not grow.
  absl::Duration Again(const absl::Status& status, absl::Duration left = absl::InfiniteDuration()) {
    const absl::Duration wait = bound_ * absl::Uniform(random_, 0.5, 1.0);
    const absl::Duration asked = RetryDelay(status).value_or(absl::ZeroDuration());
    return std::max(std::min(wait, left), asked * absl::Uniform(random_, 1.0, 1.5));
  }
  void Reset() { bound_ = next_bound_ = options_.initial_delay; }

 private:
  RetryOptions options_;
  absl::Duration bound_;  // Of the latest wait.
  absl::Duration next_bound_;
  absl::BitGen random_;
};

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_BACKOFF_H_
