// SPDX-License-Identifier: Apache-2.0
//
// The synthetic cells and packets of papers 000 and 003. Both took theirs from Kensler and Shirley,
// whose generator none of the papers gives: this is a reconstruction from what they say of it.
//
// What is said: one random cell of triangles; packets of rays through it; any given triangle is hit
// with a probability of 25 %; the ratio of the cell's edge to a triangle's goes from 1 to 8; a
// packet's cross-section, `ray_jitter`, is 4 % of the cell's edge unless said otherwise.
//
// The reconstruction: the cell is [-1, 1]³. At a ratio of 1, a triangle's corners lie at random on
// the unit sphere, and a packet's rays begin at one random point 3 away from the middle and run
// through the middle of the cell, spread by the jitter. A line through a sphere's centre meets a
// random triangle of its surface points with a probability of exactly 1/4 (the mean area of a
// random spherical triangle is an eighth of the sphere, and a line has two ends), which is the
// 25 %. At a ratio of r, spheres are r times smaller and stand at random within the cell, and
// packets run through random points of it. A packet's targets are the pixels of a square grid
// across its axis, each moved at random within its pixel.
//
// Thread safety: plain values and functions.
//
//   const SyntheticCell cell = MakeCell(/*triangles=*/256, /*ratio=*/1, /*seed=*/1);
//   const auto rays = MakePacket(64, /*ratio=*/1, /*jitter=*/0.04, random);
#ifndef SIGHTLINE_TESTS_BENCH_PAPERS_SYNTHETIC_H_
#define SIGHTLINE_TESTS_BENCH_PAPERS_SYNTHETIC_H_

#include <array>
#include <cstdint>
#include <vector>

#include "core/geometry/vec3.h"
#include "tests/bench/random.h"

namespace sightline::bench {

struct SyntheticCell {
  std::vector<std::array<Vec3f, 3>> triangles;
};
SyntheticCell MakeCell(size_t triangles, double ratio, uint64_t seed);

// Rays with one origin. Directions are not normalized: t = 1 is the target.
struct SyntheticPacket {
  Vec3f origin;
  std::vector<Vec3f> directions;
};
// `size` is a square number; the jitter is in units of the cell's edge (of length 2).
SyntheticPacket MakePacket(size_t size, double ratio, double jitter, Random& random);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_PAPERS_SYNTHETIC_H_
