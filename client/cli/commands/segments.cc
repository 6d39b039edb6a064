// SPDX-License-Identifier: Apache-2.0
//
// sightline segments: does anything stand between A and B?
#include <algorithm>
#include <memory>

#include "absl/strings/str_cat.h"
#include "client/cli/build_flags.h"
#include "client/cli/commands/command.h"
#include "client/cli/exit_code.h"
#include "client/cli/formats/npy.h"
#include "client/cli/formats/table.h"
#include "client/cli/scene_argument.h"
#include "client/cli/session.h"
#include "core/base/status_macros.h"

namespace sightline::cli {

absl::Status SegmentsCommand(std::span<const std::string> args, Context& context) {
  std::string segments_path, out, output;
  StrategyFlags strategy;
  BuildFlags build_flags;
  bool stats = false;
  SessionFlags session_flags;
  FlagSet flags("sightline segments SCENE --segments FILE --out FILE.npy [flags]",
                "Tells which segments are blocked by a scene.");
  flags.Heading("Segments");
  flags.Text("segments", "FILE",
             "from and to, .npy (n, 6) or .csv with six columns; scene units; required",
             &segments_path);
  flags.Heading("Results");
  flags.Text("out", "FILE.npy", "uint8 [segments]: 1 blocked, 0 free, 255 invalid; required", &out);
  flags.Switch("stats", "print rays, rates and work", &stats);
  RegisterOutput(&flags, &output);
  flags.Heading("Work");
  strategy.Register(&flags);
  session_flags.Register(&flags, /*embeddable=*/true);
  build_flags.RegisterForQuery(&flags);
  std::vector<std::string> words;
  SL_ASSIGN_OR_RETURN(bool go, ParseOrHelp(&flags, args, {"SCENE"}, SceneHelp(), context, &words));
  if (!go) return absl::OkStatus();
  SL_ASSIGN_OR_RETURN(const SceneBuild build,
                      build_flags.ForQuery(flags, words[0], strategy.Trees()));
  if (segments_path.empty()) return UsageError("wants --segments FILE");
  if (out.empty()) return UsageError("wants --out FILE.npy");
  SL_RETURN_IF_ERROR(CheckOutputs({out}));
  SL_ASSIGN_OR_RETURN(const std::vector<double> segments,
                      ReadRows(segments_path, 6, "segments", context.interruption.work()));

  SL_ASSIGN_OR_RETURN(std::unique_ptr<Session> session,
                      Session::Open(session_flags, context.interruption.calls()));
  SL_ASSIGN_OR_RETURN(std::unique_ptr<OpenedScene> scene,
                      OpenScene(*session, words[0], context.err, build));
  SL_ASSIGN_OR_RETURN(client::Capabilities capabilities,
                      session->client().GetCapabilities(session->call()));
  client::SegmentQuery query;
  query.scene = scene->scene().name;
  query.options.revision = scene->scene().revision;
  query.origin = scene->scene().origin;
  strategy.Apply(&query.options);
  query.options.statistics = true;
  query.segments = segments;
  const size_t n = segments.size() / 6;
  Progress progress(context.err, context.err_is_terminal, "testing", "segments", n);
  SL_ASSIGN_OR_RETURN(client::Segments result,
                      session->client().TestAllSegments(
                          query, session->stream(), [&](uint64_t done) { progress.Update(done); }));
  progress.Finish();
  const size_t shape[] = {n};
  SL_RETURN_IF_ERROR(
      WithExitCode(WriteNpy<uint8_t>(out, shape, result.blocked), kExitCannotCreate));

  const auto blocked =
      static_cast<uint64_t>(std::count(result.blocked.begin(), result.blocked.end(), 1));
  const auto invalid =
      static_cast<uint64_t>(std::count(result.valid.begin(), result.valid.end(), 0));
  if (output == "json") {
    Json json;
    json["command"] = "segments";
    json["scene"] = words[0];
    json["scene_name"] = scene->scene().name;
    json["revision"] = result.summary.revision;
    json["triangles"] = scene->scene().triangles;
    json["build_seconds"] = absl::ToDoubleSeconds(scene->scene().report.compile_time +
                                                  scene->scene().report.structure_time);
    json["segments"] = n;
    json["blocked_segments"] = blocked;
    json["invalid_segments"] = invalid;
    AddSummaryJson(result.summary, capabilities.threads, &json);
    json["outputs"] = Json::array({{{"kind", "hit"}, {"path", out}}});
    PrintJson(json, context.out);
    return absl::OkStatus();
  }
  std::vector<std::pair<std::string, std::string>> rows = {
      {"segments", GroupedCount(n)},
      {"blocked", GroupedCount(blocked)},
      {"free", GroupedCount(n - blocked - invalid)},
      {"invalid", GroupedCount(invalid)}};
  if (stats) {
    rows.emplace_back("rays", GroupedCount(result.summary.statistics.rays));
    rows.emplace_back("rays/s in the engine",
                      HumanCount(EngineRate(result.summary, capabilities.threads)));
    rows.emplace_back("rays/s seen by the client", HumanCount(ClientRate(result.summary)));
    rows.emplace_back("bytes received", GroupedCount(result.summary.bytes_received));
  }
  PrintTable(rows, context.out);
  context.out << "wrote " << out << '\n';
  return absl::OkStatus();
}

}  // namespace sightline::cli
