// SPDX-License-Identifier: Apache-2.0
//
// Loops of ray-triangle tests over prepared arrays, compiled per instruction set: what paper 003's
// tables time. Each ray is put to each triangle.
//
// Ordinary passes let the nearest hit so far end tests early; the worst case never does (the paper
// switches the termination by t off).
//
// Thread safety: functions over constant data.
//
//   const PassData data = MakePassData(Intersector::kWald, triangles, packets);
//   const uint64_t hits = RunPass({Intersector::kWald, PassForm::kRays, 8, /*worst=*/false}, data);
#ifndef SIGHTLINE_TESTS_BENCH_PAPERS_INTERSECTOR_PASSES_H_
#define SIGHTLINE_TESTS_BENCH_PAPERS_INTERSECTOR_PASSES_H_

#include <array>
#include <cstdint>
#include <vector>

#include "core/base/aligned_vector.h"
#include "core/geometry/vec3.h"
#include "core/intersect/intersector.h"

namespace sightline::bench {

enum class PassForm : uint8_t {
  kOne,        // One ray, one triangle at a time: all there is of kHavelHeroutDotProduct.
  kTriangles,  // One ray, triangles in lanes.
  kRays,       // Rays in lanes, one triangle.
};

struct PassSpec {
  Intersector kind = Intersector::kHavelHerout;
  PassForm form = PassForm::kOne;
  int lanes = 1;  // 4, 8 or (AVX-512) 16 where there are any.
  bool worst = false;
};

struct PassData {
  AlignedVector<PreparedTriangle> triangles;
  std::vector<Vec3f> corners;  // Three of each.
  std::array<AlignedVector<float>, kPreparedFloats> triangle_rows;
  std::vector<Vec3f> origins, directions;
  std::array<AlignedVector<float>, 6> ray_rows;

  uint64_t tests() const { return uint64_t{triangles.size()} * origins.size(); }
};
// REQUIRES: numbers of triangles and rays are multiples of 16.
PassData MakePassData(Intersector kind, const std::vector<std::array<Vec3f, 3>>& triangles,
                      const std::vector<Vec3f>& origins, const std::vector<Vec3f>& directions);

// Whether this machine has so many lanes (and 4 and 8 it has).
bool HasLanes(int lanes);
// How many rays a register of this machine holds.
inline int RegisterRays() { return HasLanes(16) ? 16 : 8; }

// Returns how many hits were found, in ordinary passes those nearer than the ones before.
uint64_t RunPass(const PassSpec& spec, const PassData& data);

// Prepares all triangles from their corners, one at a time or (kHavelHerout alone) in lanes;
// returns a sum of the results' bits, so that they cannot be left out.
uint64_t RunPreparation(Intersector kind, int lanes, const PassData& data);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_PAPERS_INTERSECTOR_PASSES_H_
