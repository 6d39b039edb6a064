// SPDX-License-Identifier: Apache-2.0
//
// A walk of its own: one ray at a time, in scalar doubles, over a tree of its own, every node whose
// box the ray meets (no culling by distance, no order). Slow, short, and checked by eye: what the
// engine is held against where brute force would take too long.
//
// What it shares with the engine is what defines an answer, and nothing that finds one:
//  * the stored vertices, indices, masks and culling, by id (core/mesh/scene_geometry.h);
//  * the predicate as it is defined, in expansions throughout (BlocksExactly, SideOfPlane), without
//    the float and double stages that decide for the engine;
//  * the distance as it is defined (HitDistance).
// Neither a tree of core/accel, nor its leaves, nor a walk, test or margin of core/traverse is
// looked at: a builder that lost a triangle is found out as well as a walk that did.
//
// The tree parts the triangles at the median of their boxes' centres along the longest axis. Boxes
// are tested with a margin: each bound of the slab test is off by less than three roundings of
// doubles, and is widened by kSlabMargin of itself, some thirty times as much. A crossing that the
// predicate reports lies in the triangle, hence in its box, exactly.
//
// Thread safety: immutable after construction.
//
//   const IndependentWalk walk(scene.geometry);
//   const Hit hit = walk.Closest(scene.geometry, {.ray = PredicateRay::Segment(from, to)});
#ifndef SIGHTLINE_TESTS_BENCH_INDEPENDENT_WALK_H_
#define SIGHTLINE_TESTS_BENCH_INDEPENDENT_WALK_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/geometry/box3.h"
#include "core/intersect/hit.h"
#include "core/mesh/scene_geometry.h"
#include "core/traverse/trace_ray.h"

namespace sightline::bench {

inline constexpr double kSlabMargin = 0x1p-46;

class IndependentWalk {
 public:
  IndependentWalk() = default;  // Of nothing.
  explicit IndependentWalk(const SceneGeometry& geometry);

  // The first triangle that blocks, by (t, id). Occluded exactly if there is one. REQUIRES: the
  // geometry that it was made of.
  Hit Closest(const SceneGeometry& geometry, const TraceRay& query) const;

 private:
  // The lower half of an inner node follows it.
  struct Node {
    Box3f box;
    uint32_t upper = 0;             // The other half; 0: a leaf.
    uint32_t first = 0, count = 0;  // Of a leaf, in ids_.
  };
  // Appends the node over ids_[begin, end), and what hangs below it.
  void Part(const SceneGeometry& geometry, size_t begin, size_t end);

  std::vector<uint32_t> ids_;
  std::vector<Node> nodes_;
};

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_INDEPENDENT_WALK_H_
