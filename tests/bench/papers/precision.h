// SPDX-License-Identifier: Apache-2.0
//
// How far the papers' tests are off: against Kensler and Shirley's in doubles, as paper 003
// (section V) measures them, by the mean square of the relative error.
//
// Thread safety: pure functions.
//
//   const Precision p = PrecisionOf(Intersector::kWald, cell.triangles, origins, directions);
#ifndef SIGHTLINE_TESTS_BENCH_PAPERS_PRECISION_H_
#define SIGHTLINE_TESTS_BENCH_PAPERS_PRECISION_H_

#include <array>
#include <cstdint>
#include <vector>

#include "core/geometry/vec3.h"
#include "core/intersect/intersector.h"

namespace sightline::bench {

struct Precision {
  uint64_t hits = 0;        // By both.
  uint64_t otherwise = 0;   // By one of them alone.
  double t = 0, point = 0;  // Mean square relative errors of t and of the hit point (u, v).
  double worst_t = 0;       // The largest relative error of t.
};

// REQUIRES: kind != kExact; as many origins as directions.
Precision PrecisionOf(Intersector kind, const std::vector<std::array<Vec3f, 3>>& triangles,
                      const std::vector<Vec3f>& origins, const std::vector<Vec3f>& directions);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_PAPERS_PRECISION_H_
