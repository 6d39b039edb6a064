// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/papers/precision.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/intersect/intersector-inl.h"

namespace sightline::bench {
namespace {

namespace simd = HWY_NAMESPACE;  // The baseline's, of which only scalar code is used.
using Doubles = simd::ScalarOps<double>;

struct Rows {
  const double* value;
  double operator()(int i) const { return value[i]; }
};

simd::Vec3V<double> Wide(Vec3f v) { return {v.x, v.y, v.z}; }

}  // namespace

Precision PrecisionOf(Intersector kind, const std::vector<std::array<Vec3f, 3>>& triangles,
                      const std::vector<Vec3f>& origins, const std::vector<Vec3f>& directions) {
  constexpr float kFar = std::numeric_limits<float>::infinity();
  Precision result;
  double t_squares = 0, point_squares = 0;
  for (const auto& [a, b, c] : triangles) {
    const PreparedTriangle prepared = PrepareTriangle(kind, a, b, c);
    double rows[kPreparedFloats];
    simd::Prepare<Doubles>(Intersector::kKenslerShirley, 2, Wide(a), Wide(b), Wide(c), rows);
    for (size_t r = 0; r < origins.size(); ++r) {
      const simd::Tested<Doubles> truth = simd::Test<Intersector::kKenslerShirley, Doubles>(
          Rows{rows}, {Wide(origins[r]), Wide(directions[r]), kFar});
      IntersectorHit hit;
      const bool found = Intersect(kind, prepared, origins[r], directions[r], kFar, &hit);
      result.otherwise += found != truth.hit;
      if (!found || !truth.hit) continue;
      ++result.hits;
      const double t = std::abs(hit.t - truth.t) / truth.t;
      result.worst_t = std::max(result.worst_t, t);
      t_squares += t * t;
      const double du = hit.u - truth.u, dv = hit.v - truth.v;
      point_squares += (du * du + dv * dv) / (truth.u * truth.u + truth.v * truth.v);
    }
  }
  const double hits = static_cast<double>(std::max<uint64_t>(result.hits, 1));
  result.t = t_squares / hits;
  result.point = point_squares / hits;
  return result;
}

}  // namespace sightline::bench
