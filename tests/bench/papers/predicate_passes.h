// SPDX-License-Identifier: Apache-2.0
//
// Loops of ray-triangle tests by the predicate, by the very routines of the engine's walks: its
// rates beside those of the papers' tests (intersector_passes.h). Each ray is put to each triangle.
//
// The predicate has no triangles prepared for the scene: what a packet shares of a triangle is made
// anew for its origin, and that is timed with it. It looks at no distance before its edges, so that
// the nearest hit so far ends no test early: its worst case is its ordinary one. What is hit first
// takes the distance of every hit, in doubles, and where a quarter of all tests hit that is most of
// the work; what is hit at all, as for shadows, does not.
//
// Thread safety: none; a pass writes its packets' results.
//
//   PredicateData data = MakePredicateData(triangles, packets);
//   const uint64_t hit = RunPredicatePass(PassForm::kRays, 16, /*distances=*/true, &data);
#ifndef SIGHTLINE_TESTS_BENCH_PAPERS_PREDICATE_PASSES_H_
#define SIGHTLINE_TESTS_BENCH_PAPERS_PREDICATE_PASSES_H_

#include <array>
#include <cstdint>
#include <vector>

#include "core/accel/indexed_geometry.h"
#include "core/base/aligned_vector.h"
#include "core/traverse/trace_ray.h"
#include "tests/bench/papers/intersector_passes.h"
#include "tests/bench/papers/synthetic.h"

namespace sightline::bench {

struct PredicateData {
  IndexedGeometry scene;      // Nothing but that all objects are seen from everywhere.
  AlignedVector<float> rows;  // As of one long leaf (core/accel/bvh.h).
  uint32_t triangles = 0;
  std::vector<RayPacket> packets;

  uint64_t rays() const;
  uint64_t tests() const { return triangles * rays(); }
};
// Packets are cut into such of `packet_rays`. REQUIRES: the number of triangles is a multiple of
// 16, that of each packet's rays one of `packet_rays`, and this one of 8, at most
// RayPacket::kMaxRays.
PredicateData MakePredicateData(const std::vector<std::array<Vec3f, 3>>& triangles,
                                const std::vector<SyntheticPacket>& packets, size_t packet_rays);

// kTriangles or kRays; 8 lanes, or 16 where there are as many; with the distances of all hits, and
// the nearest kept, or without. Returns how many rays hit something.
uint64_t RunPredicatePass(PassForm form, int lanes, bool distances, PredicateData* data);

// What kRays makes of the triangles for each packet's origin, alone. Returns a sum of the results,
// so that they cannot be left out.
uint64_t RunPredicatePreparation(int lanes, PredicateData* data);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_PAPERS_PREDICATE_PASSES_H_
