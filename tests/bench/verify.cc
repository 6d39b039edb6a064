// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/verify.h"

#include <chrono>

#include "absl/strings/str_cat.h"
#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "tests/bench/verify_round.h"

namespace sightline::bench {
namespace {

// Streams of a seed: a batch's scene has one, each of its rounds another.
constexpr uint64_t kStreamsPerBatch = uint64_t{1} << 32;

VerifyReport RunBatch(const VerifyScene& scene, uint64_t batch, const VerifyOptions& options,
                      const CancelToken* stop, ThreadPool& pool) {
  std::vector<VerifyReport> reports(options.rounds_per_batch);
  pool.ParallelFor(
      reports.size(), 1,
      [&](size_t begin, size_t end) {
        for (size_t round = begin; round < end; ++round) {
          VerifyRound(scene, options, Random(options.seed, batch * kStreamsPerBatch + 1 + round),
                      absl::StrCat("seed ", options.seed, ", batch ", batch, ", round ", round),
                      &reports[round])
              .Run();
        }
      },
      stop);
  VerifyReport all;
  for (const VerifyReport& report : reports) all.Add(report);
  all.batches = 1;
  return all;
}

}  // namespace

void VerifyReport::Add(const VerifyReport& other) {
  for (const auto& [key, tally] : other.tallies) {
    tallies[key].compared += tally.compared;
    tallies[key].different += tally.different;
  }
  for (const auto& [place, rays] : other.places) places[place] += rays;
  batches += other.batches;
  rounds += other.rounds;
  auto_rays += other.auto_rays;
  brute_force_rays += other.brute_force_rays;
  different += other.different;
  for (const std::string& difference : other.differences) {
    if (differences.size() < kMostDifferences) differences.push_back(difference);
  }
}

VerifyReport Verify(std::span<const VerifyScene> given, const VerifyOptions& options) {
  ThreadPool pool(options.threads);
  VerifyReport all;
  CancelToken stop;  // Rounds that have not begun when time is up are left out.
  if (options.batches == 0) {
    stop.set_deadline(CancelToken::Clock::now() +
                      std::chrono::duration_cast<CancelToken::Clock::duration>(
                          std::chrono::duration<double>(options.seconds)));
  }
  for (uint64_t batch = options.first_batch;; ++batch) {
    if (options.batches > 0 ? batch - options.first_batch >= options.batches : stop.cancelled()) {
      break;
    }
    // Given and random scenes by turns.
    if (!given.empty() && batch % 2 == 0) {
      all.Add(RunBatch(given[batch / 2 % given.size()], batch, options, &stop, pool));
    } else {
      Random random(options.seed, batch * kStreamsPerBatch);
      all.Add(RunBatch(MakeRandomScene(options.max_random_triangles, random, pool), batch, options,
                       &stop, pool));
    }
    if (options.progress != nullptr) options.progress(all);
  }
  return all;
}

}  // namespace sightline::bench
