// SPDX-License-Identifier: Apache-2.0
#include "client/load/stability.h"

#include <algorithm>
#include <limits>

namespace sightline::load {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

template <typename Value>
double Spread(std::span<const Window> windows, const Value& value) {
  double least = kInfinity, most = 0;
  for (const Window& window : windows) {
    least = std::min(least, value(window));
    most = std::max(most, value(window));
  }
  return least > 0 ? most / least - 1 : kInfinity;
}

}  // namespace

Stability JudgeStability(std::span<const Window> windows, double tolerance) {
  Stability result{.rate_spread = kInfinity, .latency_spread = kInfinity};
  if (windows.size() < kStableWindows) return result;
  const std::span<const Window> last = windows.last(kStableWindows);
  result.rate_spread =
      Spread(last, [](const Window& w) { return static_cast<double>(w.answered); });
  result.latency_spread = Spread(
      last, [](const Window& w) { return absl::ToDoubleSeconds(w.planned.PercentileOf(50)); });
  result.stable = result.rate_spread <= tolerance && result.latency_spread <= tolerance;
  return result;
}

}  // namespace sightline::load
