// SPDX-License-Identifier: Apache-2.0
#include "client/cli/picture/color_map.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace sightline::cli {
namespace {

// Ottosson's matrices from OKLab to linear sRGB.
Rgb OklabToRgb(float lightness, float a, float b) {
  const float l = lightness + 0.3963377774f * a + 0.2158037573f * b;
  const float m = lightness - 0.1055613458f * a - 0.0638541728f * b;
  const float s = lightness - 0.0894841775f * a - 1.2914855480f * b;
  const float l3 = l * l * l, m3 = m * m * m, s3 = s * s * s;
  return {4.0767416621f * l3 - 3.3077115913f * m3 + 0.2309699292f * s3,
          -1.2684380046f * l3 + 2.6097574011f * m3 - 0.3413193965f * s3,
          -0.0041960863f * l3 - 0.7034186147f * m3 + 1.7076147010f * s3};
}

bool Shown(Rgb c) { return std::min({c.r, c.g, c.b}) >= 0.0f && std::max({c.r, c.g, c.b}) <= 1.0f; }

}  // namespace

Rgb OklchToRgb(float lightness, float chroma, float hue) {
  const float a = std::cos(hue), b = std::sin(hue);
  Rgb color = OklabToRgb(lightness, chroma * a, chroma * b);
  if (Shown(color)) return color;
  // Halving finds the largest chroma that can be shown; 12 steps are finer than an 8-bit code.
  float in = 0.0f, out = chroma;
  for (int i = 0; i < 12; ++i) {
    const float middle = 0.5f * (in + out);
    (Shown(OklabToRgb(lightness, middle * a, middle * b)) ? in : out) = middle;
  }
  color = OklabToRgb(lightness, in * a, in * b);
  return {std::clamp(color.r, 0.0f, 1.0f), std::clamp(color.g, 0.0f, 1.0f),
          std::clamp(color.b, 0.0f, 1.0f)};
}

ColorMap::ColorMap(Range range) {
  for (int i = 0; i < kSteps; ++i) {
    const float t = static_cast<float>(i) / (kSteps - 1);
    // Chroma swells in the middle and fades toward both ends, where little can be shown anyway.
    const float swell = std::sqrt(std::sin(std::numbers::pi_v<float> * (0.08f + 0.84f * t)));
    table_[static_cast<size_t>(i)] =
        OklchToRgb(range.lightness_0 + t * (range.lightness_1 - range.lightness_0),
                   range.chroma * swell, range.hue_0 + t * (range.hue_1 - range.hue_0));
  }
}

const ColorMap& ColorMap::Depth() {
  // Hues in radians: 4.85 blue-violet, 3.2 teal, 1.75 yellow-green.
  static const ColorMap map({0.20f, 0.95f, 4.85f, 1.75f, 0.15f});
  return map;
}

const ColorMap& ColorMap::Cost() {
  // From violet (-1.15) through red (0.4) to yellow (1.85).
  static const ColorMap map({0.08f, 0.96f, -1.15f, 1.85f, 0.19f});
  return map;
}

Rgb ColorMap::operator()(float t) const {
  if (!(t > 0.0f)) return table_.front();
  if (t >= 1.0f) return table_.back();
  const float at = t * (kSteps - 1);
  const int i = static_cast<int>(at);
  const float f = at - static_cast<float>(i);
  return table_[static_cast<size_t>(i)] * (1.0f - f) + table_[static_cast<size_t>(i) + 1] * f;
}

}  // namespace sightline::cli
