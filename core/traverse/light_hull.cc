// SPDX-License-Identifier: Apache-2.0
#include "core/traverse/light_hull.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/check.h"

namespace sightline {
namespace {

// Shares of the light's size, and of how far out it lies, that the rest may have. Rounded samples
// of a rectangle are far below either. Beyond, bounds that carry the rest would leave most in
// doubt; and with coordinates up to 2^41 they might overflow (core/shaft/margins.h).
constexpr double kFlatShare = 0x1p-8, kRoundingShare = 0x1p-20;

// Where the samples lie along an axis.
struct Extent {
  double least = std::numeric_limits<double>::infinity(), most = -least;

  Extent(std::span<const Vec3f> samples, Vec3d from, Vec3d axis) {
    for (const Vec3f& sample : samples) {
      const double at = Dot(ToDouble(sample) - from, axis);
      least = std::min(least, at);
      most = std::max(most, at);
    }
  }
  double size() const { return most - least; }
};

// Across the plane that the samples spread in most; null if they lie in a line.
Vec3d NormalOf(std::span<const Vec3f> samples, Vec3d from) {
  Vec3d normal;
  for (size_t i = 0; i < samples.size(); ++i) {
    for (size_t j = i + 1; j < samples.size(); ++j) {
      const Vec3d n = Cross(ToDouble(samples[i]) - from, ToDouble(samples[j]) - from);
      if (Dot(n, n) > Dot(normal, normal)) normal = n;
    }
  }
  return normal;
}

// Whether all samples lie on one side of a line, or next to it: `across` it, within their plane. A
// rectangle that has no side along such a line is not the least one.
bool IsOuterLine(std::span<const Vec3f> samples, Vec3d from, Vec3d across) {
  constexpr double kNextTo = 0x1p-20;  // Of the largest product, for samples that were rounded.
  double least = 0, most = 0;
  for (const Vec3f& sample : samples) {
    const double at = Dot(ToDouble(sample) - from, across);
    least = std::min(least, at);
    most = std::max(most, at);
    if (most > kNextTo * -least && -least > kNextTo * most) return false;
  }
  return true;
}

double Size(Vec3f v) {
  return std::abs(double{v.x}) + std::abs(double{v.y}) + std::abs(double{v.z});
}

}  // namespace

bool LightHull::flat() const {
  return rest <= kFlatShare * (Size(half[0]) + Size(half[1])) ||
         rest <= kRoundingShare * MaxAbs(centre);
}

LightHull FitLightHull(std::span<const Vec3f> samples) {
  SIGHTLINE_CHECK(!samples.empty() && samples.size() <= LightHull::kMostSamples) << samples.size();
  LightHull light;
  light.count = static_cast<uint32_t>(samples.size());
  std::copy(samples.begin(), samples.end(), light.samples);
  for (size_t i = 0; i < LightHull::kMostSamples; ++i) {
    for (int k = 0; k < 3; ++k) light.rows[k][i] = samples[i < samples.size() ? i : 0][k];
  }
  const Vec3d from = ToDouble(samples[0]);
  const Vec3d normal = NormalOf(samples, from);
  double least = std::numeric_limits<double>::infinity();
  Vec3d middle = from, half[2];
  for (size_t i = 0; i < samples.size(); ++i) {
    for (size_t j = i + 1; j < samples.size(); ++j) {
      const Vec3d side = ToDouble(samples[j]) - ToDouble(samples[i]);
      const Vec3d across = Cross(normal, side);
      const double lengths[2] = {Length(side), Length(across)};
      if (!(lengths[0] > 0)) continue;
      if (lengths[1] > 0 && !IsOuterLine(samples, ToDouble(samples[i]), across)) continue;
      const Vec3d axes[2] = {side * (1.0 / lengths[0]),
                             lengths[1] > 0 ? across * (1.0 / lengths[1]) : Vec3d{0, 0, 0}};
      const Extent extents[2] = {Extent(samples, from, axes[0]), Extent(samples, from, axes[1])};
      // Of lines all directions are one; the sum stands for an area of zero.
      const double size = lengths[1] > 0 ? extents[0].size() * extents[1].size()
                                         : extents[0].size() + extents[1].size();
      if (size >= least) continue;
      least = size;
      middle = from;
      for (int k = 0; k < 2; ++k) {
        half[k] = axes[k] * (0.5 * extents[k].size());
        middle = middle + axes[k] * (0.5 * (extents[k].least + extents[k].most));
      }
    }
  }
  light.centre = ToFloat(middle);
  const Vec3d centre = ToDouble(light.centre);
  Vec3d stored[2];
  for (int k = 0; k < 2; ++k) {
    light.half[k] = ToFloat(half[k]);
    stored[k] = ToDouble(light.half[k]);
  }
  double rest = 0;
  for (size_t i = 0; i < samples.size(); ++i) {
    const Vec3d own = ToDouble(samples[i]) - centre;
    Vec3d left = own;
    for (int k = 0; k < 2; ++k) {
      const double square = Dot(stored[k], stored[k]);
      const double at = square > 0 ? Dot(own, stored[k]) / square : 0.0;
      light.along[k][i] = static_cast<float>(std::clamp(at, -1.0, 1.0));
      left = left - stored[k] * double{light.along[k][i]};
    }
    // What doubles lose of that is far below a float's rounding.
    const double lost = 0x1p-50 * (MaxAbs(own) + MaxAbs(stored[0]) + MaxAbs(stored[1]));
    rest = std::max(rest, MaxAbs(left) + lost);
  }
  light.rest = std::nextafter(static_cast<float>(rest), std::numeric_limits<float>::infinity());
  return light;
}

}  // namespace sightline
