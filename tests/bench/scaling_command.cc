// SPDX-License-Identifier: Apache-2.0
//
// sightline-bench scaling: what more threads gain the engine, as a share of what they gain a plain
// arithmetic loop in the same run. The loop shares nothing and waits for no memory: what it falls
// short of the number of threads is the machine's doing (two threads of one core, clocks that fall,
// neighbours), and the engine is not charged with it.
#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
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

// A chunk of the loop takes about as long as a tile of the engine, some 100 µs: both sides hand out
// work in pieces alike.
constexpr int kChunkSteps = 20'000;
constexpr int kChains = 16;

class ArithmeticLoop {
 public:
  // As many chunks as take `seconds` on one thread.
  explicit ArithmeticLoop(double seconds) {
    constexpr size_t kTrial = 100;
    ends_.resize(kTrial);
    RunChunks(0, kTrial);  // Wakes the core up.
    const double begin = Now();
    RunChunks(0, kTrial);
    const double chunk = (Now() - begin) / kTrial;
    ends_.resize(std::max<size_t>(kTrial, static_cast<size_t>(seconds / chunk)));
  }

  void Run(ThreadPool& pool) {
    pool.ParallelFor(ends_.size(), 1, [&](size_t begin, size_t end) { RunChunks(begin, end); });
  }

 private:
  // Independent chains of multiplications and additions, whose ends are kept.
  void RunChunks(size_t begin, size_t end) {
    for (size_t chunk = begin; chunk < end; ++chunk) {
      float x[kChains];
      for (int k = 0; k < kChains; ++k) x[k] = static_cast<float>(chunk + static_cast<size_t>(k));
      for (int step = 0; step < kChunkSteps; ++step) {
        for (float& value : x) value = value * 0.999f + 1.0f;
      }
      float sum = 0;
      for (const float value : x) sum += value;
      ends_[chunk] = sum;
    }
  }

  std::vector<float> ends_;
};

cli::FlagSet Flags(WorkloadFlags* work) {
  cli::FlagSet flags(
      "sightline-bench scaling --scene SCENE --workload WORKLOAD [flags]",
      "Times the engine on several threads against itself on one, beside an arithmetic loop that "
      "shares nothing: how much of what the machine's threads give it makes use of.");
  work->threads = 2;
  work->Register(&flags);
  return flags;
}

std::vector<Column> Columns() {
  return {TextColumn("workload", "workload"),
          SceneColumn("scene"),
          SizeColumn("pixels"),
          CountColumn("threads", "threads"),
          MegaColumn("one thread M/s", "rate_1_per_s"),
          MegaColumn("all M/s", "rate_per_s"),
          NumberColumn("gain", "gain", 2),
          NumberColumn("arithmetic's", "gain_arithmetic", 2),
          SpreadColumn("share", "share")};
}

// What is timed by turns.
enum Which : size_t { kOne, kAll, kLoopOne, kLoopAll };

