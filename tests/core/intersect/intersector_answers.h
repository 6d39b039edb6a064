// SPDX-License-Identifier: Apache-2.0
//
// How two answers by one of the papers' tests differ, and whether they may: a walk that leaves
// triangles out against the same test over all of them.
//
// A walk leaves a triangle out because no ray of its can meet it, or none before the nearest hit,
// as exact arithmetic has it. So it may miss a hit only where the test's own bound
// (core/intersect/intersector_check.h) allows that there is none, or that it is no nearer. And it
// has one that all triangles together have not only where it leaves edge tests out
// (LeafCulling::skip_edges), and where that bound allows that there is one.
//
// Thread safety: pure functions.
//
//   DifferenceTally tally;
//   tally.Add(CompareHits(geometry, Intersector::kWald, ray, hit, truth));
//   EXPECT_EQ(tally.of(Difference::kBeyondBound), 0);
#ifndef SIGHTLINE_TESTS_CORE_INTERSECT_INTERSECTOR_ANSWERS_H_
#define SIGHTLINE_TESTS_CORE_INTERSECT_INTERSECTOR_ANSWERS_H_

#include <array>
#include <cstdint>
#include <ostream>

#include "core/intersect/hit.h"
#include "core/intersect/intersector.h"
#include "core/mesh/scene_geometry.h"

namespace sightline::testing_support {

enum class Difference : uint8_t {
  kNone,         // The same bits.
  kSliver,       // Within the bound; a triangle of an aspect ratio of 1000 or more.
  kEdge,         // Within the bound; the ray passes a triangle's edge closely.
  kEnd,          // Within the bound; an end of the segment is near a triangle's plane.
  kTie,          // Within the bound; both are hits, neither surely nearer.
  kPlain,        // Within the bound, for none of these reasons.
  kBeyondBound,  // Which must not be.
};
inline constexpr int kDifferences = 7;

// The longest edge over the height on it; +inf without area.
double AspectRatio(Vec3f a, Vec3f b, Vec3f c);

// Closest hits of one ray; `truth` is that of all triangles. `edges_left_out`: the walk may have
// left out edge tests.
Difference CompareHits(const SceneGeometry& geometry, Intersector kind, const PredicateRay& ray,
                       const Hit& hit, const Hit& truth, bool edges_left_out = false);

// Counts by kind; prints those that are not 0.
class DifferenceTally {
 public:
  void Add(Difference difference) { ++counts_[static_cast<int>(difference)]; }
  int64_t of(Difference difference) const { return counts_[static_cast<int>(difference)]; }
  int64_t compared() const;
  friend std::ostream& operator<<(std::ostream& out, const DifferenceTally& tally);

 private:
  std::array<int64_t, kDifferences> counts_ = {};
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_INTERSECT_INTERSECTOR_ANSWERS_H_
