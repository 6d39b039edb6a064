// SPDX-License-Identifier: Apache-2.0
//
// What a run measured. Requests that were planned within the measured interval count, whenever they
// were answered; rates and windows count answers that came within it.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CLIENT_LOAD_MEASUREMENT_H_
#define SIGHTLINE_CLIENT_LOAD_MEASUREMENT_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/load/histogram.h"
#include "client/load/request.h"

namespace sightline::load {

// Of one kind of request, or of all.
struct Series {
  uint64_t requests = 0;  // Planned within the interval; answered + failed once the run has ended.
  uint64_t answered = 0, failed = 0;
  uint64_t unsent = 0;            // Of the failed ones: never written to a stream.
  uint64_t answered_in_time = 0;  // Within the interval, whenever they were planned.
  uint64_t rays_in_time = 0, bytes_received_in_time = 0, bytes_sent_in_time = 0;
  // From the planned time to the last reply of answers. Requests that the run gave up on are in it
  // with the time that they had waited by then: an answer would have taken longer still.
  LatencyHistogram planned;
  LatencyHistogram sent;  // From the send; answers alone.

  // Of the failed ones: those that the run gave up on.
  uint64_t given_up() const { return planned.count() - answered; }
};

// Failures by their code, an absl::StatusCode.
inline constexpr size_t kCodes = 17;
using CodeCounts = std::array<uint64_t, kCodes>;

// An equal part of the interval: what came in it, whenever it was planned.
struct Window {
  uint64_t answered = 0, failed = 0;
  uint64_t rays = 0, bytes_received = 0, bytes_sent = 0;  // Of the answers.
  CodeCounts failed_by_code{};
  LatencyHistogram planned, sent;
};

struct Measurement {
  absl::Time begin;
  absl::Duration elapsed;  // Of the interval.
  absl::Duration window;   // Of one window.
  Series all;
  std::array<Series, kKinds> by_kind;
  std::vector<Window> windows;             // Complete ones.
  std::map<std::string, uint64_t> errors;  // By code and reason: "RESOURCE_EXHAUSTED QUEUE_FULL".
  CodeCounts failed_by_code{};
  absl::Status first_error;
  LatencyHistogram server_queue, server_compute;
  // Of a closed loop: how often a request waited after the refusal of the one before it, and how
  // long within the interval, all together.
  uint64_t refusal_waits = 0;
  absl::Duration refusal_wait;
  uint64_t checked = 0, wrong = 0;  // Warm-up included.
  std::string first_wrong;

  double Rate() const { return PerSecond(all.answered_in_time); }
  double PerSecond(uint64_t count) const {
    const double seconds = absl::ToDoubleSeconds(elapsed);
    return seconds > 0 ? static_cast<double>(count) / seconds : 0;
  }
  double ErrorShare() const {
    return all.requests == 0 ? 0
                             : static_cast<double>(all.failed) / static_cast<double>(all.requests);
  }
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_MEASUREMENT_H_
