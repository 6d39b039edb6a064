// SPDX-License-Identifier: Apache-2.0
//
// An area light as a walk for all of its samples together sees it: a parallelogram, and where in it
// each sample lies.
//
// Thread safety: plain values; pure functions.
//
//   const LightHull light = FitLightHull(samples);
//   if (light.flat()) { ... samples[k] is light.centre + light.along[0][k] * light.half[0] + ... }
#ifndef SIGHTLINE_CORE_TRAVERSE_LIGHT_HULL_H_
#define SIGHTLINE_CORE_TRAVERSE_LIGHT_HULL_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/geometry/vec3.h"

namespace sightline {

// Sample k is centre + along[0][k]·half[0] + along[1][k]·half[1] + r, with |along| <= 1 and
// |r|_inf <= rest.
struct LightHull {
  static constexpr size_t kMostSamples = 16;

  uint32_t count = 0;
  Vec3f samples[kMostSamples];
  Vec3f centre;
  Vec3f half[2];
  float rest = 0;
  alignas(64) float along[2][kMostSamples] = {};  // 0 beyond the last sample.
  alignas(64) float rows[3][kMostSamples];        // The samples by axis, and the first one again.

  // Whether what the parallelogram leaves over is next to nothing, as for samples of a rectangle
  // that were rounded.
  bool flat() const;
};

// The least rectangle that has one of its sides along two samples. REQUIRES: 1 .. kMostSamples
// samples, which are stored points (core/mesh/scene_geometry.h).
LightHull FitLightHull(std::span<const Vec3f> samples);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_LIGHT_HULL_H_
