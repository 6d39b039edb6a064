// SPDX-License-Identifier: Apache-2.0
//
// What every kind of query shares: strategy, masks, cancellation, statistics.
//
// None of these options changes an answer, except the mask: a strategy, a thread count or an
// instruction set only decides how fast the one exact answer is found.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_QUERY_OPTIONS_H_
#define SIGHTLINE_CORE_QUERY_OPTIONS_H_

#include <cstdint>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/base/cancel.h"
#include "core/traverse/simd_target.h"

namespace sightline {

enum class Strategy : uint8_t {
  kAuto = 0,
  kSingle = 1,      // One ray at a time.
  kPacket = 2,      // Rays with a common origin walk together.
  kBruteForce = 3,  // The predicate applied to every triangle: the definition.
  kShaft = 4,       // Rays with a common origin as one convex shaft.
};

absl::string_view StrategyName(
    Strategy strategy);  // "AUTO", "SINGLE", "PACKET", "BRUTE_FORCE", "SHAFT".
// By that name, in any case. InvalidArgument listing the names.
absl::StatusOr<Strategy> ParseStrategy(absl::string_view name);

struct QueryOptions {
  Strategy strategy = Strategy::kAuto;
  SimdTarget simd = SimdTarget::kBest;  // REQUIRES: SimdTargetAvailable(simd).
  uint32_t mask = 0xFFFFFFFFu;
  const CancelToken* cancel = nullptr;  // Polled during traversal; may be null.
};

// Work done, summed over whatever the statistics belong to. Depends on strategy and target; not
// part of the answer.
struct QueryStats {
  uint64_t rays = 0;   // Segments asked about (invalid ones not counted).
  uint64_t nodes = 0;  // Eight-wide nodes visited, once per packet or ray.
  uint64_t leaves = 0;
  uint64_t triangle_tests = 0;          // Triangle × ray pairs the predicate looked at.
  uint64_t doubt_double = 0;            // Pairs the float stage left to doubles…
  uint64_t doubt_exact = 0;             // … and those that doubles left to exact arithmetic.
  uint64_t compute_nanoseconds = 0;     // Summed over threads.
  Strategy strategy = Strategy::kAuto;  // What AUTO chose; kAuto where more than one was used.

  void Add(const QueryStats& other);
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_OPTIONS_H_
