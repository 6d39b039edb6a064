// SPDX-License-Identifier: Apache-2.0
//
// Smooth noise for terrain, stones and skin: gradients on an integer lattice, joined by quintics,
// and sums of octaves of it. Deterministic: hashes, products and sums only.
//
// Thread safety: pure functions.
//
//   const double height = 40 * Fbm({x / 100, y / 100, 0}, 6, seed);
#ifndef SIGHTLINE_CORE_MESH_BUILTIN_NOISE_H_
#define SIGHTLINE_CORE_MESH_BUILTIN_NOISE_H_

#include <cstdint>

#include "core/geometry/vec3.h"

namespace sightline {

// About [-1, 1], 0 on average, wavelength about 1. REQUIRES: |coordinates| < 2^40.
double GradientNoise(Vec3d p, uint64_t seed);

// `octaves` of noise, each half as wide and half as high as the one before; about [-1, 1].
double Fbm(Vec3d p, int octaves, uint64_t seed);

// Ridges: octaves of 1 - |noise|, squared, each weighted by the one before, so that valleys stay
// smooth; about [0, 1].
double Ridged(Vec3d p, int octaves, uint64_t seed);

// The same of a plane, at half the price: heights over a map.
double GradientNoise2(double x, double y, uint64_t seed);
double Fbm2(double x, double y, int octaves, uint64_t seed);
double Ridged2(double x, double y, int octaves, uint64_t seed);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_BUILTIN_NOISE_H_
