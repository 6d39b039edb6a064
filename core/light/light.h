// SPDX-License-Identifier: Apache-2.0
//
// Lights, and the samples they are asked about as. A sample is a stored point or a stored
// direction: what a segment starts at, or runs toward. Samples can be read back.
//
// Sample k of an area light does not depend on how many samples there are: it is the k-th element
// of the R2 sequence (the additive recurrence of the plastic number's inverse powers), in double in
// one fixed order.
//
// Thread safety: plain values and functions.
//
//   std::vector<LightSample> samples;
//   absl::Status status = AppendSamples(Light::Point({1, 2, 3}), 0, scene.geometry.origin,
//   &samples);
#ifndef SIGHTLINE_CORE_LIGHT_LIGHT_H_
#define SIGHTLINE_CORE_LIGHT_LIGHT_H_

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "core/geometry/vec3.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

struct Light {
  enum class Kind : uint8_t { kPoint, kDirectional, kRectangle };
  Kind kind = Kind::kPoint;
  Vec3d position;   // kPoint: the light; kRectangle: its centre. World coordinates.
  Vec3d direction;  // kDirectional: toward the light; its largest |component| in [2^-20, 2^20].
  Vec3d half_u, half_v;  // kRectangle: from the centre to the middle of two neighbouring sides.
  uint32_t sample_count = 1;  // kRectangle: 1 .. kMaxLightSamples. Others: 1.
  uint32_t mask = 0xFFFFFFFFu;
  // Global id of the triangle the light lies on, which then does not block it; kNoTriangle: none.
  uint32_t source_triangle = kNoTriangle;
  double weight = 1.0;  // Of the whole light, in weighted sums; finite.

  static Light Point(Vec3d position) { return {.kind = Kind::kPoint, .position = position}; }
  static Light Directional(Vec3d toward) {
    return {.kind = Kind::kDirectional, .direction = toward};
  }
};

inline constexpr uint32_t kMaxLightSamples = 1u << 16;

struct LightSample {
  bool directional = false;
  bool valid = true;   // False: not finite, out of range, or no direction. Answers are INVALID.
  Vec3f value;         // A stored point, or a stored direction.
  uint32_t light = 0;  // Index of the light it belongs to.
  uint32_t mask = 0xFFFFFFFFu;
  uint32_t source_triangle = kNoTriangle;
};

// Appends the samples of light number `index` in order, rebased to `origin`. A non-finite or
// out-of-range light gives samples marked invalid (not an error: the rest is answered).
// InvalidArgument: a sample count outside its range, an unknown kind, a weight that is not finite;
// each named with its value. The same bits whatever the caller's floating-point state.
absl::Status AppendSamples(const Light& light, uint32_t index, Vec3d origin,
                           std::vector<LightSample>* samples);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_LIGHT_LIGHT_H_
