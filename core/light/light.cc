// SPDX-License-Identifier: Apache-2.0
#include "core/light/light.h"

#include <cmath>

#include "absl/base/attributes.h"
#include "absl/strings/str_cat.h"
#include "core/base/float_environment.h"
#include "core/base/status_macros.h"
#include "core/mesh/rebase.h"

namespace sightline {
namespace {

// Roberts' R2 sequence: steps 1/g and 1/g² for the plastic number g = 1.3247179572447460… (g³ = g +
// 1), here floor(2^64/g) and floor(2^64/g²). In fixed point the recurrence is an integer product
// modulo 2^64: sample k comes from k alone, with no rounding to gather.
constexpr uint64_t kStepU = 0xC13FA9A902A6328Fu;
constexpr uint64_t kStepV = 0x91E10DA5C79E7B1Cu;
constexpr uint64_t kHalf = 0x8000000000000000u;

// What the largest component of a direction may be (light.h). Both are floats, so a direction in
// range is still in range once rounded.
constexpr double kMinDirection = 0x1p-20;
constexpr double kMaxDirection = 0x1p20;

// frac(½ + k·step) mapped from [0, 1) to [-1, 1): the upper 53 bits are a double, and so are 2x and
// 2x - 1.
double Recurrence(uint64_t k, uint64_t step) {
  const double share = static_cast<double>((kHalf + k * step) >> 11) * 0x1p-53;
  return 2 * share - 1;
}

absl::Status CheckLight(const Light& light, uint32_t index) {
  switch (light.kind) {
    case Light::Kind::kPoint:
    case Light::Kind::kDirectional:
      if (light.sample_count != 1) {
        return absl::InvalidArgumentError(absl::StrCat("light ", index,
                                                       ": sample_count = ", light.sample_count,
                                                       ", but only a rectangle has more than 1"));
      }
      break;
    case Light::Kind::kRectangle:
      if (light.sample_count == 0 || light.sample_count > kMaxLightSamples) {
        return absl::InvalidArgumentError(absl::StrCat("light ", index,
                                                       ": sample_count = ", light.sample_count,
                                                       " is outside 1 .. ", kMaxLightSamples));
      }
      break;
    default:
      return absl::InvalidArgumentError(
          absl::StrCat("light ", index, ": kind = ", static_cast<int>(light.kind),
                       " is unknown; there are point (0), directional (1) and rectangle (2)"));
  }
  if (!std::isfinite(light.weight)) {
    return absl::InvalidArgumentError(
        absl::StrCat("light ", index, ": weight = ", light.weight, " is not finite"));
  }
  return absl::OkStatus();
}

// Not inlined: compilers do not order arithmetic against the change of the floating-point state.
ABSL_ATTRIBUTE_NOINLINE void AppendChecked(const Light& light, uint32_t index, Vec3d origin,
                                           std::vector<LightSample>* samples) {
  LightSample sample{.directional = light.kind == Light::Kind::kDirectional,
                     .light = index,
                     .mask = light.mask,
                     .source_triangle = light.source_triangle};
  switch (light.kind) {
    case Light::Kind::kPoint:
      sample.valid = Rebase(light.position, origin, &sample.value);
      samples->push_back(sample);
      break;
    case Light::Kind::kDirectional: {
      const double size = MaxAbs(light.direction);  // NaN fails both comparisons.
      sample.valid = size >= kMinDirection && size <= kMaxDirection;
      if (sample.valid) sample.value = ToFloat(light.direction) + Vec3f{0.0f, 0.0f, 0.0f};
      samples->push_back(sample);
      break;
    }
    case Light::Kind::kRectangle:
      for (uint32_t k = 0; k < light.sample_count; ++k) {
        const Vec3d world = (light.position + light.half_u * Recurrence(k, kStepU)) +
                            light.half_v * Recurrence(k, kStepV);
        sample.valid = Rebase(world, origin, &sample.value);
        samples->push_back(sample);
      }
      break;
  }
}

}  // namespace

absl::Status AppendSamples(const Light& light, uint32_t index, Vec3d origin,
                           std::vector<LightSample>* samples) {
  SL_RETURN_IF_ERROR(CheckLight(light, index));
  const ScopedFloatEnvironment environment;
  AppendChecked(light, index, origin, samples);
  return absl::OkStatus();
}

}  // namespace sightline
