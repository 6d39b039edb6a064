// SPDX-License-Identifier: Apache-2.0
//
// A walk over the BVH that shares nothing with those of core/traverse but the tree: one ray at a
// time, in scalar doubles, every node whose box the ray meets (no culling by distance, no order),
// the exact predicate on the corners of the geometry. Slow, short, and checked by eye: what the
// fast walks are held against where brute force would take too long.
//
// Boxes are tested with a margin: each bound of the slab test is off by less than three roundings
// of doubles, and is widened by kSlabMargin of itself, some thirty times as much. A crossing that
// the predicate reports lies in the triangle, hence in its box, exactly.
//
// Thread safety: functions only.
//
//   const Hit hit = WalkIndependently(scene, {.ray = PredicateRay::Segment(from, to)});
#ifndef SIGHTLINE_TESTS_BENCH_INDEPENDENT_WALK_H_
#define SIGHTLINE_TESTS_BENCH_INDEPENDENT_WALK_H_

#include "core/accel/indexed_geometry.h"
#include "core/intersect/hit.h"
#include "core/traverse/trace_ray.h"

namespace sightline::bench {

inline constexpr double kSlabMargin = 0x1p-46;

// The first triangle that blocks, by (t, id). Occluded exactly if there is one.
Hit WalkIndependently(const IndexedGeometry& scene, const TraceRay& query);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_INDEPENDENT_WALK_H_
