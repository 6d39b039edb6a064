// SPDX-License-Identifier: Apache-2.0
//
// sightline-bench auto: whether AUTO keeps its promise, to be about as fast as the best of all
// strategies and structures, whatever is asked of whichever scene.
#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/cli/exit_code.h"
#include "core/base/status_macros.h"
#include "tests/bench/bench_scene.h"
#include "tests/bench/command.h"
#include "tests/bench/measure.h"
#include "tests/bench/report.h"
#include "tests/bench/workload.h"
#include "tests/bench/workload_flags.h"

namespace sightline::bench {
namespace {

// A choice that takes so many times as long as the fastest on its first run is timed no further: it
// cannot be the best, and would take most of the time.
constexpr double kHopeless = 3.0;

struct Options {
  WorkloadFlags work;
  bool choices = false;
  std::vector<std::string> only;
};

cli::FlagSet Flags(Options* o) {
  cli::FlagSet flags(
      "sightline-bench auto --scene SCENE --workload WORKLOAD [flags]",
      "Times AUTO against every strategy on every structure, by turns, over one scene that has "
      "them all: the BVH, a kd-tree and a binary BVH. The ratio is AUTO's rate over that of the "
      "fastest other choice.");
  o->work.repeats = 5;
  o->work.Register(&flags, WorkloadFlags::Choices::kAll);
  flags.Heading("Rows");
  flags.Switch("choices", "also a row for each choice", &o->choices);
  flags.Texts("choice", "NAME",
              "beside AUTO time these alone, as \"SHAFT BVH\" or \"PACKET KD_TREE culled\"; may be "
              "repeated",
              &o->only);
  return flags;
}

std::vector<Column> Columns() {
  return {TextColumn("workload", "workload"),
          SceneColumn("scene"),
          SizeColumn("pixels"),
          TextColumn("choice", "choice"),
          MegaColumn("M/s", "rate_per_s"),
          TextColumn("best other", "best_choice"),
          MegaColumn("its M/s", "best_rate_per_s"),
          SpreadColumn("ratio", "ratio"),
          CountColumn("queries", "queries"),
          CountColumn("wrong", "wrong_units")};
}

// What an answer can be asked by, AUTO first.
struct Choice {
  std::string name;
  QueryOptions options;
};

// All of them, or of the others those of these names alone. Usage errors: an unknown name.
absl::StatusOr<std::vector<Choice>> Choices(SimdTarget simd, const std::vector<std::string>& only) {
  std::vector<Choice> choices = {{"AUTO", {}}};
  const auto add = [&](Strategy strategy, Structure structure, bool culled) {
    Choice choice;
    choice.name = absl::StrCat(StrategyName(strategy), " ", StructureName(structure),
                               culled ? " culled" : "");
    choice.options.strategy = strategy;
    choice.options.structure = structure;
    if (culled) choice.options.leaf_culling.emplace();
    choices.push_back(std::move(choice));
  };
  for (const Structure structure : {Structure::kBvh, Structure::kKdTree, Structure::kBinaryBvh}) {
    for (const bool culled : {false, true}) {
      add(Strategy::kSingle, structure, culled);
      add(Strategy::kPacket, structure, culled);
    }
  }
  add(Strategy::kShaft, Structure::kBvh, false);
  add(Strategy::kRtt, Structure::kKdTree, false);
  for (Choice& choice : choices) choice.options.simd = simd;
  if (only.empty()) return choices;
  std::vector<Choice> some = {choices.front()};
  for (const std::string& name : only) {
    const auto found = std::find_if(choices.begin() + 1, choices.end(),
                                    [&](const Choice& choice) { return choice.name == name; });
    if (found == choices.end()) {
      std::vector<std::string> names;
      for (size_t c = 1; c < choices.size(); ++c) names.push_back(choices[c].name);
      return cli::UsageError(absl::StrCat("--choice wants one of '", absl::StrJoin(names, "', '"),
                                          "'; got '", name, "'"));
    }
    some.push_back(*found);
  }
  return some;
}

// Seconds of every choice for all units, each run once, and how many units it answered otherwise
// than AUTO; warms up as it goes.
struct Trial {
  std::vector<double> seconds;
  std::vector<uint64_t> wrong_units;
  std::vector<QueryStats> stats;
};

Trial TryAll(Workload& workload, const std::vector<Choice>& choices, const Clock& now) {
  Trial trial{std::vector<double>(choices.size()), std::vector<uint64_t>(choices.size()),
              std::vector<QueryStats>(choices.size())};
  for (size_t unit = 0; unit < workload.units(); ++unit) {
    uint64_t truth = 0;
    workload.RunOurs(unit);  // So that AUTO is not the one to find everything cold.
    for (size_t c = 0; c < choices.size(); ++c) {
      workload.Use(choices[c].options);
      const double begin = now();
      workload.RunOurs(unit);
      trial.seconds[c] += now() - begin;
      trial.stats[c].Add(workload.OurStats());
      const uint64_t digest = workload.OurDigest();
      if (c == 0) truth = digest;
      if (digest != truth) ++trial.wrong_units[c];
    }
    workload.Use(choices[0].options);
  }
  return trial;
}

// The choices that are worth timing: AUTO, and those not hopeless.
std::vector<size_t> Promising(const Trial& trial) {
  const double best = *std::min_element(trial.seconds.begin(), trial.seconds.end());
  std::vector<size_t> promising = {0};
  for (size_t c = 1; c < trial.seconds.size(); ++c) {
    if (trial.seconds[c] <= kHopeless * best) promising.push_back(c);
  }
  return promising;
}

absl::Status RunWorkload(const Options& options, const SceneSource& source,
                         const IndexedGeometry& scene, const std::string& name,
                         const ImageSize& size, ThreadPool& pool, Context& context,
                         Report* report) {
  SL_ASSIGN_OR_RETURN(const WorkloadSpec spec, options.work.Spec(name, size));
  const std::string title = absl::StrCat(source.name, ", ", Describe(spec));
  context.err << title << ": points and lights" << std::endl;
  SL_ASSIGN_OR_RETURN(const std::unique_ptr<Workload> workload,
                      MakeWorkload(spec, source, scene, pool));
  SL_ASSIGN_OR_RETURN(const std::vector<Choice> choices, Choices(spec.options.simd, options.only));
  context.err << title << ": every choice once" << std::endl;
  const Clock clock = ClockFor(pool.threads());
  const Trial trial = TryAll(*workload, choices, clock);
  const std::vector<size_t> timed = Promising(trial);
  std::vector<Side> sides;
  for (const size_t c : timed) {
    sides.push_back({[&workload, &choice = choices[c]](size_t unit) {
      workload->Use(choice.options);
      workload->RunOurs(unit);
    }});
  }
  const Timings timings = TimeByTurns(
      {.count = workload->units(),
       .queries = [&](size_t unit) { return workload->queries(unit); },
       .min_seconds = MinSeconds(options.work.quick)},
      sides, options.work.repeats,
      [&](size_t repetition) {
        context.err << title << ": repetition " << repetition + 1 << " of " << options.work.repeats
                    << std::endl;
      },
      clock);
  uint64_t queries = 0;
  for (size_t unit = 0; unit < workload->units(); ++unit) queries += workload->queries(unit);
  size_t best = 0;  // Of `timed`; AUTO where nothing else came near.
  for (size_t side = 1; side < timed.size(); ++side) {
    if (best == 0 || timings.Rate(side).median > timings.Rate(best).median) best = side;
  }
  const auto rate_of = [&](size_t c) {
    const auto side = std::find(timed.begin(), timed.end(), c);
    return side == timed.end() ? static_cast<double>(queries) / trial.seconds[c]
                               : timings.Rate(static_cast<size_t>(side - timed.begin())).median;
  };
  uint64_t wrong = 0;
  Row rates = Row::object();
  for (size_t c = 0; c < choices.size(); ++c) {
    wrong += trial.wrong_units[c];
    rates[choices[c].name] = rate_of(c);
    if (trial.wrong_units[c] == 0) continue;
    context.err << title << ": WRONG: " << choices[c].name << " differs from AUTO in "
                << trial.wrong_units[c] << " of " << workload->units() << " units" << std::endl;
  }
  const auto row_of = [&](size_t c, const Spread& ratio, uint64_t wrong_units) {
    Row row = {{"workload", Describe(spec)},
               {"scene", source.name},
               {"triangles", scene.geometry.triangles.size()},
               {"views", workload->views()},
               {"queries", queries},
               {"threads", pool.threads()},
               {"isa", std::string(SimdTargetName(spec.options.simd))},
               {"strategy", std::string(StrategyName(trial.stats[c].strategy))},
               {"choice", choices[c].name},
               {"peer", "the best choice"},
               {"peer_mode", choices[timed[best]].name},
               {"peer_rate_per_s", rate_of(timed[best])},
               {"disagreements", wrong_units},
               {"disagreements_beyond_rounding", wrong_units},
               {"rate_per_s", rate_of(c)},
               {"best_choice", choices[timed[best]].name},
               {"best_rate_per_s", rate_of(timed[best])},
               {"ratio", ratio.median},
               {"ratio_min", ratio.min},
               {"ratio_max", ratio.max},
               {"wrong_units", wrong_units},
               {"repeats", options.work.repeats}};
    if (workload->views() > 0) {
      row["width"] = spec.width;
      row["height"] = spec.height;
    }
    return WithCommonKeys(row);
  };
  Row row = row_of(0, timings.Ratio(0, best), wrong);
  row["rates_per_s"] = std::move(rates);
  report->Add(std::move(row));
  for (size_t c = 1; options.choices && c < choices.size(); ++c) {
    const auto side = std::find(timed.begin(), timed.end(), c);
    const double once = trial.seconds[timed[best]] / trial.seconds[c];
    const Spread ratio = side == timed.end()
                             ? Spread{once, once, once}
                             : timings.Ratio(static_cast<size_t>(side - timed.begin()), best);
    report->Add(row_of(c, ratio, trial.wrong_units[c]));
  }
  return absl::OkStatus();
}

absl::Status RunScene(const Options& options, const std::string& name, Context& context,
                      Report* report) {
  context.err << name << ": reading and building" << std::endl;
  SL_ASSIGN_OR_RETURN(const SceneSource source, ReadScene(name, options.work.views));
  ThreadPool pool(ResolveThreads(options.work.threads));
  SL_ASSIGN_OR_RETURN(
      const IndexedGeometry scene,
      IndexScene(source, {.kd_tree = options.work.kd_tree, .binary_bvh = BinaryBvhOptions{}},
                 pool));
  for (const std::string& workload : options.work.Workloads()) {
    for (const ImageSize& size : options.work.Sizes(workload)) {
      SL_RETURN_IF_ERROR(
          RunWorkload(options, source, scene, workload, size, pool, context, report));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<bool> AutoCommand(std::span<const std::string> args, Context& context) {
  Options options;
  cli::FlagSet flags = Flags(&options);
  SL_ASSIGN_OR_RETURN(const bool go_on, ParseOrHelp(&flags, args, context));
  if (!go_on) return true;
  SL_RETURN_IF_ERROR(options.work.Check());
  Report report(Columns(), options.work.json, context.out);
  const absl::Status status = RunScenes(
      options.work.scenes, &report, context.err,
      [&](const std::string& scene) { return RunScene(options, scene, context, &report); });
  std::vector<Row> of_auto;
  for (const Row& row : report.rows()) {
    if (row.at("choice") == "AUTO") of_auto.push_back(row);
  }
  PrintOverScenes(of_auto, "ratio", options.work.json, context.out);
  SL_RETURN_IF_ERROR(status);
  return std::none_of(of_auto.begin(), of_auto.end(),
                      [](const Row& row) { return row.at("wrong_units").get<uint64_t>() > 0; });
}

}  // namespace sightline::bench
