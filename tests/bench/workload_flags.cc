// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/workload_flags.h"

#include <algorithm>
#include <iterator>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "client/cli/exit_code.h"
#include "core/base/status_macros.h"
#include "tests/bench/command.h"

namespace sightline::bench {
namespace {

constexpr const char* kWorkloads[] = {"primary", "shadow", "sun", "area", "points", "segments"};
// Points by what Describe calls them, whatever --lights and --shuffled say.
constexpr const char* kPoints[] = {"points-sky", "points-lights", "points-sky-shuffled",
                                   "points-lights-shuffled"};
constexpr char kAll[] = "all";

bool IsPoints(const std::string& workload) {
  return std::find(std::begin(kPoints), std::end(kPoints), workload) != std::end(kPoints);
}

bool HasPicture(const std::string& workload) {
  return workload != "points" && workload != "segments" && !IsPoints(workload);
}

}  // namespace

absl::StatusOr<std::vector<ImageSize>> ParseSizes(const std::string& text) {
  std::vector<ImageSize> sizes;
  for (const absl::string_view part : absl::StrSplit(text, ',')) {
    const std::vector<absl::string_view> sides = absl::StrSplit(part, 'x');
    ImageSize size;
    bool good = sides.size() <= 2 && absl::SimpleAtoi(sides[0], &size.width);
    size.height = std::max(1u, static_cast<uint32_t>(uint64_t{size.width} * 9 / 16));
    if (sides.size() == 2) good = good && absl::SimpleAtoi(sides[1], &size.height);
    if (!good || size.width == 0 || size.height == 0 || size.width > kMaxImageSide ||
        size.height > kMaxImageSide) {
      return absl::InvalidArgumentError(
          absl::StrCat("wants widths or WIDTHxHEIGHT in pixels, each from 1 to ", kMaxImageSide,
                       ", with commas between them, like 640x480,1920,3840"));
    }
    sizes.push_back(size);
  }
  return sizes;
}

void WorkloadFlags::Register(cli::FlagSet* flags, Choices choices) {
  flags->Heading("What");
  flags->Texts("scene", "SCENE", "a mesh file or a built-in scene", &scenes);
  flags->Texts("workload", "WORKLOAD",
               absl::StrCat(absl::StrJoin(kWorkloads, ", "), "; of points also ",
                            absl::StrJoin(kPoints, ", "), "; all: each of them"),
               &workloads);
  flags->Text("views", "FILE", "views by scene, instead of views.json beside the scene file",
              &views);
  flags->Count("width", "PIXELS", "of the views", &width, 1, kMaxImageSide);
  flags->Count("height", "PIXELS", "of the views", &height, 1, kMaxImageSide);
  flags->Custom("sweep", "SIZES",
                "several sizes of the views, instead: WIDTHxHEIGHT, or a width at 16:9, with "
                "commas, like 640x480,1920,3840,7680",
                "", [this](const std::string& text) -> absl::Status {
                  SL_ASSIGN_OR_RETURN(sweep, ParseSizes(text));
                  return absl::OkStatus();
                });
  flags->Heading("points and segments");
  flags->Count("points", "N", "how many surface points, or segments", &points, 1, 1'000'000'000);
  flags->Choice("lights", {"sky", "lights"},
                "of points: 145 directions to the sky, or 64 point lights", &lights);
  flags->Switch("shuffled", "the surface points in random order", &shuffled);
  flags->Count("range", "N",
               "points or segments handed over in one call; 0: all points for one thread, an "
               "eighth of them or less for each of several; 65,536 segments",
               &range, 0, 1'000'000'000);
  flags->Heading("How");
  RegisterThreads(flags, &threads);
  if (choices == Choices::kOne) {
    flags->Custom("strategy", "NAME", "of the engine", strategy,
                  [this](const std::string& text) -> absl::Status {
                    SL_ASSIGN_OR_RETURN(const Strategy parsed, ParseStrategy(text));
                    strategy = std::string(StrategyName(parsed));
                    return absl::OkStatus();
                  });
    flags->Custom("structure", "NAME",
                  "what it walks: AUTO, BVH, KD_TREE or BINARY_BVH, built where it is asked for",
                  structure, [this](const std::string& text) -> absl::Status {
                    SL_ASSIGN_OR_RETURN(const Structure parsed, ParseStructure(text));
                    structure = std::string(StructureName(parsed));
                    return absl::OkStatus();
                  });
  }
  flags->Custom("kd-cost", "RATIO",
                "of a kd-tree: cost of a node over that of a triangle's test, 0.01 to 10",
                absl::StrCat(kd_tree.traversal_cost), [this](const std::string& text) {
                  if (!absl::SimpleAtof(text, &kd_tree.traversal_cost)) {
                    return absl::InvalidArgumentError("wants a number");
                  }
                  return ValidateKdOptions(kd_tree);
                });
  flags->Switch("kd-perfect-splits", "of a kd-tree: cut triangles to its cells, not their boxes",
                &kd_tree.perfect_splits);
  RegisterIsa(flags, &isa);
  flags->Count("repeats", "N", "repetitions, of whose ratios the median is given", &repeats, 1,
               1000);
  flags->Switch("sources",
                "tell the engine which triangle a point lies on; Embree cannot be told, so lights "
                "behind that triangle are then answered differently",
                &sources);
  RegisterQuick(flags, &quick);
  flags->Switch("json", "one JSON object per line, instead of a table", &json);
}

absl::Status WorkloadFlags::Check() const {
  if (scenes.empty()) return cli::UsageError("wants --scene");
  if (workloads.empty()) return cli::UsageError("wants --workload");
  for (const std::string& workload : workloads) {
    if (workload == kAll || IsPoints(workload)) continue;
    if (std::find(std::begin(kWorkloads), std::end(kWorkloads), workload) == std::end(kWorkloads)) {
      return cli::UsageError(
          absl::StrCat("--workload wants one of ", absl::StrJoin(kWorkloads, ", "), ", ",
                       absl::StrJoin(kPoints, ", "), ", ", kAll, "; got '", workload, "'"));
    }
  }
  return absl::OkStatus();
}

std::vector<std::string> WorkloadFlags::Workloads() const {
  std::vector<std::string> names;
  for (const std::string& workload : workloads) {
    if (workload != kAll) {
      names.push_back(workload);
      continue;
    }
    for (const char* one : kWorkloads) {
      if (std::string(one) == "points") {
        names.insert(names.end(), std::begin(kPoints), std::end(kPoints));
      } else {
        names.emplace_back(one);
      }
    }
  }
  return names;
}

IndexOptions WorkloadFlags::Index() const {
  IndexOptions index;
  if (structure == StructureName(Structure::kKdTree) || strategy == StrategyName(Strategy::kRtt)) {
    index.kd_tree = kd_tree;
  }
  if (structure == StructureName(Structure::kBinaryBvh)) index.binary_bvh.emplace();
  return index;
}

std::vector<ImageSize> WorkloadFlags::Sizes(const std::string& workload) const {
  if (HasPicture(workload) && !sweep.empty()) return sweep;
  return {{static_cast<uint32_t>(width), static_cast<uint32_t>(height)}};
}

absl::StatusOr<WorkloadSpec> WorkloadFlags::Spec(const std::string& workload,
                                                 const ImageSize& size) const {
  WorkloadSpec spec;
  spec.name = IsPoints(workload) ? "points" : workload;
  spec.width = size.width;
  spec.height = size.height;
  spec.points = points;
  spec.lights = lights;
  spec.shuffled = shuffled;
  if (IsPoints(workload)) {
    spec.lights = absl::StrContains(workload, "-sky") ? "sky" : "lights";
    spec.shuffled = absl::EndsWith(workload, "-shuffled");
  }
  spec.sources = sources;
  spec.range = range;
  SL_ASSIGN_OR_RETURN(spec.options.strategy, ParseStrategy(strategy));
  SL_ASSIGN_OR_RETURN(spec.options.structure, ParseStructure(structure));
  SL_ASSIGN_OR_RETURN(spec.options.simd, ResolveIsa(isa));
  return spec;
}

}  // namespace sightline::bench
