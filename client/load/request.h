// SPDX-License-Identifier: Apache-2.0
//
// A request of a load test, and what became of it. Each has three times: when it was due, when its
// item was written to its stream, when its last reply had been read.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CLIENT_LOAD_REQUEST_H_
#define SIGHTLINE_CLIENT_LOAD_REQUEST_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"

namespace sightline::load {

enum class Kind : uint8_t { kTiles = 0, kPoints = 1, kSegments = 2 };
inline constexpr size_t kKinds = 3;
inline constexpr std::array<const char*, kKinds> kKindNames = {"tiles", "points", "segments"};
inline const char* KindName(Kind kind) { return kKindNames[static_cast<size_t>(kind)]; }

// Which of the workload's prepared items a request sends.
struct Work {
  Kind kind = Kind::kTiles;
  size_t item = 0;  // Within the kind.
};

struct Request {
  uint64_t number = 0;  // From 0 in order of planning.
  Work work;
  absl::Time planned;
  uint64_t slot = 0;  // Of a closed loop: which of those that are under way.
};

// How an answer compares with the reference's. One that cannot be decoded is wrong.
enum class Verdict : uint8_t { kNotChecked, kEqual, kWrong };

struct Outcome {
  Request request;
  absl::Time sent = absl::InfiniteFuture();  // InfiniteFuture: it never was.
  absl::Time received;
  absl::Status status;
  // The run ended while it waited: an answer would have come later than `received`.
  bool given_up = false;
  uint64_t rays = 0;  // Asked for.
  uint64_t bytes_sent = 0, bytes_received = 0;
  // What the server says of it; zero where it says nothing.
  absl::Duration server_queue, server_compute;
  int64_t revision = 0;
  Verdict verdict = Verdict::kNotChecked;
  std::string difference;  // Of a wrong answer: what it answers, and where it differs first.
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_REQUEST_H_
