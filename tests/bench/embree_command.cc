// SPDX-License-Identifier: Apache-2.0
//
// sightline-bench embree: the engine against Embree, workload by workload and scene by scene.
#include <algorithm>
#include <iterator>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/cli/exit_code.h"
#include "core/base/status_macros.h"
#include "tests/bench/bench_scene.h"
#include "tests/bench/command.h"
#include "tests/bench/embree_peer.h"
#include "tests/bench/measure.h"
#include "tests/bench/report.h"
#include "tests/bench/workload.h"

namespace sightline::bench {
namespace {

constexpr const char* kWorkloads[] = {"primary", "shadow", "sun", "area", "points", "segments"};

struct Options {
  std::vector<std::string> scenes, workloads;
  std::string views;
  uint64_t width = 1920, height = 1080, threads = 1, repeats = 5;
  std::string strategy = "AUTO", isa = "best";
  uint64_t points = 1'000'000, range = 65'536;
  std::string lights = "sky";
  bool shuffled = false, sources = false, fast_peer = true, json = false;
};

cli::FlagSet Flags(Options* o) {
  cli::FlagSet flags(
      "sightline-bench embree --scene SCENE --workload WORKLOAD [flags]",
      "Times the engine against Embree, both in this process, by turns, over the same floats.");
  flags.Heading("What");
  flags.Texts("scene", "SCENE", "a mesh file or a built-in scene", &o->scenes);
  flags.Texts("workload", "WORKLOAD", absl::StrJoin(kWorkloads, ", "), &o->workloads);
  flags.Text("views", "FILE", "views by scene, instead of views.json beside the scene file",
             &o->views);
  flags.Count("width", "PIXELS", "of the views", &o->width, 1, kMaxImageSide);
  flags.Count("height", "PIXELS", "of the views", &o->height, 1, kMaxImageSide);
  flags.Heading("points and segments");
  flags.Count("points", "N", "how many surface points, or segments", &o->points, 1, 1'000'000'000);
  flags.Choice("lights", {"sky", "lights"},
               "of points: 145 directions to the sky, or 64 point lights", &o->lights);
  flags.Switch("shuffled", "the surface points in random order", &o->shuffled);
  flags.Count("range", "N", "points or segments handed over in one call", &o->range, 1,
              1'000'000'000);
  flags.Heading("How");
  RegisterThreads(&flags, &o->threads);
  flags.Custom("strategy", "NAME", "of the engine", o->strategy,
               [o](const std::string& text) -> absl::Status {
                 SL_ASSIGN_OR_RETURN(const Strategy strategy, ParseStrategy(text));
                 o->strategy = std::string(StrategyName(strategy));
                 return absl::OkStatus();
               });
  RegisterIsa(&flags, &o->isa);
  flags.Count("repeats", "N", "repetitions, of whose ratios the median is given", &o->repeats, 1,
              1000);
  flags.Switch("fast-peer", "also time Embree's mode that is not robust", &o->fast_peer);
  flags.Switch("sources",
               "tell the engine which triangle a point lies on; Embree cannot be told, so lights "
               "behind that triangle are then answered differently",
               &o->sources);
  flags.Switch("json", "one JSON object per line, instead of a table", &o->json);
  return flags;
}

absl::Status CheckOptions(const Options& o) {
  if (o.scenes.empty()) return cli::UsageError("wants --scene");
  if (o.workloads.empty()) return cli::UsageError("wants --workload");
  for (const std::string& workload : o.workloads) {
    if (std::find(std::begin(kWorkloads), std::end(kWorkloads), workload) == std::end(kWorkloads)) {
      return cli::UsageError(absl::StrCat(
          "--workload wants one of ", absl::StrJoin(kWorkloads, ", "), "; got '", workload, "'"));
    }
  }
  return absl::OkStatus();
}

std::vector<Column> Columns() {
  return {TextColumn("workload", "workload"),
          TextColumn("scene", "scene"),
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
  const SimdTarget simd;
  ThreadPool& pool;
};

absl::StatusOr<WorkloadSpec> ToSpec(const Bench& bench, const std::string& workload) {
  WorkloadSpec spec;
  spec.name = workload;
  spec.width = static_cast<uint32_t>(bench.options.width);
  spec.height = static_cast<uint32_t>(bench.options.height);
  spec.points = bench.options.points;
  spec.lights = bench.options.lights;
  spec.shuffled = bench.options.shuffled;
  spec.sources = bench.options.sources;
  spec.range = bench.options.range;
  SL_ASSIGN_OR_RETURN(spec.options.strategy, ParseStrategy(bench.options.strategy));
  spec.options.simd = bench.simd;
  return spec;
}

// What a workload is called in figures: points say their lights and order.
std::string Describe(const WorkloadSpec& spec) {
  if (spec.name != "points") return spec.name;
  return absl::StrCat(spec.name, "-", spec.lights, spec.shuffled ? "-shuffled" : "");
}

// Runs every unit once on both sides and compares; warms up as it goes.
Agreement CompareAll(Workload& workload, const EmbreeScene& peer, PeerMode mode, bool settle) {
  Agreement agreement;
  agreement.settle = settle;
  for (size_t unit = 0; unit < workload.units(); ++unit) {
    workload.RunOurs(unit);
    workload.RunPeer(peer, mode, unit, Share::kAll);
    workload.Compare(unit, &agreement);
  }
  return agreement;
}

absl::StatusOr<Row> RunWorkload(const Bench& bench, const std::string& name, Context& context) {
  SL_ASSIGN_OR_RETURN(const WorkloadSpec spec, ToSpec(bench, name));
  const std::string title = absl::StrCat(bench.source.name, ", ", Describe(spec));
  context.err << title << ": points and lights" << std::endl;
  SL_ASSIGN_OR_RETURN(const std::unique_ptr<Workload> workload,
                      MakeWorkload(spec, bench.source, bench.scene, bench.pool));
  context.err << title << ": Embree's best mode" << std::endl;
  const PeerMode mode = PickMode(*workload, bench.robust);
  const PeerMode fast_mode = bench.fast == nullptr ? mode : PickMode(*workload, *bench.fast);
  context.err << title << ": comparing answers" << std::endl;
  const Agreement agreement = CompareAll(*workload, bench.robust, mode, /*settle=*/true);
  for (const std::string& example : agreement.examples) {
    context.err << title << ": WRONG: " << example << std::endl;
  }
  std::vector<Side> sides;
  sides.push_back({[&](size_t unit) { workload->RunOurs(unit); }});
  sides.push_back({[&](size_t unit) { workload->RunPeer(bench.robust, mode, unit, Share::kAll); }});
  Agreement fast_agreement;
  if (bench.fast != nullptr) {
    fast_agreement = CompareAll(*workload, *bench.fast, fast_mode, /*settle=*/false);
    sides.push_back(
        {[&](size_t unit) { workload->RunPeer(*bench.fast, fast_mode, unit, Share::kAll); }});
  }
  const Units units{workload->units(), [&](size_t unit) { return workload->queries(unit); }};
  const Timings timings = TimeByTurns(units, sides, bench.options.repeats, [&](size_t repetition) {
    context.err << title << ": repetition " << repetition + 1 << " of " << bench.options.repeats
                << std::endl;
  });

  const Spread ratio = timings.Ratio(0, 1);
  Row row = {{"workload", Describe(spec)},
             {"scene", bench.source.name},
             {"triangles", bench.scene.geometry.triangles.size()},
             {"views", workload->views()},
             {"queries", agreement.queries},
             {"threads", bench.threads},
             {"isa", std::string(SimdTargetName(bench.simd))},
             {"strategy", bench.options.strategy},
             {"rate_per_s", timings.Rate(0).median},
             {"peer", absl::StrCat(EmbreeDevice::Name(), " robust")},
             {"peer_mode", mode.Name()},
             {"peer_rate_per_s", timings.Rate(1).median},
             {"ratio", ratio.median},
             {"ratio_min", ratio.min},
             {"ratio_max", ratio.max},
             {"disagreements", agreement.disagreements},
             {"disagreements_beyond_rounding", agreement.beyond_rounding},
             {"ties", agreement.ties},
             {"checked_by_single", agreement.by_single},
             {"checked_by_brute_force", agreement.by_brute_force},
             {"repeats", bench.options.repeats},
             {"sources", bench.options.sources}};
  if (workload->views() > 0) {
    row["width"] = spec.width;
    row["height"] = spec.height;
  }
  if (bench.fast != nullptr) {
    const Spread fast = timings.Ratio(0, 2);
    row["fast_peer_mode"] = fast_mode.Name();
    row["fast_peer_rate_per_s"] = timings.Rate(2).median;
    row["fast_ratio"] = fast.median;
    row["fast_ratio_min"] = fast.min;
    row["fast_ratio_max"] = fast.max;
    row["fast_disagreements"] = fast_agreement.disagreements;
  }
  return row;
}

absl::Status RunScene(const Options& options, const std::string& name, Context& context,
                      Report* report) {
  SL_ASSIGN_OR_RETURN(const SimdTarget simd, ResolveIsa(options.isa));
  const int threads = ResolveThreads(options.threads);
  context.err << name << ": reading and building" << std::endl;
  SL_ASSIGN_OR_RETURN(const SceneSource source, ReadScene(name, options.views));
  ThreadPool pool(threads);
  SL_ASSIGN_OR_RETURN(const IndexedGeometry scene, IndexScene(source, {}, pool));
  SL_ASSIGN_OR_RETURN(const auto device, EmbreeDevice::Open(threads, simd));
  const PeerMesh mesh(scene.geometry);
  SL_ASSIGN_OR_RETURN(const auto robust, EmbreeScene::Build(*device, mesh, {}));
  std::unique_ptr<EmbreeScene> fast;
  if (options.fast_peer) {
    SL_ASSIGN_OR_RETURN(fast, EmbreeScene::Build(*device, mesh, {.robust = false}));
  }
  const Bench bench{options, source, scene, *robust, fast.get(), threads, simd, pool};
  for (const std::string& workload : options.workloads) {
    SL_ASSIGN_OR_RETURN(Row row, RunWorkload(bench, workload, context));
    report->Add(std::move(row));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<bool> EmbreeCommand(std::span<const std::string> args, Context& context) {
  Options options;
  cli::FlagSet flags = Flags(&options);
  SL_ASSIGN_OR_RETURN(const bool go_on, ParseOrHelp(&flags, args, context));
  if (!go_on) return true;
  SL_RETURN_IF_ERROR(CheckOptions(options));
  std::vector<Column> columns = Columns();
  if (options.fast_peer) columns.push_back(NumberColumn("to fast Embree", "fast_ratio", 2));
  Report report(std::move(columns), options.json, context.out);
  for (const std::string& scene : options.scenes) {
    if (absl::Status status = RunScene(options, scene, context, &report); !status.ok()) {
      report.Finish();
      return status;
    }
  }
  report.Finish();
  uint64_t wrong = 0;
  for (const Row& row : report.rows()) {
    wrong += row.at("disagreements_beyond_rounding").get<uint64_t>();
  }
  if (!options.json && options.scenes.size() > 1) {
    for (const std::string& workload : options.workloads) {
      std::vector<Row> rows;
      for (const Row& row : report.rows()) {
        if (absl::StartsWith(row.at("workload").get<std::string>(), workload)) rows.push_back(row);
      }
      context.out << absl::StrFormat("%s: geometric mean of the ratio %.2f\n", workload,
                                     GeometricMean(rows, "ratio"));
    }
  }
  return wrong == 0;
}

}  // namespace sightline::bench
