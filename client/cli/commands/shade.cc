// SPDX-License-Identifier: Apache-2.0
//
// sightline shade: which lights reach which points.
#include <algorithm>
#include <memory>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/cli/build_flags.h"
#include "client/cli/commands/command.h"
#include "client/cli/exit_code.h"
#include "client/cli/formats/npy.h"
#include "client/cli/formats/table.h"
#include "client/cli/light_flags.h"
#include "client/cli/scene_argument.h"
#include "client/cli/session.h"
#include "client/cli/view_choice.h"
#include "core/base/status_macros.h"

namespace sightline::cli {
namespace {

struct ShadeArguments {
  std::string points, normals, lights, out, output;
  StrategyFlags strategy;
  BuildFlags build;
  LightFlags light;
  std::optional<Vec3d> up;
  double attach = 0, offset = 0, t_min = 0;
  bool stats = false;
  SessionFlags session;
};

void Register(FlagSet* flags, ShadeArguments* a) {
  flags->Heading("Points");
  flags->Text(
      "points", "FILE",
      ".npy (n, 3), .csv with three columns, or the vertices of a .ply; scene units; required",
      &a->points);
  flags->Number("attach", "DISTANCE",
                "points take the nearest triangle within this distance as the surface they lie on, "
                "scene units; it then does not block them",
                &a->attach);
  flags->Number("offset", "DISTANCE",
                "points are moved so far along their normals, scene units; needs --normals",
                &a->offset);
  flags->Text("normals", "FILE", "one normal per point, any length; .npy (n, 3) or .csv",
              &a->normals);
  flags->Number("t-min", "SHARE",
                "segments end this share of their length before the point, 0 or more and below 1",
                &a->t_min);
  flags->Heading("Lights (in this order; at least one)");
  flags->Text("lights", "FILE", "point lights, .npy (n, 3) or .csv; scene units", &a->lights);
  a->light.Register(flags);
  flags->Point("up",
               "upward direction of the scene for --sun-at and --sky, any length (default: a "
               "built-in scene's own; z in .stl files and where a scene is over three times wider "
               "than high along z; else y)",
               &a->up);
  flags->Heading("Results");
  flags->Text("out", "FILE.npy", "uint8 [lights, points]: 1 lit, 0 blocked, 255 invalid; required",
              &a->out);
  flags->Switch("stats", "print rays, rates and work", &a->stats);
  RegisterOutput(flags, &a->output);
  flags->Heading("Work");
  a->strategy.Register(flags);
  a->session.Register(flags, /*embeddable=*/true);
  a->build.RegisterForQuery(flags);
}

absl::Status CheckArguments(const ShadeArguments& a) {
  if (a.points.empty()) return UsageError("wants --points FILE");
  if (a.out.empty()) return UsageError("wants --out FILE.npy");
  if (a.lights.empty() && !a.light.given()) {
    return UsageError(
        "wants lights: --lights FILE, --light X,Y,Z, --sun X,Y,Z, --sun-at TIME,LATITUDE,LONGITUDE "
        "or --sky PATCHES");
  }
  if (a.attach < 0) return UsageError(absl::StrCat("--attach wants 0 or more; got ", a.attach));
  if (!(a.t_min >= 0 && a.t_min < 1)) {
    return UsageError(absl::StrCat("--t-min wants 0 or more and below 1; got ", a.t_min));
  }
  if (a.offset != 0 && a.normals.empty()) {
    return UsageError("--offset moves points along their normals; give --normals FILE");
  }
  return CheckOutputs({a.out});
}

// Those of the file.
absl::StatusOr<std::vector<client::Light>> ReadLights(const ShadeArguments& a,
                                                      const CancelToken* cancel) {
  std::vector<client::Light> lights;
  if (a.lights.empty()) return lights;
  SL_ASSIGN_OR_RETURN(const std::vector<double> xyz, ReadRows(a.lights, 3, "lights", cancel));
  for (size_t i = 0; i + 2 < xyz.size(); i += 3) {
    lights.push_back(client::Light::Point({xyz[i], xyz[i + 1], xyz[i + 2]}));
  }
  if (lights.empty() && !a.light.given()) {
    return absl::InvalidArgumentError(absl::StrCat("'", a.lights, "': holds no light"));
  }
  return lights;
}

}  // namespace

absl::Status ShadeCommand(std::span<const std::string> args, Context& context) {
  ShadeArguments a;
  FlagSet flags("sightline shade SCENE --points FILE --lights FILE --out FILE.npy [flags]",
                "Tells which lights reach which points of a scene.");
  Register(&flags, &a);
  std::vector<std::string> words;
  SL_ASSIGN_OR_RETURN(bool go, ParseOrHelp(&flags, args, {"SCENE"}, SceneHelp(), context, &words));
  if (!go) return absl::OkStatus();
  SL_ASSIGN_OR_RETURN(const SceneBuild build,
                      a.build.ForQuery(flags, words[0], a.strategy.Trees()));
  SL_RETURN_IF_ERROR(CheckArguments(a));
  // Files first: a mistake in them shows before a scene is built.
  const CancelToken* const cancel = context.interruption.work();
  SL_ASSIGN_OR_RETURN(const std::vector<double> points, ReadRows(a.points, 3, "points", cancel));
  std::vector<double> normals;
  if (!a.normals.empty()) {
    SL_ASSIGN_OR_RETURN(normals, ReadRows(a.normals, 3, "normals", cancel));
    if (normals.size() != points.size()) {
      return absl::InvalidArgumentError(absl::StrCat("'", a.normals, "': holds ",
                                                     normals.size() / 3, " normals for ",
                                                     points.size() / 3, " points"));
    }
  }
  SL_ASSIGN_OR_RETURN(std::vector<client::Light> lights, ReadLights(a, cancel));

  SL_ASSIGN_OR_RETURN(std::unique_ptr<Session> session,
                      Session::Open(a.session, context.interruption.calls()));
  SL_ASSIGN_OR_RETURN(std::unique_ptr<OpenedScene> scene,
                      OpenScene(*session, words[0], context.err, build));
  SL_ASSIGN_OR_RETURN(const Vec3d up, SceneUp(*scene, a.up));
  SL_ASSIGN_OR_RETURN(const std::vector<client::Light> named, a.light.Lights(up));
  lights.insert(lights.end(), named.begin(), named.end());
  const size_t n = points.size() / 3;
  SL_RETURN_IF_ERROR(CheckAnswers(lights.size(), n, "points",
                                  "give fewer lights, or the points in several files"));
  SL_ASSIGN_OR_RETURN(client::Capabilities capabilities,
                      session->client().GetCapabilities(session->call()));
  client::ShadowQuery query;
  query.scene = scene->scene().name;
  query.options.revision = scene->scene().revision;
  a.strategy.Apply(&query.options);
  query.options.statistics = true;
  query.points.positions = points;
  query.points.normals = normals;
  query.point_options.attach_distance = a.attach;
  query.point_options.normal_offset = a.offset;
  query.t_min = a.t_min;
  query.lights = lights;
  Progress progress(context.err, context.err_is_terminal, "shading", "segments", n * lights.size());
  SL_ASSIGN_OR_RETURN(client::Shadows shadows, session->client().ComputeAllShadows(
                                                   query, session->stream(), [&](uint64_t done) {
                                                     progress.Update(done * lights.size());
                                                   }));
  progress.Finish();
  const size_t shape[] = {lights.size(), n};
  SL_RETURN_IF_ERROR(WithExitCode(WriteNpy<uint8_t>(a.out, shape, shadows.lit), kExitCannotCreate));

  const auto invalid =
      static_cast<uint64_t>(std::count(shadows.valid.begin(), shadows.valid.end(), 0));
  std::vector<double> shares;
  for (size_t k = 0; k < lights.size(); ++k) {
    const auto row = shadows.lit.begin() + static_cast<ptrdiff_t>(k * n);
    const auto lit = std::count(row, row + static_cast<ptrdiff_t>(n), uint8_t{1});
    shares.push_back(n == invalid ? 0.0
                                  : static_cast<double>(lit) / static_cast<double>(n - invalid));
  }
  if (a.output == "json") {
    Json json;
    json["command"] = "shade";
    json["scene"] = words[0];
    json["scene_name"] = scene->scene().name;
    json["revision"] = shadows.summary.revision;
    json["triangles"] = scene->scene().triangles;
    json["build_seconds"] = absl::ToDoubleSeconds(scene->scene().report.compile_time +
                                                  scene->scene().report.structure_time);
    json["points"] = n;
    json["lights"] = lights.size();
    json["suns"] = SunsJson(a.light);
    json["invalid_points"] = invalid;
    json["invalid_lights"] = shadows.invalid_samples;
    json["near_surface_points"] = shadows.near_surface_points;
    json["lit_shares"] = shares;
    AddSummaryJson(shadows.summary, capabilities.threads, &json);
    json["outputs"] = Json::array({{{"kind", "lit"}, {"path", a.out}}});
    PrintJson(json, context.out);
    return absl::OkStatus();
  }
  std::vector<std::pair<std::string, std::string>> rows = {
      {"points", GroupedCount(n)},
      {"invalid points", GroupedCount(invalid)},
      {"near a surface", GroupedCount(shadows.near_surface_points)},
      {"lights", GroupedCount(lights.size())},
      {"invalid lights", GroupedCount(shadows.invalid_samples.size())}};
  AddSunRows(a.light, &rows);
  for (size_t k = 0; k < std::min<size_t>(shares.size(), 8); ++k) {
    rows.emplace_back(absl::StrCat("lit by light ", k), Percent(shares[k]));
  }
  if (a.stats) {
    rows.emplace_back("rays", GroupedCount(shadows.summary.statistics.rays));
    rows.emplace_back("rays/s in the engine",
                      HumanCount(EngineRate(shadows.summary, capabilities.threads)));
    rows.emplace_back("rays/s seen by the client", HumanCount(ClientRate(shadows.summary)));
    rows.emplace_back("bytes received", GroupedCount(shadows.summary.bytes_received));
  }
  PrintTable(rows, context.out);
  if (shadows.near_surface_points > 0 && a.attach == 0) {
    context.err
        << "note: " << shadows.near_surface_points
        << " points lie within rounding of a triangle that may shadow them; --attach DISTANCE "
           "puts points onto their surface\n";
  }
  context.out << "wrote " << a.out << '\n';
  return absl::OkStatus();
}

}  // namespace sightline::cli
