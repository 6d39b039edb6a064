// SPDX-License-Identifier: Apache-2.0
#include "tests/core/shaft/margin_hunt.h"

#include <cmath>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "tests/core/intersect/triangle_cases.h"

namespace sightline::testing_support {
namespace {

constexpr int kSteps = 400;
constexpr float kLargest = 0x1p40f;

}  // namespace

HuntInput Hunt::Moved(HuntInput input) {
  for (uint64_t changes = 1 + rng_.Below(4); changes > 0; --changes) {
    float& x = input[rng_.Below(input.size())];
    const uint64_t kind = rng_.Below(20);
    if (kind < 12) {
      x = MoveByUlps(x, static_cast<int>(rng_.Below(9)) - 4);
    } else if (kind < 17) {
      x *= static_cast<float>(rng_.Uniform(0.5, 1.5));
    } else if (kind < 18) {
      x = -x;
    } else {  // Cancellation needs numbers that are alike.
      x = MoveByUlps(input[rng_.Below(input.size())], static_cast<int>(rng_.Below(9)) - 4);
    }
    if (!(std::abs(x) <= kLargest)) x = std::copysign(kLargest, x);
  }
  return input;
}

void Hunt::Run(int64_t climbs, const std::function<HuntInput()>& start,
               const std::function<std::optional<double>(const HuntInput&)>& ratio) {
  for (; climbs > 0; --climbs) {
    HuntInput input = start();
    double best = ratio(input).value_or(0);
    for (int step = 0; step < kSteps; ++step) {
      HuntInput next = Moved(input);
      const std::optional<double> reached = ratio(next);
      // What is as good is taken too: rounding errors are stairs.
      if (!reached || *reached < best) continue;
      best = *reached;
      input = std::move(next);
      if (best <= worst_) continue;
      worst_ = best;
      worst_input_ = input;
    }
  }
}

std::string Hex(const HuntInput& input) {
  return absl::StrJoin(input, " ",
                       [](std::string* out, float x) { absl::StrAppendFormat(out, "%a", x); });
}

std::ostream& operator<<(std::ostream& out, const Hunt& hunt) {
  return out << "error / margin = " << hunt.worst() << " at " << Hex(hunt.worst_input());
}

}  // namespace sightline::testing_support
