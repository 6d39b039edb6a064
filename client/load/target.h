// SPDX-License-Identifier: Apache-2.0
//
// What requests are sent to: a server over its streams (server_target.h), or a test's stand-in.
//
// Thread safety: every method from any thread.
#ifndef SIGHTLINE_CLIENT_LOAD_TARGET_H_
#define SIGHTLINE_CLIENT_LOAD_TARGET_H_

#include <functional>

#include "absl/status/status.h"
#include "client/load/request.h"

namespace sightline::load {

class Target {
 public:
  using OnDone = std::function<void(const Outcome&)>;

  virtual ~Target() = default;
  // Who hears of every outcome, once per request, from threads of the target's. Called before the
  // first Send.
  virtual void SetOnDone(OnDone on_done) = 0;
  // Takes the request and does not wait for its answer. Every request taken gets one outcome.
  virtual void Send(const Request& request) = 0;
  // Ends what is unanswered: its outcomes come soon, as CANCELLED and given up.
  virtual void CancelAll() = 0;
  // Not OK once the target cannot be reached any more.
  virtual absl::Status status() const = 0;
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_TARGET_H_
