// SPDX-License-Identifier: Apache-2.0
//
// Colour maps for quantities. Both are drawn in OKLab (Björn Ottosson, 2020), where equal steps
// look equally large: lightness rises evenly from dark to bright while the hue turns, so they order
// values for readers with any colour vision and on paper.
//
// Thread safety: const after construction.
//
//   const ColorMap& map = ColorMap::Cost();
//   Rgb color = map(0.3f);
#ifndef SIGHTLINE_CLIENT_CLI_PICTURE_COLOR_MAP_H_
#define SIGHTLINE_CLIENT_CLI_PICTURE_COLOR_MAP_H_

#include <array>

#include "client/cli/formats/png.h"

namespace sightline::cli {

// Linear light of an OKLab colour given by lightness (0 to 1), chroma and hue (radians). Chroma is
// reduced until the colour fits into sRGB.
Rgb OklchToRgb(float lightness, float chroma, float hue);

class ColorMap {
 public:
  // Dark blue over teal to pale yellow: far (0) to near (1).
  static const ColorMap& Depth();
  // Black over violet and orange to pale yellow: no work (0) to the most (1).
  static const ColorMap& Cost();

  // Clamps `t` to [0, 1]; NaN counts as 0.
  Rgb operator()(float t) const;

 private:
  static constexpr int kSteps = 256;
  struct Range {
    float lightness_0, lightness_1, hue_0, hue_1, chroma;
  };
  explicit ColorMap(Range range);

  std::array<Rgb, kSteps> table_;
};

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_PICTURE_COLOR_MAP_H_