absl::Status RunWorkload(const WorkloadFlags& work, const SceneSource& source,
                         const IndexedGeometry& scene, const std::string& name,
                         const ImageSize& size, ThreadPool& one, ThreadPool& all, Context& context,
                         Report* report) {
  SL_ASSIGN_OR_RETURN(WorkloadSpec spec, work.Spec(name, size));
  // Both have the same units and ranges: what is gained is gained by threads.
  spec.cut_for_threads = all.threads();
  const std::string title = absl::StrCat(source.name, ", ", Describe(spec));
  context.err << title << ": points and lights" << std::endl;
  SL_ASSIGN_OR_RETURN(const auto alone, MakeWorkload(spec, source, scene, one));
  SL_ASSIGN_OR_RETURN(const auto together, MakeWorkload(spec, source, scene, all));
  uint64_t queries = 0;
  uint64_t disagreements = 0;  // Units that threads answered otherwise than one.
  QueryStats stats;
  for (size_t unit = 0; unit < alone->units(); ++unit) {  // Warms up.
    alone->RunOurs(unit);
    together->RunOurs(unit);
    stats.Add(alone->OurStats());
    disagreements += alone->OurDigest() != together->OurDigest();
    queries += alone->queries(unit);
  }
  const double begin = Now();
  for (size_t unit = 0; unit < alone->units(); ++unit) alone->RunOurs(unit);
  // As long as a unit of the engine's, within reason.
  ArithmeticLoop loop(std::clamp((Now() - begin) / static_cast<double>(alone->units()), 0.01, 0.5));
  const std::vector<Side> sides = {{[&](size_t unit) { alone->RunOurs(unit); }},
                                   {[&](size_t unit) { together->RunOurs(unit); }},
                                   {[&](size_t) { loop.Run(one); }},
                                   {[&](size_t) { loop.Run(all); }}};
  const Timings timings = TimeByTurns({.count = alone->units(),
                                       .queries = [&](size_t unit) { return alone->queries(unit); },
                                       .min_seconds = MinSeconds(work.quick)},
                                      sides, work.repeats, [&](size_t repetition) {
                                        context.err << title << ": repetition " << repetition + 1
                                                    << " of " << work.repeats << std::endl;
                                      });
  std::vector<double> shares;
  for (size_t r = 0; r < work.repeats; ++r) {
    const auto gain = [&](size_t on_one, size_t on_all) {
      return timings.seconds[on_one][r] / timings.seconds[on_all][r];
    };
    shares.push_back(gain(kOne, kAll) / gain(kLoopOne, kLoopAll));
  }
  const Spread share = SpreadOf(shares);
  Row row = {{"workload", absl::StrCat("scaling-", Describe(spec))},
             {"scene", source.name},
             {"triangles", scene.geometry.triangles.size()},
             {"views", alone->views()},
             {"queries", queries},
             {"threads", all.threads()},
             {"isa", std::string(SimdTargetName(spec.options.simd))},
             {"strategy", std::string(StrategyName(stats.strategy))},
             {"strategy_asked", work.strategy},
             {"structure", work.structure},
             {"rate_per_s", timings.Rate(kAll).median},
             {"rate_1_per_s", timings.Rate(kOne).median},
             {"peer", "arithmetic loop"},
             {"peer_mode", absl::StrCat("gain of ", all.threads(), " threads over one")},
             {"ratio", share.median},
             {"ratio_min", share.min},
             {"ratio_max", share.max},
             {"disagreements", disagreements},
             {"disagreements_beyond_rounding", disagreements},
             {"gain", timings.Ratio(kAll, kOne).median},
             {"gain_arithmetic", timings.Ratio(kLoopAll, kLoopOne).median},
             {"share", share.median},
             {"share_min", share.min},
             {"share_max", share.max},
             {"repeats", work.repeats}};
  if (alone->views() > 0) {
    row["width"] = spec.width;
    row["height"] = spec.height;
  }
  report->Add(WithCommonKeys(row));
  return absl::OkStatus();
}

absl::Status RunScene(const WorkloadFlags& work, const std::string& name, Context& context,
                      Report* report) {
  context.err << name << ": reading and building" << std::endl;
  SL_ASSIGN_OR_RETURN(const SceneSource source, ReadScene(name, work.views));
  ThreadPool one(1), all(ResolveThreads(work.threads));
  SL_ASSIGN_OR_RETURN(const IndexedGeometry scene, IndexScene(source, work.Index(), all));
  for (const std::string& workload : work.Workloads()) {
    for (const ImageSize& size : work.Sizes(workload)) {
      SL_RETURN_IF_ERROR(
          RunWorkload(work, source, scene, workload, size, one, all, context, report));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<bool> ScalingCommand(std::span<const std::string> args, Context& context) {
  WorkloadFlags work;
  cli::FlagSet flags = Flags(&work);
  SL_ASSIGN_OR_RETURN(const bool go_on, ParseOrHelp(&flags, args, context));
  if (!go_on) return true;
  SL_RETURN_IF_ERROR(work.Check());
  if (ResolveThreads(work.threads) < 2) {
    return cli::UsageError("--threads wants 2 or more, since it is held against one");
  }
  Report report(Columns(), work.json, context.out);
  const absl::Status status =
      RunScenes(work.scenes, &report, context.err,
                [&](const std::string& scene) { return RunScene(work, scene, context, &report); });
  PrintOverScenes(report.rows(), "share", work.json, context.out);
  SL_RETURN_IF_ERROR(status);
  return std::none_of(report.rows().begin(), report.rows().end(),
                      [](const Row& row) { return row.at("disagreements").get<uint64_t>() > 0; });
}

}  // namespace sightline::bench
