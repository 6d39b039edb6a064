// SPDX-License-Identifier: Apache-2.0
//
// What is said to block points together, put to brute force point by point.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_TESTS_CORE_TRAVERSE_COVER_QUESTION_H_
#define SIGHTLINE_TESTS_CORE_TRAVERSE_COVER_QUESTION_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"

namespace sightline::testing_support {

inline Vec3d Anywhere(TestRng& rng, double size) {
  Vec3d p;
  for (int k = 0; k < 3; ++k) p[k] = rng.Uniform(-size, size);
  return p;
}

struct CoverQuestion {
  Vec3f common;  // The segments' start, or the rays' direction.
  uint32_t common_source = kNoTriangle;
  std::vector<Vec3f> points;
  std::vector<uint32_t> sources;  // Or none.

  Box3f box() const {
    Box3f box;
    for (const Vec3f p : points) box.Extend(p);
    return box;
  }

  void ExpectAllBlocked(const Kernels& kernels, const IndexedGeometry& scene, bool parallel) const {
    std::vector<TraceRay> rays;
    for (size_t i = 0; i < points.size(); ++i) {
      const uint32_t source = sources.empty() ? kNoTriangle : sources[i];
      if (parallel) {
        rays.push_back({.ray = PredicateRay::Ray(points[i], common),
                        .from_source = source,
                        .to_source = common_source});
      } else {
        rays.push_back({.ray = PredicateRay::Segment(common, points[i]),
                        .from_source = common_source,
                        .to_source = source});
      }
    }
    std::vector<Hit> hits(rays.size());
    WalkStats stats;
    EXPECT_TRUE(kernels.occluded_brute(scene, rays, hits, nullptr, &stats));
    for (size_t i = 0; i < rays.size(); ++i) {
      EXPECT_NE(hits[i].triangle, kNoTriangle) << Printed{rays[i]};
    }
  }
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_TRAVERSE_COVER_QUESTION_H_
