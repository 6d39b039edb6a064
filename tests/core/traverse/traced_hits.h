// SPDX-License-Identifier: Apache-2.0
//
// The hits of rays by one of the walks.
//
// Thread safety: functions only.
//
//   const std::vector<Hit> truth = Trace(kernels().closest_brute, scene, rays);
#ifndef SIGHTLINE_TESTS_CORE_TRAVERSE_TRACED_HITS_H_
#define SIGHTLINE_TESTS_CORE_TRAVERSE_TRACED_HITS_H_

#include <span>
#include <vector>

#include "core/accel/indexed_geometry.h"
#include "core/intersect/hit.h"
#include "core/traverse/kernels.h"
#include "core/traverse/trace_ray.h"
#include "gtest/gtest.h"

namespace sightline::testing_support {

inline std::vector<Hit> Trace(TraceRaysFn trace, const IndexedGeometry& scene,
                              std::span<const TraceRay> rays) {
  std::vector<Hit> hits(rays.size(), Hit{-1, 12345});  // Whatever was there must be overwritten.
  WalkStats stats;
  EXPECT_TRUE(trace(scene, rays, hits, nullptr, &stats));
  return hits;
}

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_TRAVERSE_TRACED_HITS_H_
