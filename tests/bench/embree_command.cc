// SPDX-License-Identifier: Apache-2.0
//
// sightline-bench embree: the engine against Embree, workload by workload and scene by scene.
#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "tests/bench/bench_scene.h"
#include "tests/bench/command.h"
#include "tests/bench/embree_peer.h"
#include "tests/bench/measure.h"
#include "tests/bench/report.h"
#include "tests/bench/workload.h"
#include "tests/bench/workload_flags.h"

namespace sightline::bench {
namespace {

struct Options {
  WorkloadFlags work;
  bool fast_peer = true, per_view = false;
};

cli::FlagSet Flags(Options* o) {
  cli::FlagSet flags(
      "sightline-bench embree --scene SCENE --workload WORKLOAD [flags]",
      "Times the engine against Embree, both in this process, by turns, over the same floats.");
  o->work.Register(&flags);
  flags.Heading("Rows");
  flags.Switch("fast-peer", "also time Embree's mode that is not robust", &o->fast_peer);
  flags.Switch("per-view", "also a row for each view", &o->per_view);
  return flags;
}

std::vector<Column> Columns() {
  return {TextColumn("workload", "workload"),
          SceneColumn("scene"),
          SizeColumn("pixels"),
          MegaColumn("ours M/s", "rate_per_s"),
          MegaColumn("Embree M/s", "peer_rate_per_s"),
          SpreadColumn("ratio", "ratio"),
          TextColumn("Embree's mode", "peer_mode"),
          CountColumn("queries", "queries"),
          CountColumn("differ", "disagreements"),
          CountColumn("wrong", "disagreements_beyond_rounding")};
}

// What is the same for all workloads of a scene.
struct Bench {
  const Options& options;
  const SceneSource& source;
  const IndexedGeometry& scene;
  const EmbreeScene& robust;
  const EmbreeScene* fast;  // Null: not asked for.
  const int threads;
  ThreadPool& pool;
};

// By view (one, if there is no view): what a unit's answers are counted in.
size_t ViewOf(const Workload& workload, size_t unit) {
  return workload.views() == 0 ? 0 : workload.view(unit);
}

// Runs every unit once on both sides and compares, by view; warms up as it goes.
std::vector<Agreement> CompareAll(Workload& workload, const EmbreeScene& peer, PeerMode mode,
                                  bool settle, QueryStats* stats) {
  std::vector<Agreement> by_view;
  for (size_t unit = 0; unit < workload.units(); ++unit) {
    workload.RunOurs(unit);
    stats->Add(workload.OurStats());
    workload.RunPeer(peer, mode, unit, Share::kAll);
    const size_t view = ViewOf(workload, unit);
    if (view >= by_view.size()) by_view.resize(view + 1, Agreement{.settle = settle});
    workload.Compare(unit, &by_view[view]);
  }
  return by_view;
}

Agreement Sum(const std::vector<Agreement>& by_view) {
  Agreement all;
  for (const Agreement& agreement : by_view) all.Add(agreement);
  return all;
}

// One workload at one size, as it was run.
struct Run {
  const WorkloadSpec& spec;
  const Workload& workload;
  PeerMode mode, fast_mode;
  Strategy strategy;  // What answered; kAuto where more than one did.
};

// Sides 0, 1 and, if it was asked for, 2 of `timings`: ours, the peer, the peer's fast mode.
Row MakeRow(const Bench& bench, const Run& run, const Timings& timings, const Agreement& agreement,
            const Agreement& fast_agreement) {
  const Spread ratio = timings.Ratio(0, 1);
  Row row = {{"workload", Describe(run.spec)},
             {"scene", bench.source.name},
             {"triangles", bench.scene.geometry.triangles.size()},
             {"views", run.workload.views()},
             {"queries", agreement.queries},
             {"threads", bench.threads},
             {"isa", std::string(SimdTargetName(run.spec.options.simd))},
             {"strategy", std::string(StrategyName(run.strategy))},
             {"strategy_asked", bench.options.work.strategy},
             {"structure", bench.options.work.structure},
             {"rate_per_s", timings.Rate(0).median},
             {"peer", absl::StrCat(EmbreeDevice::Name(), " robust")},
             {"peer_mode", run.mode.Name()},
             {"peer_rate_per_s", timings.Rate(1).median},
             {"ratio", ratio.median},
             {"ratio_min", ratio.min},
             {"ratio_max", ratio.max},
             {"ratio_total", timings.TotalRatio(0, 1)},
             {"units_per_repetition", timings.UnitsPerRepetition()},
             {"disagreements", agreement.disagreements},
             {"disagreements_beyond_rounding", agreement.beyond_rounding},
             {"ties", agreement.ties},
             {"checked_by_single", agreement.by_single},
             {"checked_by_brute_force", agreement.by_brute_force},
             {"repeats", bench.options.work.repeats},
             {"sources", bench.options.work.sources}};
  if (run.workload.views() > 0) {
    row["width"] = run.spec.width;
    row["height"] = run.spec.height;
  }
  if (bench.fast != nullptr) {
    const Spread fast = timings.Ratio(0, 2);
    row["fast_peer_mode"] = run.fast_mode.Name();
    row["fast_peer_rate_per_s"] = timings.Rate(2).median;
    row["fast_ratio"] = fast.median;
    row["fast_ratio_min"] = fast.min;
    row["fast_ratio_max"] = fast.max;
    row["fast_ratio_total"] = timings.TotalRatio(0, 2);
    row["fast_disagreements"] = fast_agreement.disagreements;
  }
  return WithCommonKeys(row);
}

absl::Status RunWorkload(const Bench& bench, const std::string& name, const ImageSize& size,
                         Context& context, Report* report) {
  SL_ASSIGN_OR_RETURN(const WorkloadSpec spec, bench.options.work.Spec(name, size));
  const std::string title = absl::StrCat(bench.source.name, ", ", Describe(spec));
  context.err << title << ": points and lights" << std::endl;
  SL_ASSIGN_OR_RETURN(const std::unique_ptr<Workload> workload,
                      MakeWorkload(spec, bench.source, bench.scene, bench.pool));
  context.err << title << ": Embree's best mode" << std::endl;
  const Clock clock = ClockFor(bench.threads);
  const PeerMode mode = PickMode(*workload, bench.robust, clock);
  const PeerMode fast_mode = bench.fast == nullptr ? mode : PickMode(*workload, *bench.fast, clock);
  context.err << title << ": comparing answers" << std::endl;
  QueryStats stats;
  const std::vector<Agreement> by_view =
      CompareAll(*workload, bench.robust, mode, /*settle=*/true, &stats);
  const Agreement agreement = Sum(by_view);
  for (const std::string& example : agreement.examples) {
    context.err << title << ": WRONG: " << example << std::endl;
  }
  std::vector<Side> sides;
  sides.push_back({[&](size_t unit) { workload->RunOurs(unit); }});
  sides.push_back({[&](size_t unit) { workload->RunPeer(bench.robust, mode, unit, Share::kAll); }});
  std::vector<Agreement> fast_by_view(by_view.size());
  if (bench.fast != nullptr) {
    fast_by_view = CompareAll(*workload, *bench.fast, fast_mode, /*settle=*/false, &stats);
    sides.push_back(
        {[&](size_t unit) { workload->RunPeer(*bench.fast, fast_mode, unit, Share::kAll); }});
  }
  const Units units{workload->units(), [&](size_t unit) { return workload->queries(unit); },
                    [&](size_t unit) { return ViewOf(*workload, unit); },
                    MinSeconds(bench.options.work.quick)};
  const Timings timings = TimeByTurns(
      units, sides, bench.options.work.repeats,
      [&](size_t repetition) {
        context.err << title << ": repetition " << repetition + 1 << " of "
                    << bench.options.work.repeats << std::endl;
      },
      clock);
  const Run run{spec, *workload, mode, fast_mode, stats.strategy};
  report->Add(MakeRow(bench, run, timings, agreement, Sum(fast_by_view)));
  if (!bench.options.per_view || workload->views() == 0) return absl::OkStatus();
  for (size_t view = 0; view < by_view.size(); ++view) {
    if (by_view[view].queries == 0) continue;  // A view of nothing.
    Row row = MakeRow(bench, run, timings.groups[view], by_view[view], fast_by_view[view]);
    row["views"] = 1;
    row["view"] = view;
    report->Add(std::move(row));
  }
  return absl::OkStatus();
}

absl::Status RunScene(const Options& options, const std::string& name, Context& context,
                      Report* report) {
  SL_ASSIGN_OR_RETURN(const SimdTarget simd, ResolveIsa(options.work.isa));
  const int threads = ResolveThreads(options.work.threads);
  context.err << name << ": reading and building" << std::endl;
  SL_ASSIGN_OR_RETURN(const SceneSource source, ReadScene(name, options.work.views));
  ThreadPool pool(threads);
  SL_ASSIGN_OR_RETURN(const IndexedGeometry scene, IndexScene(source, options.work.Index(), pool));
  SL_ASSIGN_OR_RETURN(const auto device, EmbreeDevice::Open(threads, simd));
  const PeerMesh mesh(scene.geometry);
  SL_ASSIGN_OR_RETURN(const auto robust, EmbreeScene::Build(*device, mesh, {}));
  std::unique_ptr<EmbreeScene> fast;
  if (options.fast_peer) {
    SL_ASSIGN_OR_RETURN(fast, EmbreeScene::Build(*device, mesh, {.robust = false}));
  }
  const Bench bench{options, source, scene, *robust, fast.get(), threads, pool};
  for (const std::string& workload : options.work.Workloads()) {
    for (const ImageSize& size : options.work.Sizes(workload)) {
      SL_RETURN_IF_ERROR(RunWorkload(bench, workload, size, context, report));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<bool> EmbreeCommand(std::span<const std::string> args, Context& context) {
  Options options;
  cli::FlagSet flags = Flags(&options);
  SL_ASSIGN_OR_RETURN(const bool go_on, ParseOrHelp(&flags, args, context));
  if (!go_on) return true;
  SL_RETURN_IF_ERROR(options.work.Check());
  std::vector<Column> columns = Columns();
  if (options.fast_peer) columns.push_back(NumberColumn("to fast Embree", "fast_ratio", 2));
  Report report(std::move(columns), options.work.json, context.out);
  const absl::Status status = RunScenes(
      options.work.scenes, &report, context.err,
      [&](const std::string& scene) { return RunScene(options, scene, context, &report); });
  PrintOverScenes(report.rows(), "ratio", options.work.json, context.out);
  SL_RETURN_IF_ERROR(status);
  return std::none_of(report.rows().begin(), report.rows().end(), [](const Row& row) {
    return row.at("disagreements_beyond_rounding").get<uint64_t>() > 0;
  });
}

}  // namespace sightline::bench
