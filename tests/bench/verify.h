// SPDX-License-Identifier: Apache-2.0
//
// The soak: every way of asking the engine against every other, on the cases of verify_cases.h.
//
// Work comes in batches: a scene (given ones and random ones take turns) and a number of rounds on
// it. A round is a camera tile, with or without lights, or lights × points, or segments. Its truth
// is the strategy SINGLE on the BVH; AUTO is compared with it always, and by lot one other way on
// the BVH and one on the kd-tree or the binary BVH where the scene has them: any strategy, either
// instruction set, any size of packets, with and without culling in leaves. Some tiles look into
// mirrors, some segments end short of their points (t_min), some points name no source, and some
// are handed to AUTO bit by bit with hints. SINGLE and AUTO are compared with the independent walk
// and with brute force on a part of the round, brute force on scenes up to a number of triangles.
//
// The same seed, batch and scenes give the same work, whatever the number of threads and however
// long it goes on.
//
// Thread safety: functions; Verify uses threads of its own.
//
//   VerifyReport report = Verify({}, {.seed = 7, .batches = 20});
//   if (report.different > 0) std::cerr << report.differences.front();
#ifndef SIGHTLINE_TESTS_BENCH_VERIFY_H_
#define SIGHTLINE_TESTS_BENCH_VERIFY_H_

#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "tests/bench/verify_cases.h"

namespace sightline::bench {

struct VerifyReport {
  static constexpr size_t kMostDifferences = 20;

  struct Tally {
    uint64_t compared = 0, different = 0;
  };
  // By what was asked ("tiles", ...), the way ("AUTO on AVX-512") and what it was held against.
  using Key = std::tuple<std::string, std::string, std::string>;
  std::map<Key, Tally> tallies;
  // Rays of AUTO by where their eye or light stood.
  std::map<std::string, uint64_t> places;
  uint64_t batches = 0, rounds = 0;
  uint64_t auto_rays = 0;                // AUTO against SINGLE.
  uint64_t brute_force_rays = 0;         // AUTO against brute force.
  uint64_t different = 0;                // Of all comparisons.
  std::vector<std::string> differences;  // The first ones, with what brings them back.

  void Add(const VerifyReport& other);
};

struct VerifyOptions {
  uint64_t seed = 1;
  uint64_t first_batch = 0;
  // Ends after `batches`, or, if that is 0, once `seconds` have passed and the rounds in hand are
  // done.
  uint64_t batches = 0;
  double seconds = 0;
  uint64_t rounds_per_batch = 128;
  uint64_t max_random_triangles = 100'000;
  uint64_t max_brute_force_triangles = 100'000;
  // Triangle tests that brute force may spend in a round: about as long as the other ways take.
  uint64_t brute_force_tests = 1'000'000;
  uint64_t walked_rays = 32;  // Rays of a round that the independent walk repeats.
  int threads = 1;
  std::function<void(const VerifyReport&)> progress;  // After each batch; may be null.
};

// `given` may be empty. REQUIRES: each has a triangle that is not inert.
VerifyReport Verify(std::span<const VerifyScene> given, const VerifyOptions& options);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_VERIFY_H_
