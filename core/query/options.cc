// SPDX-License-Identifier: Apache-2.0
#include "core/query/options.h"

#include <algorithm>
#include <array>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "core/traverse/rtt.h"

namespace sightline {
namespace {

constexpr std::array<Strategy, 6> kStrategies = {Strategy::kAuto,   Strategy::kSingle,
                                                 Strategy::kPacket, Strategy::kShaft,
                                                 Strategy::kRtt,    Strategy::kBruteForce};
constexpr std::array<Structure, 4> kStructures = {Structure::kAuto, Structure::kBvh,
                                                  Structure::kKdTree, Structure::kBinaryBvh};

// The value of that name, in any case.
template <typename T, size_t kCount>
absl::StatusOr<T> Parse(absl::string_view name, const char* kind,
                        const std::array<T, kCount>& values, absl::string_view (*name_of)(T)) {
  std::string names;
  for (const T value : values) {
    if (absl::EqualsIgnoreCase(name, name_of(value))) return value;
    absl::StrAppend(&names, names.empty() ? "" : ", ", name_of(value));
  }
  return absl::InvalidArgumentError(
      absl::StrCat("unknown ", kind, " '", name, "'; there are ", names));
}

// What kSingle and kPacket go by.
absl::Status CheckWalkOptions(const QueryOptions& options) {
  const bool walks = options.strategy == Strategy::kSingle || options.strategy == Strategy::kPacket;
  if (options.leaf_culling.has_value() && !walks) {
    return absl::InvalidArgumentError(
        absl::StrCat("leaf_culling is for strategies SINGLE and PACKET, not for ",
                     StrategyName(options.strategy), ": ask for one of them, or leave it out"));
  }
  if (options.intersector != Intersector::kExact && !walks &&
      options.strategy != Strategy::kBruteForce) {
    return absl::InvalidArgumentError(absl::StrCat(
        "intersector ", IntersectorName(options.intersector),
        " is for strategies SINGLE, PACKET and BRUTE_FORCE, not for ",
        StrategyName(options.strategy), ": ask for one of them, or for intersector EXACT"));
  }
  if (options.intersector == Intersector::kHavelHeroutDotProduct &&
      options.strategy == Strategy::kPacket) {
    return absl::InvalidArgumentError(
        "intersector HAVEL_HEROUT_DOT_PRODUCT tests one ray and one triangle at a time, for "
        "strategies SINGLE and BRUTE_FORCE, not for PACKET: ask for one of them, or for "
        "intersector HAVEL_HEROUT, which is the same test in lanes");
  }
  if (std::find(kPacketSides.begin(), kPacketSides.end(), options.packet_side) ==
      kPacketSides.end()) {
    return absl::InvalidArgumentError(
        absl::StrCat("packet_side = ", options.packet_side, " is none of 2, 4, 8, 16"));
  }
  return absl::OkStatus();
}

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
    case Strategy::kRtt:
      return "RTT";
  }
  return "UNKNOWN";
}

absl::StatusOr<Strategy> ParseStrategy(absl::string_view name) {
  return Parse(name, "strategy", kStrategies, &StrategyName);
}

absl::string_view StructureName(Structure structure) {
  switch (structure) {
    case Structure::kAuto:
      return "AUTO";
    case Structure::kBvh:
      return "BVH";
    case Structure::kKdTree:
      return "KD_TREE";
    case Structure::kBinaryBvh:
      return "BINARY_BVH";
  }
  return "UNKNOWN";
}

absl::StatusOr<Structure> ParseStructure(absl::string_view name) {
  return Parse(name, "structure", kStructures, &StructureName);
}

bool WalksKdTree(const IndexedGeometry& scene, const QueryOptions& options) {
  return options.structure == Structure::kKdTree ||
         (options.structure == Structure::kAuto &&
          (options.strategy == Strategy::kRtt || scene.kd_tree_alone()));
}

absl::Status CheckOptions(const IndexedGeometry& scene, const QueryOptions& options) {
  const bool kd_tree = WalksKdTree(scene, options);
  if (options.structure == Structure::kBinaryBvh) {
    if (options.strategy == Strategy::kRtt || options.strategy == Strategy::kShaft) {
      return absl::InvalidArgumentError(absl::StrCat(
          "strategy ", StrategyName(options.strategy),
          " does not walk the binary BVH: ask for SINGLE or PACKET, or for structure AUTO"));
    }
    if (!scene.binary_bvh.has_value()) {
      return absl::FailedPreconditionError(
          "structure BINARY_BVH needs a binary BVH, which this scene was not built with: build it "
          "with one, or ask for structure BVH");
    }
  }
  if (options.structure == Structure::kBvh && options.strategy == Strategy::kRtt) {
    return absl::InvalidArgumentError(
        "strategy RTT walks the kd-tree, not the BVH: ask for structure KD_TREE or AUTO");
  }
  if (scene.kd_tree_alone() &&
      (options.structure == Structure::kBvh ||
       (options.structure == Structure::kAuto && options.strategy == Strategy::kShaft))) {
    const bool by_structure = options.structure == Structure::kBvh;
    return absl::FailedPreconditionError(absl::StrCat(
        by_structure ? "structure BVH" : "strategy SHAFT",
        " needs a BVH, which this scene was built without: build it with one, or ask for ",
        by_structure ? "structure KD_TREE" : "another strategy"));
  }
  if (kd_tree && options.strategy == Strategy::kShaft) {
    return absl::InvalidArgumentError(
        "strategy SHAFT walks the BVH, not the kd-tree: ask for structure BVH or AUTO");
  }
  if (kd_tree && !scene.kd_tree.has_value()) {
    return absl::FailedPreconditionError(absl::StrCat(
        options.strategy == Strategy::kRtt ? "strategy RTT" : "structure KD_TREE",
        " needs a kd-tree, which this scene was not built with: build it with one, or ask for ",
        options.strategy == Strategy::kRtt ? "another strategy" : "structure BVH"));
  }
  SL_RETURN_IF_ERROR(CheckWalkOptions(options));
  if (options.rtt_antialiasing < 1 || options.rtt_antialiasing > kMaxRttAntialiasing) {
    return absl::InvalidArgumentError(absl::StrCat("rtt_antialiasing = ", options.rtt_antialiasing,
                                                   " is outside 1 .. ", kMaxRttAntialiasing));
  }
  if (options.rtt_side_by_side < 0 || options.rtt_side_by_side > kMaxRttSideBySide) {
    return absl::InvalidArgumentError(absl::StrCat("rtt_side_by_side = ", options.rtt_side_by_side,
                                                   " is outside 0 .. ", kMaxRttSideBySide));
  }
  return absl::OkStatus();
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
  tiles += other.tiles;
  tiles_answered += other.tiles_answered;
  relevant_triangles += other.relevant_triangles;
  culled_tests += other.culled_tests;
  shaft.Add(other.shaft);
  for (size_t by = 0; by < answered_by.size(); ++by) answered_by[by] += other.answered_by[by];
  compute_nanoseconds += other.compute_nanoseconds;
}

}  // namespace sightline
