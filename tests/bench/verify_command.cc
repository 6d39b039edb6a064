// SPDX-License-Identifier: Apache-2.0
//
// sightline-bench verify: the soak of verify.h, bounded by time, over given and random scenes.
#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/exit_code.h"
#include "core/accel/binary_bvh_builder.h"
#include "core/accel/kd_builder.h"
#include "core/base/status_macros.h"
#include "tests/bench/bench_scene.h"
#include "tests/bench/command.h"
#include "tests/bench/measure.h"
#include "tests/bench/report.h"
#include "tests/bench/verify.h"

namespace sightline::bench {
namespace {

// Triangles of given scenes that get a kd-tree and a binary BVH, too: half a gigabyte, half a
// minute.
constexpr uint64_t kMostForMoreTrees = 2'000'000;

struct Options {
  double seconds = 0;
  std::vector<std::string> scenes;
  uint64_t seed = 1, batches = 0, first_batch = 0, threads = 0;
  bool json = false;
};

cli::FlagSet Flags(Options* o) {
  cli::FlagSet flags(
      "sightline-bench verify --seconds S [flags]",
      "Compares the engine's strategies with each other, with an independent single-ray walk and "
      "with brute force, on random and given scenes, with eyes and lights in the worst places. "
      "Ends with 1 if any two answers differ.");
  flags.Number("seconds", "S", "how long; the rounds in hand are finished", &o->seconds);
  flags.Texts("scene", "SCENE", "a scene that takes turns with the random ones", &o->scenes);
  flags.Count("seed", "N", "of everything random", &o->seed, 0,
              std::numeric_limits<uint64_t>::max());
  flags.Count("batches", "N", "instead of --seconds: how many batches", &o->batches, 1,
              1'000'000'000);
  flags.Count("first-batch", "N",
              "where to begin: a difference names the seed and batch that bring it back, with the "
              "same scenes given",
              &o->first_batch, 0, 1'000'000'000);
  RegisterThreads(&flags, &o->threads);
  flags.Switch("json", "one JSON object per line, instead of a table", &o->json);
  return flags;
}

absl::StatusOr<std::vector<VerifyScene>> ReadScenes(const Options& options, Context& context) {
  std::vector<VerifyScene> scenes;
  ThreadPool pool(ResolveThreads(options.threads));
  for (const std::string& name : options.scenes) {
    context.err << name << ": reading and building" << std::endl;
    SL_ASSIGN_OR_RETURN(const SceneSource source, ReadScene(name, /*views_file=*/""));
    SL_ASSIGN_OR_RETURN(IndexedGeometry scene, IndexScene(source, {}, pool));
    if (scene.geometry.triangles.size() <= kMostForMoreTrees) {
      SL_ASSIGN_OR_RETURN(scene.kd_tree, BuildKdTree(scene.geometry, {}, pool));
      SL_ASSIGN_OR_RETURN(scene.binary_bvh, BuildBinaryBvh(scene.geometry, {}, pool));
    }
    if (scene.bvh.empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat("'", source.name, "' has no triangle that can be hit"));
    }
    scenes.emplace_back(source.name, std::move(scene));
  }
  return scenes;
}

void Print(const VerifyReport& verified, const Options& options, double seconds, Context& context) {
  const std::string scenes = options.scenes.empty()
                                 ? "random"
                                 : absl::StrCat("random and ", options.scenes.size(), " given");
  Report table(
      {TextColumn("asked", "kind"), TextColumn("way", "way"), TextColumn("held against", "peer"),
       CountColumn("rays", "queries"), CountColumn("different", "disagreements")},
      options.json, context.out);
  for (const auto& [key, tally] : verified.tallies) {
    const auto& [kind, way, reference] = key;
    // A way is named "STRATEGY on ISA, ...".
    const std::string strategy = way.substr(0, way.find(' '));
    const std::string rest = way.substr(std::min(way.size(), strategy.size() + 4));
    table.Add(WithCommonKeys({{"workload", "verify"},
                              {"scene", scenes},
                              {"triangles", nullptr},  // Of as many scenes as there were batches.
                              {"views", 0},
                              {"queries", tally.compared},
                              {"threads", ResolveThreads(options.threads)},
                              {"isa", rest.substr(0, rest.find(','))},
                              {"strategy", strategy},
                              {"rate_per_s", static_cast<double>(tally.compared) / seconds},
                              {"peer", reference},
                              {"disagreements", tally.different},
                              {"disagreements_beyond_rounding", tally.different},
                              {"kind", kind},
                              {"way", way}}));
  }
  table.Finish();
  Report places({TextColumn("eye or light", "place"), CountColumn("rays of AUTO", "queries")},
                options.json, context.out);
  if (!options.json) context.out << '\n';
  for (const auto& [place, rays] : verified.places) {
    places.Add(WithCommonKeys({{"workload", "verify-places"},
                               {"scene", scenes},
                               {"views", 0},
                               {"queries", rays},
                               {"threads", ResolveThreads(options.threads)},
                               {"isa", std::string(SimdTargetName(BestSimdTarget()))},
                               {"strategy", std::string(StrategyName(Strategy::kAuto))},
                               {"rate_per_s", static_cast<double>(rays) / seconds},
                               {"place", place}}));
  }
  places.Finish();
  if (options.json) {
    const Row summary = {{"workload", "verify-summary"},
                         {"scene", scenes},
                         {"views", 0},
                         {"queries", verified.auto_rays + verified.brute_force_rays},
                         {"isa", std::string(SimdTargetName(BestSimdTarget()))},
                         {"strategy", std::string(StrategyName(Strategy::kAuto))},
                         {"rate_per_s", static_cast<double>(verified.auto_rays) / seconds},
                         {"peer", "SINGLE and brute force"},
                         {"seed", options.seed},
                         {"seconds", seconds},
                         {"threads", ResolveThreads(options.threads)},
                         {"given_scenes", options.scenes.size()},
                         {"batches", verified.batches},
                         {"rounds", verified.rounds},
                         {"auto_against_single", verified.auto_rays},
                         {"auto_against_brute_force", verified.brute_force_rays},
                         {"disagreements", verified.different},
                         {"disagreements_beyond_rounding", verified.different}};
    context.out << WithCommonKeys(summary).dump() << std::endl;
    return;
  }
  context.out << absl::StrFormat(
      "\nseed %d: %d batches, %d rounds in %.0f s; AUTO against SINGLE on %.4g rays, against brute "
      "force on %.4g; %d different\n",
      options.seed, verified.batches, verified.rounds, seconds,
      static_cast<double>(verified.auto_rays), static_cast<double>(verified.brute_force_rays),
      verified.different);
}

}  // namespace

absl::StatusOr<bool> VerifyCommand(std::span<const std::string> args, Context& context) {
  Options options;
  cli::FlagSet flags = Flags(&options);
  SL_ASSIGN_OR_RETURN(const bool go_on, ParseOrHelp(&flags, args, context));
  if (!go_on) return true;
  if ((options.seconds > 0) == (options.batches > 0)) {
    return cli::UsageError("wants --seconds above 0, or --batches");
  }
  SL_ASSIGN_OR_RETURN(const std::vector<VerifyScene> scenes, ReadScenes(options, context));
  const double begin = Now();
  double last = begin;
  const VerifyReport verified =
      Verify(scenes, {.seed = options.seed,
                      .first_batch = options.first_batch,
                      .batches = options.batches,
                      .seconds = options.seconds,
                      .threads = ResolveThreads(options.threads),
                      .progress = [&](const VerifyReport& so_far) {
                        constexpr double kProgressSeconds = 5;
                        if (Now() - last < kProgressSeconds) return;
                        last = Now();
                        context.err << absl::StrFormat(
                                           "%.0f s: %d batches, %.4g rays, %d different",
                                           last - begin, so_far.batches,
                                           static_cast<double>(so_far.auto_rays), so_far.different)
                                    << std::endl;
                      }});
  Print(verified, options, Now() - begin, context);
  for (const std::string& difference : verified.differences) {
    context.err << "DIFFERENT: " << difference << std::endl;
  }
  return verified.different == 0;
}

}  // namespace sightline::bench
