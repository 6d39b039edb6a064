// SPDX-License-Identifier: Apache-2.0
//
// sightline-bench papers: the tables of the papers that the engine is built from, ours beside them.
#include <algorithm>
#include <array>
#include <cstdlib>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/exit_code.h"
#include "core/base/status_macros.h"
#include "tests/bench/command.h"
#include "tests/bench/papers/papers.h"

namespace sightline::bench {
namespace {

struct Options {
  std::string paper = "all", report;
  bool json = false;
  PaperOptions common;
};

struct Paper {
  const char* name;
  absl::Status (*run)(const PaperOptions&, PaperReport*, Context&);
};
constexpr std::array kPapers = {Paper{"000", &Paper000}, Paper{"001", &Paper001},
                                Paper{"002", &Paper002}, Paper{"003", &Paper003},
                                Paper{"004", &Paper004}};

cli::FlagSet Flags(Options* o) {
  cli::FlagSet flags("sightline-bench papers [--paper N] [flags]",
                     "Measures the papers' methods as their tables do, and prints their figures "
                     "beside ours. On one thread, which should have its core to itself.");
  std::vector<std::string> names = {"all"};
  for (const Paper& paper : kPapers) names.emplace_back(paper.name);
  flags.Choice("paper", names, "whose tables", &o->paper);
  flags.Text("report", "FILE.md", "also write the tables as Markdown, with plots (SVG) beside",
             &o->report);
  flags.Count("repeats", "N", "rounds, of whose times the median is taken", &o->common.repeats, 1,
              1000);
  flags.Text("scenes", "FOLDER",
             "where bunny.ply.xz, buddha_100k.obj.xz and sponza_crytek.obj.xz are; else the folder "
             "that SIGHTLINE_SCENES names, else ../shared/scenes of the working directory",
             &o->common.scenes_folder);
  flags.Text("sphere", "N",
             "triangles of paper 000's displaced sphere; its 10M make kd-trees of up to 1.3 GB, "
             "beside which laid out leaves take up to 6 GB, and take most of the time: 1M for a "
             "tenth of both; titles say where there are fewer",
             &o->common.sphere);
  flags.Count("size", "PIXELS", "of the real scenes' square pictures; 16 must divide it",
              &o->common.size, 16, 4096);
  flags.Switch("quick",
               "see that it runs: scenes and pictures as small as can be, one round; the figures "
               "say nothing",
               &o->common.quick);
  flags.Switch("json", "one JSON object per line, instead of tables", &o->json);
  return flags;
}

// As the tests' own: SIGHTLINE_SCENES, else the folder beside the tree, if it is run from there:
// the program does not know where it was built.
std::string ScenesFolder() {
  const char* const folder = std::getenv("SIGHTLINE_SCENES");
  return folder != nullptr && *folder != '\0' ? folder : "../shared/scenes";
}

}  // namespace

std::vector<double> SecondsByTurns(const std::vector<std::function<void()>>& calls,
                                   uint64_t repeats) {
  constexpr double kLeastSeconds = 4e-3;  // Of one turn: far above the clock's grain.
  std::vector<uint64_t> times(calls.size(), 1);
  for (size_t i = 0; i < calls.size(); ++i) {  // Warms up, too.
    calls[i]();
    const double start = ThreadSeconds();
    calls[i]();
    const double one = std::max(ThreadSeconds() - start, 1e-9);
    times[i] = static_cast<uint64_t>(std::max(1.0, kLeastSeconds / one));
  }
  std::vector<std::vector<double>> seconds(calls.size());
  for (uint64_t r = 0; r < repeats; ++r) {
    for (size_t i = 0; i < calls.size(); ++i) {
      const double start = ThreadSeconds();
      for (uint64_t n = 0; n < times[i]; ++n) calls[i]();
      seconds[i].push_back((ThreadSeconds() - start) / static_cast<double>(times[i]));
    }
  }
  std::vector<double> medians;
  for (std::vector<double>& values : seconds) medians.push_back(SpreadOf(std::move(values)).median);
  return medians;
}

absl::StatusOr<bool> PapersCommand(std::span<const std::string> args, Context& context) {
  Options options;
  cli::FlagSet flags = Flags(&options);
  SL_ASSIGN_OR_RETURN(const bool go_on, ParseOrHelp(&flags, args, context));
  if (!go_on) return true;
  if (options.common.size % 16 != 0) {
    return cli::UsageError(
        absl::StrCat("--size is ", options.common.size, "; it must be a multiple of 16"));
  }
  if (options.common.quick) {
    options.common.repeats = 1;
    options.common.size = 32;
    options.common.sphere = "2000";
    context.err << "--quick: the figures say nothing" << std::endl;
  }
  if (options.common.scenes_folder.empty()) options.common.scenes_folder = ScenesFolder();
  PaperReport report(options.json, context.out, options.report);
  SL_RETURN_IF_ERROR(report.CheckWritable());
  for (const Paper& paper : kPapers) {
    if (options.paper != "all" && options.paper != paper.name) continue;
    SL_RETURN_IF_ERROR(paper.run(options.common, &report, context));
  }
  report.EndClaims();
  SL_RETURN_IF_ERROR(report.Finish());
  return true;
}

}  // namespace sightline::bench
