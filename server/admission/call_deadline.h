// SPDX-License-Identifier: Apache-2.0
//
// Whose end it is when gRPC says that a call is cancelled: the client's, which asked for it or has
// gone, or the deadline's. gRPC tells both alike.
//
// A client's own clock often ends a call before the server's does: what it sends is the time that
// it has left, rounded up to two or three digits. So an end that comes that little too early is the
// deadline's, too.
//
// Thread safety: constant once made.
//
//   const CallDeadline deadline(*context);          // When the call begins,
//   deadline.Fire(&cancel);                         // and when it is cancelled.
#ifndef SIGHTLINE_SERVER_ADMISSION_CALL_DEADLINE_H_
#define SIGHTLINE_SERVER_ADMISSION_CALL_DEADLINE_H_

#include <grpcpp/server_context.h>

#include <chrono>

#include "core/base/cancel.h"

namespace sightline {

class CallDeadline {
 public:
  using Clock = std::chrono::system_clock;

  explicit CallDeadline(const grpc::ServerContextBase& context)
      : CallDeadline(Clock::now(), context.deadline()) {}
  // Without a deadline: time_point::max().
  CallDeadline(Clock::time_point begin, Clock::time_point deadline)
      : earliest_(deadline - (deadline - begin) / kRounding - kDelivery) {}

  // Whether it is what ends a call that is cancelled at `now`.
  bool Ends(Clock::time_point now = Clock::now()) const { return now >= earliest_; }

  // Stops what runs for a call that was cancelled: DEADLINE_EXCEEDED or CANCELLED.
  void Fire(CancelToken* cancel) const {
    if (Ends()) {
      cancel->set_deadline(CancelToken::Clock::now());
    } else {
      cancel->Cancel();
    }
  }

 private:
  // The coarsest of gRPC's roundings: 1,001 ms are sent as 101 times ten of them, 10,001 ms as 101
  // tenths of a second, and so on.
  static constexpr int kRounding = 100;
  // By so much a cancel may be faster on its way than the call was. Few clients cancel by
  // themselves within the last milliseconds.
  static constexpr std::chrono::milliseconds kDelivery{5};

  const Clock::time_point earliest_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_CALL_DEADLINE_H_
