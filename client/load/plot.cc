// SPDX-License-Identifier: Apache-2.0
#include "client/load/plot.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/formats/file.h"
#include "client/import/object_assembly.h"
#include "client/load/hgrm.h"
#include "client/load/plain_number.h"

namespace sightline::load {
namespace {

// Blue and orange, told apart by any eye; greys for what is not data.
constexpr uint32_t kPlanColor = 0x1f5fa8, kSendColor = 0xe07b00;
constexpr uint32_t kGrid = 0xdddddd, kFrame = 0x888888;

struct Panel {
  double left = 0, right = 0, top = 0, bottom = 0;
  double x_least = 0, x_most = 1;  // In the scale's own numbers.
  double y_least = 0, y_most = 1;  // Decades of milliseconds.

  PlotPoint At(double x, double y) const {
    return {left + (x - x_least) / (x_most - x_least) * (right - left),
            bottom - (y - y_least) / (y_most - y_least) * (bottom - top)};
  }
};

double Decades(absl::Duration latency) {
  return std::log10(std::max(1e-4, absl::ToDoubleMilliseconds(latency)));
}

// How few lie beyond: 0 for p0, 1 for p90, 2 for p99.
double Rarity(double percent, double most) {
  return percent >= 100 ? most : std::min(most, -std::log10(1 - percent / 100));
}

// 1, 2 or 5 times a power of ten, at most six times into `most`.
double TickStep(double most) {
  const double decade = std::pow(10, std::floor(std::log10(most)));
  for (const double step : {0.1, 0.2, 0.5, 1.0}) {
    if (most / (step * decade) <= 6.001) return step * decade;
  }
  return 2 * decade;
}

void AddLine(PlotPoint a, PlotPoint b, uint32_t color, Drawing* drawing) {
  drawing->strokes.push_back({.points = {a, b}, .color = color, .width = 1});
}

void AddFrame(const Panel& panel, const std::string& title, Drawing* drawing) {
  const PlotPoint a{panel.left, panel.top}, b{panel.right, panel.bottom};
  drawing->strokes.push_back(
      {.points = {a, {b.x, a.y}, b, {a.x, b.y}, a}, .color = kFrame, .width = 1});
  drawing->labels.push_back({.x = panel.left, .y = panel.top - 40, .text = title});
}

// Decades, and where there is room, twice and five times them.
void AddLatencyScale(const Panel& panel, Drawing* drawing) {
  const bool room = panel.y_most - panel.y_least <= 4;
  for (double decade = std::ceil(panel.y_least); decade <= panel.y_most; ++decade) {
    for (const double factor : {1.0, 2.0, 5.0}) {
      const double y = decade + std::log10(factor);
      if (factor > 1 && (!room || y > panel.y_most)) break;
      const double value = factor * std::pow(10, decade);
      const PlotPoint at = panel.At(panel.x_least, y);
      AddLine(at, panel.At(panel.x_most, y), kGrid, drawing);
      drawing->labels.push_back({.x = at.x - 8,
                                 .y = at.y + 6,
                                 .text = PlainNumber(value, 3),
                                 .anchor = Label::Anchor::kEnd});
    }
  }
}

// Above the frame, where no curve is; `x` from its left.
void AddKey(const Panel& panel, double x, const std::string& text, uint32_t color,
            Drawing* drawing) {
  const double left = panel.left + x, y = panel.top - 18;
  drawing->strokes.push_back({.points = {{left, y}, {left + 24, y}}, .color = color, .width = 3});
  drawing->labels.push_back({.x = left + 32, .y = y + 6, .text = text, .color = color});
}

void AddPercentiles(const Panel& panel, const LatencyHistogram& histogram, uint32_t color,
                    Drawing* drawing) {
  Stroke stroke{.color = color, .width = 2.5};
  for (const PercentilePoint& point : PercentileDistribution(histogram)) {
    // A step: up to its percentile the curve has the value before.
    const double x = Rarity(point.percent, panel.x_most);
    if (!stroke.points.empty()) stroke.points.push_back({panel.At(x, 0).x, stroke.points.back().y});
    stroke.points.push_back(panel.At(x, Decades(point.latency)));
  }
  drawing->strokes.push_back(std::move(stroke));
}

void AddWindows(const Panel& panel, const Measurement& measured, double percent, uint32_t color,
                Drawing* drawing) {
  Stroke stroke{.color = color, .width = 2.5};
  const double each = absl::ToDoubleSeconds(measured.window);
  const double half = (panel.At(each, 0).x - panel.At(0, 0).x) / 2;
  const auto end = [&] {  // A window without answers leaves a gap.
    if (stroke.points.size() == 1) {
      // Alone between two gaps: as wide as it is.
      const PlotPoint alone = stroke.points[0];
      stroke.points = {{alone.x - half, alone.y}, {alone.x + half, alone.y}};
    }
    if (!stroke.points.empty()) drawing->strokes.push_back(stroke);
    stroke.points.clear();
  };
  for (size_t i = 0; i < measured.windows.size(); ++i) {
    const LatencyHistogram& latency = measured.windows[i].planned;
    if (latency.count() == 0) {
      end();
      continue;
    }
    stroke.points.push_back(
        panel.At((static_cast<double>(i) + 0.5) * each, Decades(latency.PercentileOf(percent))));
  }
  end();
}

}  // namespace

Drawing DrawPlot(const Measurement& measured, const std::string& title) {
  Drawing drawing{.width = 1280, .height = 552};
  // A file's name may be any bytes, and an SVG may not.
  drawing.labels.push_back({.x = 80, .y = 30, .text = CleanName(title)});
  const LatencyHistogram &planned = measured.all.planned, &sent = measured.all.sent;
  // Without an answer nothing is known from the send.
  double least =
      std::floor(Decades(sent.count() == 0 ? planned.min() : std::min(planned.min(), sent.min())));
  double most = std::ceil(Decades(std::max(planned.max(), sent.max())));
  // Windows have answers to the warm-up's requests, too, which the run itself has not.
  for (const Window& window : measured.windows) {
    if (window.planned.count() == 0) continue;
    least = std::min(least, std::floor(Decades(window.planned.PercentileOf(50))));
    most = std::max(most, std::ceil(Decades(window.planned.PercentileOf(99))));
  }
  if (most <= least) most = least + 1;
  Panel by_percentile{
      .left = 80,
      .right = 640,
      .top = 112,
      .bottom = 492,
      .x_most =
          std::max(1.0, std::log10(static_cast<double>(std::max<uint64_t>(2, planned.count())))),
      .y_least = least,
      .y_most = most};
  AddLatencyScale(by_percentile, &drawing);
  constexpr double kTicks[] = {0, 50, 90, 99, 99.9, 99.99, 99.999};
  for (const double percent : kTicks) {
    const double x = Rarity(percent, by_percentile.x_most);
    if (x > by_percentile.x_most - 0.05) break;
    const PlotPoint at = by_percentile.At(x, least);
    AddLine(at, by_percentile.At(x, most), kGrid, &drawing);
    drawing.labels.push_back({.x = at.x,
                              .y = at.y + 24,
                              .text = absl::StrCat("p", percent),
                              .anchor = Label::Anchor::kMiddle});
  }
  AddPercentiles(by_percentile, sent, kSendColor, &drawing);
  AddPercentiles(by_percentile, planned, kPlanColor, &drawing);
  AddFrame(by_percentile, "latency by percentile, ms", &drawing);
  AddKey(by_percentile, 0, "from the planned time", kPlanColor, &drawing);
  AddKey(by_percentile, 330, "from the send", kSendColor, &drawing);

  Panel over_time = by_percentile;
  over_time.left = 720;
  over_time.right = 1250;
  over_time.x_most = std::max(1e-3, absl::ToDoubleSeconds(measured.elapsed));
  AddLatencyScale(over_time, &drawing);
  const double step = TickStep(over_time.x_most);
  for (double seconds = 0; seconds <= over_time.x_most * 1.001; seconds += step) {
    const PlotPoint at = over_time.At(seconds, least);
    AddLine(at, over_time.At(seconds, most), kGrid, &drawing);
    drawing.labels.push_back({.x = at.x,
                              .y = at.y + 24,
                              .text = PlainNumber(seconds, 3),
                              .anchor = Label::Anchor::kMiddle});
  }
  AddWindows(over_time, measured, 99, kSendColor, &drawing);
  AddWindows(over_time, measured, 50, kPlanColor, &drawing);
  AddFrame(over_time, "from the planned time, ms, over seconds", &drawing);
  AddKey(over_time, 0, "median", kPlanColor, &drawing);
  AddKey(over_time, 330, "p99", kSendColor, &drawing);
  return drawing;
}

absl::Status WritePlot(const std::string& path, const Measurement& measured,
                       const std::string& title) {
  const Drawing drawing = DrawPlot(measured, title);
  if (absl::EndsWith(path, ".svg")) return cli::WriteFile(path, FormatSvg(drawing));
  return cli::WritePng(path, Rasterize(drawing));
}

}  // namespace sightline::load
