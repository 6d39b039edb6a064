// SPDX-License-Identifier: Apache-2.0
#include "client/load/drawing.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "client/load/glyphs.h"

namespace sightline::load {
namespace {

using cli::Image;
using cli::Rgb;

constexpr int kFontPixels = 14;  // Of the SVG; about as large as the glyphs.
constexpr int kGlyphScale = 2;   // Pixels of a glyph's dot.

// The inverse of the sRGB curve (IEC 61966-2-1).
float ToLinear(uint32_t code) {
  const double c = static_cast<double>(code & 0xFF) / 255;
  return static_cast<float>(c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4));
}

Rgb Linear(uint32_t color) {
  return {ToLinear(color >> 16), ToLinear(color >> 8), ToLinear(color)};
}

double DistanceToSegment(PlotPoint p, PlotPoint a, PlotPoint b) {
  const double dx = b.x - a.x, dy = b.y - a.y;
  const double squared = dx * dx + dy * dy;
  const double along =
      squared > 0 ? std::clamp(((p.x - a.x) * dx + (p.y - a.y) * dy) / squared, 0.0, 1.0) : 0;
  return std::hypot(p.x - a.x - along * dx, p.y - a.y - along * dy);
}

// A line as wide as it is, its edge softened over one pixel. `ink` keeps the most of it per pixel,
// so that the joints of a stroke are not drawn twice.
void DrawSegment(PlotPoint a, PlotPoint b, double width, uint32_t columns, uint32_t rows,
                 std::vector<float>* ink) {
  const double reach = width / 2 + 1;
  const auto first = [reach](double v) { return static_cast<int64_t>(std::floor(v - reach)); };
  const auto last = [reach](double v) { return static_cast<int64_t>(std::ceil(v + reach)); };
  const int64_t x0 = std::max<int64_t>(0, first(std::min(a.x, b.x)));
  const int64_t x1 = std::min<int64_t>(int64_t{columns} - 1, last(std::max(a.x, b.x)));
  const int64_t y0 = std::max<int64_t>(0, first(std::min(a.y, b.y)));
  const int64_t y1 = std::min<int64_t>(int64_t{rows} - 1, last(std::max(a.y, b.y)));
  for (int64_t y = y0; y <= y1; ++y) {
    for (int64_t x = x0; x <= x1; ++x) {
      const PlotPoint p{static_cast<double>(x) + 0.5, static_cast<double>(y) + 0.5};
      const auto cover =
          static_cast<float>(std::clamp(width / 2 + 0.5 - DistanceToSegment(p, a, b), 0.0, 1.0));
      float& at = (*ink)[static_cast<size_t>(y) * columns + static_cast<size_t>(x)];
      at = std::max(at, cover);
    }
  }
}

void DrawStroke(const Stroke& stroke, Image* image) {
  std::vector<float> ink(image->pixels.size());
  for (size_t i = 1; i < stroke.points.size(); ++i) {
    DrawSegment(stroke.points[i - 1], stroke.points[i], stroke.width, image->width, image->height,
                &ink);
  }
  const Rgb color = Linear(stroke.color);
  for (size_t i = 0; i < ink.size(); ++i) {
    if (ink[i] > 0) image->pixels[i] = image->pixels[i] * (1 - ink[i]) + color * ink[i];
  }
}

void DrawLabel(const Label& label, Image* image) {
  constexpr int kAdvance = (kGlyphColumns + 1) * kGlyphScale;
  const double length = static_cast<double>(label.text.size()) * kAdvance - kGlyphScale;
  const double before = label.anchor == Label::Anchor::kStart    ? 0
                        : label.anchor == Label::Anchor::kMiddle ? length / 2
                                                                 : length;
  auto x = static_cast<int64_t>(std::lround(label.x - before));
  const int64_t top =
      static_cast<int64_t>(std::lround(label.y)) - int64_t{kGlyphBaseRow} * kGlyphScale;
  const Rgb color = Linear(label.color);
  for (const char c : label.text) {
    for (int row = 0; row < kGlyphRows * kGlyphScale; ++row) {
      for (int column = 0; column < kGlyphColumns * kGlyphScale; ++column) {
        if (!GlyphDot(c, column / kGlyphScale, row / kGlyphScale)) continue;
        const int64_t px = x + column, py = top + row;
        if (px < 0 || py < 0 || px >= image->width || py >= image->height) continue;
        image->at(static_cast<uint32_t>(px), static_cast<uint32_t>(py)) = color;
      }
    }
    x += kAdvance;
  }
}

}  // namespace

std::string FormatSvg(const Drawing& drawing) {
  std::string svg = absl::StrFormat(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" "
      "viewBox=\"0 0 %d %d\" font-family=\"sans-serif\" font-size=\"%d\">\n"
      "<rect width=\"100%%\" height=\"100%%\" fill=\"#ffffff\"/>\n",
      drawing.width, drawing.height, drawing.width, drawing.height, kFontPixels);
  for (const Stroke& stroke : drawing.strokes) {
    absl::StrAppend(&svg, "<polyline fill=\"none\" stroke-linejoin=\"round\" ",
                    absl::StrFormat("stroke=\"#%06x\" stroke-width=\"%.3g\" points=\"",
                                    stroke.color, stroke.width));
    for (const PlotPoint& point : stroke.points) {
      absl::StrAppend(&svg, absl::StrFormat("%.2f,%.2f ", point.x, point.y));
    }
    absl::StrAppend(&svg, "\"/>\n");
  }
  for (const Label& label : drawing.labels) {
    const char* anchor = label.anchor == Label::Anchor::kStart    ? "start"
                         : label.anchor == Label::Anchor::kMiddle ? "middle"
                                                                  : "end";
    absl::StrAppend(
        &svg,
        absl::StrFormat("<text x=\"%.2f\" y=\"%.2f\" text-anchor=\"%s\" fill=\"#%06x\">", label.x,
                        label.y, anchor, label.color),
        absl::StrReplaceAll(label.text, {{"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}}),
        "</text>\n");
  }
  return absl::StrCat(svg, "</svg>\n");
}

Image Rasterize(const Drawing& drawing) {
  Image image(drawing.width, drawing.height);
  std::fill(image.pixels.begin(), image.pixels.end(), Rgb{1, 1, 1});
  for (const Stroke& stroke : drawing.strokes) DrawStroke(stroke, &image);
  for (const Label& label : drawing.labels) DrawLabel(label, &image);
  return image;
}

}  // namespace sightline::load
