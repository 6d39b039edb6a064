// SPDX-License-Identifier: Apache-2.0
//
// How two sides' answers to the same queries compare, and who is right where they differ.
//
// Every difference is put to our own single-ray walk, and to brute force (the predicate on every
// triangle) as far as its budget reaches. Our answers are exact statements about the stored floats,
// the peer's are rounded: differences are expected, but only in which the exact answer is ours.
// beyond_rounding counts all others, and every query (differing or sampled) on which our own
// strategies contradict each other. It must be zero.
//
// Thread safety: plain values.
//
//   if (agreement.CanAffordBruteForce(scene)) agreement.by_brute_force += 1;
#ifndef SIGHTLINE_TESTS_BENCH_AGREEMENT_H_
#define SIGHTLINE_TESTS_BENCH_AGREEMENT_H_

#include <cstdint>
#include <string>
#include <vector>

#include "core/accel/indexed_geometry.h"

namespace sightline::bench {

struct Agreement {
  // Triangle tests that brute force may spend in one comparison: a few seconds.
  static constexpr uint64_t kBruteForceBudget = 500'000'000;
  static constexpr size_t kMostExamples = 5;

  bool settle = true;  // False: differences are counted, nobody is asked who is right.

  uint64_t queries = 0;
  uint64_t ties = 0;  // Primary: theirs is a triangle at the same distance that yields to ours.
  uint64_t disagreements = 0;         // Ties are none.
  uint64_t beyond_rounding = 0;       // As above.
  uint64_t by_single = 0;             // Queries put to the single-ray walk...
  uint64_t by_brute_force = 0;        // ... and to brute force.
  std::vector<std::string> examples;  // Of what is beyond rounding.

  bool CanAffordBruteForce(const IndexedGeometry& scene) const {
    return (by_brute_force + 1) * scene.geometry.triangles.size() <= kBruteForceBudget;
  }
  void Add(const Agreement& other) {
    queries += other.queries;
    ties += other.ties;
    disagreements += other.disagreements;
    by_single += other.by_single;
    by_brute_force += other.by_brute_force;
    for (const std::string& example : other.examples) AddBeyondRounding(example);
    beyond_rounding += other.beyond_rounding - other.examples.size();  // Not all are kept.
  }
  void AddBeyondRounding(std::string example) {
    ++beyond_rounding;
    if (examples.size() < kMostExamples) examples.push_back(std::move(example));
  }
};

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_AGREEMENT_H_
