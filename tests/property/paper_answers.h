// SPDX-License-Identifier: Apache-2.0
//
// Queries by one of the papers' tests: the ways that take one, what it says of one ray by looking
// at every triangle in turn, and whether two answers by any hit may differ (of first hits
// tests/core/intersect/intersector_answers.h says it).
//
// Thread safety: pure functions.
//
//   for (const QueryOptions& way : WaysBy(Intersector::kWald, kStructures)) ...
//   const Hit truth = FirstHitBy(geometry, Intersector::kWald, {.ray = ray, .near = t});
#ifndef SIGHTLINE_TESTS_PROPERTY_PAPER_ANSWERS_H_
#define SIGHTLINE_TESTS_PROPERTY_PAPER_ANSWERS_H_

#include <span>
#include <vector>

#include "core/intersect/hit.h"
#include "core/intersect/intersector.h"
#include "core/mesh/scene_geometry.h"
#include "core/query/options.h"
#include "core/traverse/trace_ray.h"

namespace sightline::testing_support {

// Single rays and packets over each of the structures, with and without culling in leaves.
std::vector<QueryOptions> WaysBy(Intersector intersector, std::span<const Structure> structures);

// Whether the way leaves tests of edges out, and may find what they deny in doubt.
bool LeavesEdgesOut(const QueryOptions& way);

// The definition of brute force by a test: written down a second time, and asking what every query
// of the engine asks of a triangle (sources, masks, sides, where hits begin to count).
Hit FirstHitBy(const SceneGeometry& geometry, Intersector kind, const TraceRay& query);

// Whether any hit may be `blocked` by a walk where all triangles together say the opposite: it may
// lose blockers in doubt alone, and have one more only where it leaves edges out.
bool MayDifferByAnyHit(const SceneGeometry& geometry, Intersector kind, const TraceRay& query,
                       bool blocked, bool edges_left_out);

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_PROPERTY_PAPER_ANSWERS_H_
