// SPDX-License-Identifier: Apache-2.0
//
// sightline view: what a camera sees, which lights reach it, and pictures of both.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/cli/build_flags.h"
#include "client/cli/camera_flags.h"
#include "client/cli/commands/command.h"
#include "client/cli/exit_code.h"
#include "client/cli/formats/npy.h"
#include "client/cli/light_flags.h"
#include "client/cli/picture/pictures.h"
#include "client/cli/scene_argument.h"
#include "client/cli/session.h"
#include "client/cli/view_choice.h"
#include "core/base/status_macros.h"

namespace sightline::cli {
namespace {

// Of the lights' shares, in the line for people.
constexpr size_t kSharesShown = 8;

// Of pictures.
constexpr const char* kKinds[] = {"lit", "depth", "cost", "strategy"};

struct ViewArguments {
  CameraFlags view;
  LightFlags lights;
  std::vector<client::Mirror> mirrors;
  uint64_t auto_lights = 3;
  std::vector<std::string> outs;
  std::string picture = "lit";
  std::optional<uint64_t> strategy_light;  // Of the strategy picture; none: the camera's rays.
  std::string ids, depth, lit;
  std::string output;
  StrategyFlags strategy;
  BuildFlags build;
  bool stats = false;
  uint64_t tile = 64;
  SessionFlags session;
};

struct Output {
  std::string kind, path;
};

absl::Status AddMirror(const std::string& text, ViewArguments* arguments) {
  client::Mirror mirror;
  // Names may hold the sign, numbers do not.
  const size_t sign = text.rfind('=');
  mirror.object = text.substr(0, sign);
  if (mirror.object.empty()) return absl::InvalidArgumentError("wants an object's name");
  if (sign != std::string::npos) {
    const std::vector<std::string> parts = absl::StrSplit(text.substr(sign + 1), ',');
    double values[6] = {};
    bool good = parts.size() == std::size(values);
    for (size_t i = 0; i < parts.size() && good; ++i) good = absl::SimpleAtod(parts[i], &values[i]);
    if (!good) {
      return absl::InvalidArgumentError(
          "wants six numbers behind the =: a point of the mirror's plane, and its normal");
    }
    mirror.plane = {{values[0], values[1], values[2]}, {values[3], values[4], values[5]}};
  }
  arguments->mirrors.push_back(std::move(mirror));
  return absl::OkStatus();
}

void Register(FlagSet* flags, ViewArguments* a) {
  a->view.Register(flags);
  flags->Heading("Lights");
  a->lights.Register(flags);
  flags->Count("auto-lights", "N", "lights placed by rule where none of the above is given",
               &a->auto_lights, 0, 3);
  flags->Heading("Mirrors");
  flags->Custom("mirror", "OBJECT[=X,Y,Z,NX,NY,NZ]",
                "an object whose surface shows what is seen in it; by the plane of its largest "
                "triangle, or by a point and a normal; may be repeated",
                "none", [a](const std::string& text) { return AddMirror(text, a); });
  flags->Heading("Results");
  flags->Texts("out", "[KIND:]FILE.png",
               "a picture; KIND is lit, depth, cost or strategy, without it what --picture says",
               &a->outs);
  flags->Choice("picture", {kKinds, kKinds + std::size(kKinds)},
                "the kind of picture that --out FILE.png is", &a->picture);
  flags->Custom(
      "strategy-of", "eye|LIGHT",
      "whose rays the strategy picture shows: the camera's, or those of a light's shadows "
      "(its number from 0, in the order of --light, --sun, --sun-at, --sky)",
      "eye", [a](const std::string& text) -> absl::Status {
        uint64_t light = 0;
        a->strategy_light.reset();
        if (text == "eye") return absl::OkStatus();
        if (!absl::SimpleAtoi(text, &light)) {
          return absl::InvalidArgumentError("wants eye, or the number of a light from 0");
        }
        a->strategy_light = light;
        return absl::OkStatus();
      });
  flags->Text("ids", "FILE.npy",
              "object and triangle seen by each pixel, int32 [height, width, 2]; -1: none",
              &a->ids);
  flags->Text("depth", "FILE.npy",
              "depth along the view direction, scene units, float32 [height, width]; inf: none",
              &a->depth);
  flags->Text("lit", "FILE.npy",
              "uint8 [lights, height, width]; 1 lit, 0 blocked, 255 nothing seen", &a->lit);
  flags->Switch("stats", "print the table of triangles, build time, tiles, rays and rates",
                &a->stats);
  RegisterOutput(flags, &a->output);
  flags->Heading("Work");
  a->strategy.Register(flags);
  flags->Count("tile", "PIXELS", "side of the tiles that the picture is cut into", &a->tile, 1,
               4096);
  a->session.Register(flags, /*embeddable=*/true);
  a->build.RegisterForQuery(flags);
}

std::string Epilogue() {
  std::string key = "\nColours of the strategy picture, by what answered the pixel's ray:\n";
  for (const StrategyKeyEntry& entry : StrategyKey()) {
    absl::StrAppend(&key, absl::StrFormat("  %-7s %s\n", entry.color, entry.what));
  }
  absl::StrAppend(&key, "  grey    no ray: nothing is seen that a light could reach\n");
  return SceneHelp() + key +
         "\nWithout --eye and --at, built-in scenes use their own first view and lights. Other\n"
         "scenes are seen whole from outside, 35 degrees off the front and 25\n"
         "degrees from above (40 where they are flat); closed rooms in files from the\n"
         "inside. Without --up, z is up in .stl files and where a scene is over three times wider\n"
         "than high along z; else y is. Lights by rule stand about the view.\n";
}

absl::StatusOr<std::vector<Output>> ParseOutputs(const ViewArguments& a) {
  std::vector<Output> outputs;
  for (const std::string& out : a.outs) {
    Output output{a.picture, out};
    for (const char* kind : kKinds) {
      const std::string prefix = absl::StrCat(kind, ":");
      if (out.substr(0, prefix.size()) == prefix) output = {kind, out.substr(prefix.size())};
    }
    if (output.path.size() < 4 || output.path.substr(output.path.size() - 4) != ".png") {
      return UsageError(absl::StrCat("--out wants a name that ends in .png; got '", out, "'"));
    }
    outputs.push_back(output);
  }
  return outputs;
}

absl::Status WriteArrays(const ViewArguments& a, const client::TileImage& image) {
  const size_t n = size_t{image.width} * image.height;
  const auto written = [](absl::Status s) { return WithExitCode(std::move(s), kExitCannotCreate); };
  if (!a.ids.empty()) {
    std::vector<int32_t> ids(2 * n);
    for (size_t i = 0; i < n; ++i) {
      const bool hit = image.object[i] != client::kNone;
      ids[2 * i] = hit ? static_cast<int32_t>(image.object[i]) : -1;
      ids[2 * i + 1] = hit ? static_cast<int32_t>(image.triangle[i]) : -1;
    }
    const size_t shape[] = {image.height, image.width, 2};
    SL_RETURN_IF_ERROR(written(WriteNpy<int32_t>(a.ids, shape, ids)));
  }
  if (!a.depth.empty()) {
    const size_t shape[] = {image.height, image.width};
    SL_RETURN_IF_ERROR(written(WriteNpy<float>(a.depth, shape, image.depth)));
  }
  if (!a.lit.empty()) {
    const size_t shape[] = {image.samples, image.height, image.width};
    SL_RETURN_IF_ERROR(written(WriteNpy<uint8_t>(a.lit, shape, image.lit)));
  }
  return absl::OkStatus();
}

// Per light, the share of the pixels with a hit that it reaches.
std::vector<double> LitShares(const client::TileImage& image, uint64_t hits) {
  const size_t n = size_t{image.width} * image.height;
  std::vector<double> shares;
  for (uint32_t k = 0; k < image.samples && !image.lit.empty(); ++k) {
    const auto begin = image.lit.begin() + static_cast<ptrdiff_t>(k * n);
    const auto lit = std::count(begin, begin + static_cast<ptrdiff_t>(n), uint8_t{1});
    shares.push_back(hits == 0 ? 0.0 : static_cast<double>(lit) / static_cast<double>(hits));
  }
  return shares;
}

// What answered the rays that the strategy picture is of; empty if there is none.
std::span<const uint8_t> AnsweredBy(const client::TileImage& image, const ViewArguments& a) {
  if (image.lit_answered_by.empty()) return image.answered_by;
  const size_t n = size_t{image.width} * image.height;
  return std::span(image.lit_answered_by).subspan(*a.strategy_light * n, n);
}

// The shares of rays by what answered them, in the order of StrategyKey().
std::vector<double> AnsweredByShares(std::span<const uint8_t> answered_by) {
  std::vector<double> shares(StrategyKey().size());
  uint64_t rays = 0;
  for (const uint8_t by : answered_by) {
    if (by == 0 || by > shares.size()) continue;
    ++rays;
    ++shares[by - 1];
  }
  for (double& share : shares) share /= static_cast<double>(std::max<uint64_t>(1, rays));
  return shares;
}

std::string AnsweredByText(std::span<const uint8_t> answered_by) {
  static constexpr const char* kNames[] = {"shafts", "relevant triangles", "packets",
                                           "single rays"};
  const std::vector<double> shares = AnsweredByShares(answered_by);
  std::string text;
  for (size_t k = 0; k < shares.size(); ++k) {
    absl::StrAppend(&text, k == 0 ? "" : ", ", kNames[k], " ", Percent(shares[k]));
  }
  return text;
}

Json ViewJson(const std::string& argument, const OpenedScene& scene, const ViewChoice& view,
              const std::vector<client::Light>& lights, const client::TileImage& image,
              const std::vector<Output>& outputs, const ViewArguments& a, uint64_t hits,
              const std::vector<double>& shares, uint32_t threads) {
  const auto vec = [](Vec3d v) { return Json::array({v.x, v.y, v.z}); };
  Json json;
  json["command"] = "view";
  json["scene"] = argument;
  json["scene_name"] = scene.scene().name;
  json["revision"] = image.summary.revision;
  json["objects"] = scene.scene().objects;
  json["triangles"] = scene.scene().triangles;
  json["build_seconds"] = absl::ToDoubleSeconds(scene.scene().report.compile_time +
                                                scene.scene().report.structure_time);
  json["resident_bytes"] = scene.scene().report.resident_bytes;
  json["camera"] = {{"chosen", view.how},
                    {"eye", vec(view.eye)},
                    {"at", vec(view.at)},
                    {"up", vec(view.up)},
                    {"fov_y_deg", view.fov_y_degrees},
                    {"width", image.width},
                    {"height", image.height}};
  json["lights"] = Json::array();
  for (const client::Light& light : lights) {
    const bool sun = light.kind == client::Light::Kind::kDirectional;
    const client::Point3& p = sun ? light.direction : light.position;
    json["lights"].push_back({{"kind", sun ? "sun" : "point"}, {"value", {p[0], p[1], p[2]}}});
  }
  json["suns"] = SunsJson(a.lights);
  json["tiles"] = image.summary.items;
  json["tile_size"] = a.tile;
  json["pixels"] = uint64_t{image.width} * image.height;
  json["hit_pixels"] = hits;
  json["lit_shares"] = shares;
  if (!a.mirrors.empty()) {
    json["mirror_pixels"] = std::count(image.mirror.begin(), image.mirror.end(), uint8_t{1});
  }
  AddSummaryJson(image.summary, threads, &json);
  if (const std::span<const uint8_t> by = AnsweredBy(image, a); !by.empty()) {
    const std::vector<double> of = AnsweredByShares(by);
    json["answered_by_shares"] = {
        {"shaft", of[0]}, {"triangles", of[1]}, {"packet", of[2]}, {"ray", of[3]}};
  }
  json["outputs"] = Json::array();
  for (const Output& output : outputs) {
    json["outputs"].push_back({{"kind", output.kind}, {"path", output.path}});
  }
  const std::vector<Output> arrays = {{"ids", a.ids}, {"depth", a.depth}, {"lit", a.lit}};
  for (const Output& array : arrays) {
    if (!array.path.empty())
      json["outputs"].push_back({{"kind", array.kind}, {"path", array.path}});
  }
  return json;
}

}  // namespace

absl::Status ViewCommand(std::span<const std::string> args, Context& context) {
  ViewArguments a;
  FlagSet flags(
      "sightline view SCENE [flags]",
      "Traces what a camera sees of a scene and which lights reach it; writes pictures and "
      "arrays.");
  Register(&flags, &a);
  std::vector<std::string> words;
  SL_ASSIGN_OR_RETURN(bool go, ParseOrHelp(&flags, args, {"SCENE"}, Epilogue(), context, &words));
  if (!go) return absl::OkStatus();
  SL_ASSIGN_OR_RETURN(const SceneBuild build,
                      a.build.ForQuery(flags, words[0], a.strategy.Trees()));
  SL_ASSIGN_OR_RETURN(std::vector<Output> outputs, ParseOutputs(a));
  const bool json = a.output == "json";
  if (outputs.empty() && a.ids.empty() && a.depth.empty() && a.lit.empty() && !a.stats && !json) {
    return UsageError("nothing to do: give --out FILE.png, --ids, --depth, --lit or --stats");
  }
  for (const Output& output : outputs) SL_RETURN_IF_ERROR(CheckOutputs({output.path}));
  SL_RETURN_IF_ERROR(CheckOutputs({a.ids, a.depth, a.lit}));

  SL_ASSIGN_OR_RETURN(std::unique_ptr<Session> session,
                      Session::Open(a.session, context.interruption.calls()));
  SL_ASSIGN_OR_RETURN(std::unique_ptr<OpenedScene> scene,
                      OpenScene(*session, words[0], context.err, build));
  SL_ASSIGN_OR_RETURN(client::Capabilities capabilities,
                      session->client().GetCapabilities(session->call()));
  SL_ASSIGN_OR_RETURN(ViewChoice view,
                      ChooseView(*session, *scene, words[0], a.view, a.view.aspect()));
  SL_ASSIGN_OR_RETURN(const client::Camera camera, a.view.CameraOf(view));

  client::TileQuery query;
  query.scene = scene->scene().name;
  query.options.revision = scene->scene().revision;
  a.strategy.Apply(&query.options);
  query.options.statistics = true;
  query.tile_size = static_cast<uint32_t>(a.tile);
  query.camera = camera;
  SL_ASSIGN_OR_RETURN(query.lights, LightsOf(a.lights, view, a.auto_lights));
  const auto has = [&](const char* kind) {
    return std::any_of(outputs.begin(), outputs.end(),
                       [&](const Output& o) { return o.kind == kind; });
  };
  const bool strategy = has("strategy");
  if (a.strategy_light && *a.strategy_light >= query.lights.size()) {
    return UsageError(absl::StrCat("--strategy-of names light ", *a.strategy_light, ", but there ",
                                   query.lights.size() == 1 ? "is " : "are ", query.lights.size(),
                                   ", numbered from 0"));
  }
  query.mirrors = a.mirrors;
  query.outputs.mirrors = !a.mirrors.empty();
  query.outputs.hits = true;
  query.outputs.ids = has("lit") || strategy || !a.ids.empty();
  query.outputs.depths = has("lit") || has("depth") || strategy || !a.depth.empty();
  query.outputs.answered_by = strategy && !a.strategy_light;
  query.outputs.lit_answered_by = strategy && a.strategy_light;
  // Statistics alone are asked for the whole work too.
  query.outputs.lit = query.outputs.lit_answered_by ||
                      (!query.lights.empty() && (has("lit") || !a.lit.empty() || a.stats || json));

  const uint64_t pixels = a.view.pixels();
  if (query.outputs.lit) {
    SL_RETURN_IF_ERROR(CheckAnswers(query.lights.size(), pixels, "pixels",
                                    "give a smaller --size or fewer lights"));
  }
  const uint64_t rays_per_pixel = 1 + (query.outputs.lit ? query.lights.size() : 0);
  Progress progress(context.err, context.err_is_terminal, "tracing", "rays",
                    pixels * rays_per_pixel);
  SL_ASSIGN_OR_RETURN(client::TileImage image,
                      session->client().TraceImage(query, session->stream(), [&](uint64_t done) {
                        progress.Update(done * rays_per_pixel);
                      }));
  progress.Finish();

  SL_RETURN_IF_ERROR(WriteArrays(a, image));
  const std::span<const uint8_t> answered_by = AnsweredBy(image, a);
  for (const Output& output : outputs) {
    const Image picture =
        output.kind == "depth"  ? DepthPicture(image)
        : output.kind == "cost" ? CostPicture(image)
        : output.kind == "strategy"
            ? StrategyPicture(image, query.camera, answered_by)
            : LitPicture(image, query.camera,
                         query.outputs.lit ? std::span<const client::Light>(query.lights)
                                           : std::span<const client::Light>(),
                         view.up);
    SL_RETURN_IF_ERROR(WithExitCode(WritePng(output.path, picture), kExitCannotCreate));
  }

  const auto hits =
      static_cast<uint64_t>(std::count(image.hit.begin(), image.hit.end(), uint8_t{1}));
  const std::vector<double> shares = LitShares(image, hits);
  if (json) {
    PrintJson(ViewJson(words[0], *scene, view, query.lights, image, outputs, a, hits, shares,
                       capabilities.threads),
              context.out);
    return absl::OkStatus();
  }
  if (a.stats) {
    const client::BuildReport& report = scene->scene().report;
    std::vector<std::pair<std::string, std::string>> rows = {
        {"scene", words[0]},
        {"triangles", GroupedCount(scene->scene().triangles)},
        {"build time", absl::StrFormat("%.3f s", absl::ToDoubleSeconds(report.compile_time +
                                                                       report.structure_time))},
        {"tiles", GroupedCount(image.summary.items)},
        {"rays", GroupedCount(image.summary.statistics.rays)},
        {"rays/s in the engine", HumanCount(EngineRate(image.summary, capabilities.threads))},
        {"rays/s seen by the client", HumanCount(ClientRate(image.summary))},
        {"bytes received", GroupedCount(image.summary.bytes_received)}};
    AddSunRows(a.lights, &rows);
    PrintTable(rows, context.out);
  }
  std::string line = absl::StrFormat(
      "%dx%d pixels, %s hit", a.view.width, a.view.height,
      Percent(static_cast<double>(hits) / static_cast<double>(std::max<uint64_t>(1, pixels))));
  if (!shares.empty()) {
    const auto shown = std::span(shares).first(std::min<size_t>(shares.size(), kSharesShown));
    absl::StrAppend(&line, "; lit ", absl::StrJoin(shown, ", ", [](std::string* out, double s) {
      absl::StrAppend(out, Percent(s));
    }));
    if (shown.size() < shares.size()) {
      const double mean =
          std::accumulate(shares.begin(), shares.end(), 0.0) / static_cast<double>(shares.size());
      absl::StrAppend(&line, ", ...; ", Percent(mean), " over ", shares.size(), " lights");
    }
  }
  if (!a.mirrors.empty()) {
    const auto seen = std::count(image.mirror.begin(), image.mirror.end(), uint8_t{1});
    absl::StrAppend(
        &line, "; in mirrors ",
        Percent(static_cast<double>(seen) / static_cast<double>(std::max<uint64_t>(1, pixels))));
  }
  context.out << line << '\n';
  if (strategy) context.out << "answered by " << AnsweredByText(answered_by) << '\n';
  for (const Output& output : outputs) {
    context.out << "wrote " << output.path << " (" << output.kind << ")\n";
  }
  for (const std::string& path : {a.ids, a.depth, a.lit}) {
    if (!path.empty()) context.out << "wrote " << path << '\n';
  }
  return absl::OkStatus();
}

}  // namespace sightline::cli
