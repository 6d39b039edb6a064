// SPDX-License-Identifier: Apache-2.0
//
// The papers' tables, one function each: measured here, the papers' own figures beside them.
//
// Thread safety: none; one at a time, and nothing else on the machine.
//
//   absl::Status status = Paper003(options, &report, context);
#ifndef SIGHTLINE_TESTS_BENCH_PAPERS_PAPERS_H_
#define SIGHTLINE_TESTS_BENCH_PAPERS_PAPERS_H_

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "tests/bench/command.h"
#include "tests/bench/measure.h"
#include "tests/bench/paper_report.h"

namespace sightline::bench {

struct PaperOptions {
  uint64_t repeats = 5;
  // Of real scenes; where a table is over scenes. Files that are not there are left out, and named.
  std::string scenes_folder;
  uint64_t size = 512;         // Pictures are square: a multiple of 16.
  std::string sphere = "10M";  // Triangles of the displaced sphere of paper 000's figures.
  // Everything as small as it can be, and quick: to see that it runs. The figures say nothing.
  bool quick = false;
};

// The median over `repeats` rounds of the calls' seconds, as ThreadSeconds counts: one round calls
// each in turn, each often enough for a few milliseconds. REQUIRES: they stay on their thread.
std::vector<double> SecondsByTurns(const std::vector<std::function<void()>>& calls,
                                   uint64_t repeats);

absl::Status Paper000(const PaperOptions& options, PaperReport* report, Context& context);
absl::Status Paper001(const PaperOptions& options, PaperReport* report, Context& context);
absl::Status Paper002(const PaperOptions& options, PaperReport* report, Context& context);
absl::Status Paper003(const PaperOptions& options, PaperReport* report, Context& context);
absl::Status Paper004(const PaperOptions& options, PaperReport* report, Context& context);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_PAPERS_PAPERS_H_
