// SPDX-License-Identifier: Apache-2.0
#include "core/query/options.h"

#include <array>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace sightline {
namespace {

constexpr std::array<Strategy, 5> kStrategies = {
    Strategy::kAuto, Strategy::kSingle, Strategy::kPacket, Strategy::kShaft, Strategy::kBruteForce};

}  // namespace

absl::string_view StrategyName(Strategy strategy) {
  switch (strategy) {
    case Strategy::kAuto:
      return "AUTO";
    case Strategy::kSingle:
      return "SINGLE";
    case Strategy::kPacket:
      return "PACKET";
    case Strategy::kBruteForce:
      return "BRUTE_FORCE";
    case Strategy::kShaft:
      return "SHAFT";
  }
  return "UNKNOWN";
}

absl::StatusOr<Strategy> ParseStrategy(absl::string_view name) {
  std::string names;
  for (const Strategy strategy : kStrategies) {
    if (absl::EqualsIgnoreCase(name, StrategyName(strategy))) return strategy;
    absl::StrAppend(&names, names.empty() ? "" : ", ", StrategyName(strategy));
  }
  return absl::InvalidArgumentError(
      absl::StrCat("unknown strategy '", name, "'; there are ", names));
}

void QueryStats::Add(const QueryStats& other) {
  if (rays == 0) {
    strategy = other.strategy;
  } else if (other.rays != 0 && strategy != other.strategy) {
    strategy = Strategy::kAuto;
  }
  rays += other.rays;
  nodes += other.nodes;
  leaves += other.leaves;
  triangle_tests += other.triangle_tests;
  doubt_double += other.doubt_double;
  doubt_exact += other.doubt_exact;
  compute_nanoseconds += other.compute_nanoseconds;
}

}  // namespace sightline
