// SPDX-License-Identifier: Apache-2.0
//
// A drawing of lines and words, which becomes an SVG or the pixels of a PNG. Coordinates are pixels
// from the upper left corner; colours are sRGB codes, 0xRRGGBB.
//
// Thread safety: plain values and functions.
//
//   Drawing drawing{.width = 960, .height = 480};
//   drawing.strokes.push_back({.points = {{10, 10}, {90, 40}}, .color = 0x1f77b4, .width = 2});
//   std::string svg = FormatSvg(drawing);
#ifndef SIGHTLINE_CLIENT_LOAD_DRAWING_H_
#define SIGHTLINE_CLIENT_LOAD_DRAWING_H_

#include <cstdint>
#include <string>
#include <vector>

#include "client/cli/formats/png.h"

namespace sightline::load {

struct PlotPoint {
  double x = 0, y = 0;
};

struct Stroke {
  std::vector<PlotPoint> points;  // Joined in order.
  uint32_t color = 0;
  double width = 1;  // Pixels.
};

struct Label {
  enum class Anchor { kStart, kMiddle, kEnd };
  double x = 0, y = 0;  // Where the base line starts, has its middle, or ends.
  std::string text;     // ASCII.
  Anchor anchor = Anchor::kStart;
  uint32_t color = 0x333333;
};

struct Drawing {
  uint32_t width = 0, height = 0;
  std::vector<Stroke> strokes;
  std::vector<Label> labels;
};

std::string FormatSvg(const Drawing& drawing);

// On white. Letters are those of glyphs.h, upright and of one size; others are left blank.
cli::Image Rasterize(const Drawing& drawing);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_DRAWING_H_
