// SPDX-License-Identifier: Apache-2.0
#include "client/load/options.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "client/cli/exit_code.h"
#include "client/cli/flags.h"
#include "client/cli/scene_argument.h"
#include "client/lib/upload.h"
#include "client/load/plain_number.h"
#include "client/load/recorder.h"
#include "core/base/status_macros.h"

namespace sightline::load {
namespace {

using cli::FlagSet;
using cli::UsageError;

constexpr absl::Duration kLongest = absl::Hours(24);
constexpr uint64_t kMostConnections = 64;
constexpr uint32_t kLargestSide = 8192;
// Of the points of the requests, and of their segments: the most of --distinct goes with the
// --points that are the default.
constexpr uint64_t kMostPreparedBytes = uint64_t{2} << 30;

constexpr char kExitCodes[] =
    "Exit codes beside those of sightline (64 usage, 65 bad values, 66 no such file or scene,\n"
    "69 no connection, 70 internal error, 73 no output, 78 wrong processor):\n"
    "  0   the run was measured; the objective of --slo held, if there was one, as far as the run "
    "came\n"
    "  1   the objective was missed, also since nothing was answered, or --find-knee found no rate "
    "that\n"
    "      meets it\n"
    "  75  busy or out of time; interrupted before the first request, or while --find-knee went "
    "on: the\n"
    "      report has its trials by then\n"
    "  76  answers were wrong\n";

constexpr char kTimeout[] =
    "--timeout holds for what comes before a run, --item-timeout for each request of it.\n";

constexpr char kChecks[] =
    "What is due is found before the run: by the engine in this process, on --check-scene, or on "
    "SCENE\n"
    "if that is no server's, or on the built-in scene that the server's was made of. Where the "
    "server\n"
    "does not say so, it is the server's own answers, asked for once by BRUTE_FORCE if that is "
    "cheap,\n"
    "else by SINGLE: a weaker check, which is warned about, and which --reload-by edit does not "
    "have.\n";

void AddDuration(FlagSet* flags, std::string name, std::string help, absl::Duration least,
                 absl::Duration* target) {
  flags->Custom(std::move(name), "DURATION", std::move(help), absl::FormatDuration(*target),
                [least, target](const std::string& text) -> absl::Status {
                  absl::Duration value;
                  if (!absl::ParseDuration(text, &value) || value < least || value > kLongest) {
                    return absl::InvalidArgumentError(
                        absl::StrCat("wants a duration such as 30s or 1.5m, from ",
                                     absl::FormatDuration(least), " to 24h"));
                  }
                  *target = value;
                  return absl::OkStatus();
                });
}

absl::Status ParseSize(const std::string& text, LoadOptions* o) {
  const std::vector<std::string> parts = absl::StrSplit(text, 'x');
  uint32_t w = 0, h = 0;
  if (parts.size() != 2 || !absl::SimpleAtoi(parts[0], &w) || !absl::SimpleAtoi(parts[1], &h) ||
      w == 0 || h == 0 || w > kLargestSide || h > kLargestSide) {
    return absl::InvalidArgumentError(
        absl::StrCat("wants WIDTHxHEIGHT in pixels, each from 1 to ", kLargestSide));
  }
  o->width = w;
  o->height = h;
  return absl::OkStatus();
}

// What flags write before it is taken over.
struct Texts {
  std::string mode = "closed", arrivals = "poisson", check = "sample", reload_by = "edit";
  std::string mix = "tiles=5,points=3,segments=2";
  uint64_t tile = 64;
};

void RegisterLoad(FlagSet* flags, LoadOptions* o, Texts* texts) {
  flags->Text("scene", "SCENE", "what is asked about, see below; required", &o->scene);
  flags->Heading("Load");
  flags->Choice("mode", {"open", "closed"},
                "open: requests go out when they are due, at --rate, and --rate alone says so; "
                "closed: --concurrency are always under way, but for what waits after a refusal",
                &texts->mode);
  flags->Number("rate", "R",
                "open loop: requests per second; with --find-knee: where it begins, else at 50",
                &o->plan.rate);
  flags->Choice("arrivals", {"poisson", "constant"},
                "open loop: due as independent users come, or evenly", &texts->arrivals);
  flags->Count("concurrency", "N", "closed loop: requests under way", &o->plan.concurrency, 1,
               65536);
  flags->Count("connections", "N", "network connections, each with streams of its own",
               &o->session.connections, 1, kMostConnections);
  AddDuration(flags, "duration", "how long is measured", absl::Milliseconds(100),
              &o->plan.duration);
  AddDuration(flags, "warm-up", "how long is run before that", absl::ZeroDuration(),
              &o->plan.warm_up);
  flags->Count("requests", "N", "ends the run after so many measured requests, 0: by time alone",
               &o->plan.max_requests, 0, uint64_t{1} << 40);
  flags->Switch("until-stable", "ends the run once three windows agree within 10 %",
                &o->until_stable);
  AddDuration(
      flags, "window",
      "length of a window; a run has 4000 at most, and longer ones by default where it takes "
      "longer than these",
      absl::Milliseconds(10), &o->window);
  AddDuration(flags, "drain", "how long is waited for answers at the end", absl::ZeroDuration(),
              &o->plan.drain);
  AddDuration(flags, "item-timeout", "the deadline that each request carries, 0s: none",
              absl::ZeroDuration(), &o->item_timeout);
  flags->Count("reload-every", "N",
               "changes the scene on the server each time so many requests were answered; 0: never",
               &o->reload_every, 0, uint64_t{1} << 40);
  flags->Choice("reload-by", {"edit", "file"},
                "edit: an object comes and goes; file: the server reads the scene again, which its "
                "repository has",
                &texts->reload_by);
  flags->Count("seed", "N", "of the arrivals, the mix and the points", &o->plan.seed, 0,
               UINT64_MAX);
}

void RegisterWorkload(FlagSet* flags, LoadOptions* o, Texts* texts) {
  flags->Heading("What is asked");
  flags->Choice("workload", {"tiles", "points", "segments", "mixed"},
                "camera tiles with their lights; points with lights; small segment queries; all, "
                "as --mix says",
                &o->workload);
  flags->Text("mix", "KIND=WEIGHT,...", "how often mixed asks each kind", &texts->mix);
  flags->Custom("size", "WIDTHxHEIGHT", "of the cameras' images, pixels", "640x360",
                [o](const std::string& text) { return ParseSize(text, o); });
  flags->Count("tile", "PIXELS", "side of a tile", &texts->tile, 1, 4096);
  flags->Count("cameras", "N", "places along the path", &o->cameras, 1, 32);
  flags->Text("path", "FILE", "the path: eye and at, six columns, .npy or .csv", &o->path);
  flags->Point("eye", "where the middle of the path is; by rule if not given", &o->view.eye);
  flags->Point("at", "what its cameras look at", &o->view.at);
  flags->Point("up", "upward direction", &o->view.up);
  flags->Count("points", "N", "points of a request", &o->points, 1, 1 << 20);
  flags->Count("segments", "N", "segments of a request", &o->segments, 1, 1 << 20);
  flags->Count("distinct", "N",
               "different requests of points and of segments; of each 2 GiB at most", &o->distinct,
               1, 65536);
  o->lights.Register(flags);
}

void RegisterResults(FlagSet* flags, LoadOptions* o, Texts* texts) {
  flags->Heading("Results");
  flags->Custom("slo", "CLAUSES",
                "the objective, such as p99=20ms,p50=5ms,errors=0.1%; latencies from the planned "
                "time; pN, mean, max, errors (none unless named), rate",
                "none", [o](const std::string& text) -> absl::Status {
                  SL_ASSIGN_OR_RETURN(o->slo, ParseSlo(text));
                  return absl::OkStatus();
                });
  flags->Switch("find-knee",
                "searches the highest rate that meets --slo and keeps up, then measures it",
                &o->find_knee);
  AddDuration(flags, "trial", "how long --find-knee tries a rate", absl::Milliseconds(100),
              &o->trial);
  flags->Choice("check", {"none", "sample", "all"},
                "which answers are compared, bit for bit, with what is due, see below; sample: of "
                "every eighth item",
                &texts->check);
  flags->Text("check-scene", "SCENE",
              "what the engine in this process has, where --scene is one of the server's: the file "
              "of its repository, or the mesh that it was made of",
              &o->check_scene);
  flags->Choice("output", {"text", "json", "csv"},
                "what is printed on standard output; csv: a line per window", &o->output);
  flags->Text("hgrm", "FILE", "latencies from the planned time for HdrHistogram's plotters",
              &o->hgrm);
  flags->Text("plot", "FILE.png|FILE.svg", "latency by percentile and over time", &o->plot);
  flags->Text("server-metrics", "HOST:PORT|URL",
              "where the server's metrics are, to be read before and after", &o->server_metrics);
  flags->Text("metrics-token-file", "FILE", "holds a bearer token to show for them",
              &o->metrics_token_file);
}

// A run has no more windows than are kept: what is called its last ones are its last ones.
absl::Status FitWindows(const FlagSet& flags, LoadOptions* o) {
  const absl::Duration longest =
      o->find_knee ? std::max(o->plan.duration, o->trial) : o->plan.duration;
  const auto most = static_cast<int64_t>(Recorder::kMaxWindows);
  if (o->window * most >= longest) return absl::OkStatus();
  if (flags.given("window")) {
    return UsageError(absl::StrCat(
        "--window ", absl::FormatDuration(o->window), " would make more than ", most,
        " windows of ", absl::FormatDuration(longest), ": give ",
        absl::FormatDuration(absl::Ceil(longest / most, absl::Milliseconds(1))), " or more"));
  }
  o->window = absl::Ceil(longest / most, absl::Seconds(1));
  return absl::OkStatus();
}

// What a request asks of a kind that takes numbers along.
struct Asked {
  Kind kind;
  uint64_t each, bytes;  // How many, and of how many bytes each.
};

std::vector<Asked> WhatIsAsked(const LoadOptions& o) {
  std::vector<Asked> asked;
  for (const Asked& a : {Asked{Kind::kPoints, o.points, 3 * sizeof(double)},
                         Asked{Kind::kSegments, o.segments, 6 * sizeof(double)}}) {
    if (o.mix[static_cast<size_t>(a.kind)] > 0) asked.push_back(a);
  }
  return asked;
}

// What is asked is prepared before the clock starts, and kept.
absl::Status CheckMemory(const LoadOptions& o) {
  for (const auto& [kind, each, bytes] : WhatIsAsked(o)) {
    const uint64_t sum = each * o.distinct * bytes;
    if (sum <= kMostPreparedBytes) continue;
    return UsageError(absl::StrCat(
        "--", KindName(kind), " ", each, " and --distinct ", o.distinct, " would take ",
        PlainNumber(std::ldexp(static_cast<double>(sum), -30), 4), " GiB of memory, ",
        kMostPreparedBytes >> 30, " GiB is the most: give --distinct ",
        kMostPreparedBytes / (each * bytes), " or less, or --", KindName(kind), " ",
        kMostPreparedBytes / (o.distinct * bytes), " or less"));
  }
  return absl::OkStatus();
}

absl::Status Finish(const FlagSet& flags, const Texts& texts, LoadOptions* o) {
  if (o->scene.empty()) return UsageError("wants --scene SCENE");
  // A plain word that is no file is what a server calls it.
  if (!o->session.server.empty() && o->scene.find_first_of("./:") == std::string::npos &&
      !std::filesystem::exists(o->scene)) {
    o->scene = cli::SceneName(o->scene);
  }
  const bool open = texts.mode == "open" || (!flags.given("mode") && flags.given("rate"));
  o->plan.mode = open || o->find_knee ? Mode::kOpen : Mode::kClosed;
  o->plan.arrivals = texts.arrivals == "poisson" ? Arrivals::kPoisson : Arrivals::kConstant;
  o->check = texts.check == "none"  ? Check::kNone
             : texts.check == "all" ? Check::kAll
                                    : Check::kSample;
  o->reload_by = texts.reload_by == "edit" ? ReloadBy::kEdit : ReloadBy::kFile;
  if (o->reload_by == ReloadBy::kFile && o->reload_every == 0) {
    return UsageError("--reload-by file goes with --reload-every");
  }
  SL_RETURN_IF_ERROR(FitWindows(flags, o));
  o->tile = static_cast<uint32_t>(texts.tile);
  if (o->workload == "mixed") {
    absl::StatusOr<Mix> mix = ParseMix(texts.mix);
    if (!mix.ok()) return UsageError(absl::StrCat("--mix ", mix.status().message()));
    o->mix = *mix;
  } else {
    if (flags.given("mix")) return UsageError("--mix goes with --workload mixed");
    for (size_t i = 0; i < kKinds; ++i) o->mix[i] = o->workload == kKindNames[i] ? 1 : 0;
  }
  SL_RETURN_IF_ERROR(CheckMemory(*o));
  if (o->find_knee) {
    if (o->slo.empty()) return UsageError("--find-knee wants --slo: what the rate is to meet");
    if (!flags.given("rate")) o->plan.rate = 50;
  }
  if (flags.given("rate") && !(o->plan.rate > 0 && o->plan.rate <= kHighestRate)) {
    return UsageError(absl::StrCat("--rate wants requests per second, above 0 and at most ",
                                   PlainNumber(kHighestRate, 3), "; got ",
                                   PlainNumber(o->plan.rate, 6)));
  }
  if (o->plan.mode == Mode::kOpen && !(o->plan.rate > 0)) {
    return UsageError("--mode open wants --rate: the requests per second");
  }
  if (texts.mode == "closed" && flags.given("mode") && o->find_knee) {
    return UsageError("--find-knee goes with --mode open");
  }
  for (const char* flag : {"rate", "arrivals"}) {
    if (o->plan.mode == Mode::kClosed && flags.given(flag)) {
      return UsageError(absl::StrCat("--", flag, " goes with --mode open"));
    }
  }
  if (o->plan.mode == Mode::kOpen && flags.given("concurrency")) {
    return UsageError("--concurrency goes with --mode closed: an open loop sends what is due");
  }
  if (!o->find_knee && flags.given("trial")) return UsageError("--trial goes with --find-knee");
  if (!o->plot.empty() && !absl::EndsWith(o->plot, ".png") && !absl::EndsWith(o->plot, ".svg")) {
    return UsageError(absl::StrCat("--plot wants FILE.png or FILE.svg; got '", o->plot, "'"));
  }
  if (!o->metrics_token_file.empty() && o->server_metrics.empty()) {
    return UsageError("--metrics-token-file goes with --server-metrics");
  }
  for (const char* flag : {"cameras", "eye", "at"}) {
    if (!o->path.empty() && flags.given(flag)) {
      return UsageError(absl::StrCat("--", flag, " goes without --path, which has the places"));
    }
  }
  if (!o->check_scene.empty() && o->check == Check::kNone) {
    return UsageError("--check-scene goes with --check sample or all");
  }
  if (!o->check_scene.empty() && cli::KindOf(o->check_scene) == cli::SceneKind::kServer) {
    return UsageError("--check-scene wants a file, FILE.slscene or builtin:NAME");
  }
  return o->session.Check();
}

}  // namespace

absl::StatusOr<std::unique_ptr<LoadOptions>> ParseOptions(std::span<const std::string> args,
                                                          std::ostream& out) {
  auto options = std::make_unique<LoadOptions>();
  options->plan.concurrency = 8;
  options->plan.warm_up = absl::Seconds(2);
  options->session.connections = 2;
  Texts texts;
  FlagSet flags("sightline-load --scene SCENE [--server HOST:PORT] [flags]",
                "Asks a server as many users would, and says how fast and how right it answers.");
  RegisterLoad(&flags, options.get(), &texts);
  RegisterWorkload(&flags, options.get(), &texts);
  RegisterResults(&flags, options.get(), &texts);
  options->session.Register(&flags, /*embeddable=*/true, /*streams_too=*/false);
  SL_ASSIGN_OR_RETURN(const std::vector<std::string> words, flags.Parse(args));
  if (flags.help_requested()) {
    out << flags.Help() << '\n'
        << cli::SceneHelp() << '\n'
        << kTimeout << '\n'
        << kChecks << '\n'
        << kExitCodes;
    return std::unique_ptr<LoadOptions>();
  }
  if (!words.empty()) return UsageError(absl::StrCat("unexpected '", words[0], "'"));
  SL_RETURN_IF_ERROR(Finish(flags, texts, options.get()));
  return options;
}

absl::Status CheckMessages(const LoadOptions& o, const client::Limits& limits) {
  if (limits.max_message_bytes == 0) return absl::OkStatus();
  for (const auto& [kind, each, bytes] : WhatIsAsked(o)) {
    // Points that the server keeps are named by a range; see LoadTest::OpenPointSet.
    if (kind == Kind::kPoints && o.reload_every == 0) continue;
    const uint64_t most = client::ArrayBytes(limits.max_message_bytes) / bytes;
    if (each <= most) continue;
    return UsageError(absl::StrCat(
        "--", KindName(kind), " ", each, " of ", bytes, " bytes each do not fit into a message of ",
        "the server, of which max_message_bytes is ", limits.max_message_bytes, ": give --",
        KindName(kind), " ", most, " or less"));
  }
  return absl::OkStatus();
}

}  // namespace sightline::load
