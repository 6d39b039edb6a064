// SPDX-License-Identifier: Apache-2.0
//
// sightline relight: one of a picture's lights moves, frame by frame, over the hits that the server
// keeps of the camera's rays.
#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "client/cli/build_flags.h"
#include "client/cli/camera_flags.h"
#include "client/cli/commands/command.h"
#include "client/cli/exit_code.h"
#include "client/cli/formats/npy.h"
#include "client/cli/formats/png.h"
#include "client/cli/light_flags.h"
#include "client/cli/picture/pictures.h"
#include "client/cli/progress.h"
#include "client/cli/scene_argument.h"
#include "client/cli/session.h"
#include "client/cli/view_choice.h"
#include "client/lib/relighting.h"
#include "core/base/status_macros.h"

namespace sightline::cli {
namespace {

constexpr uint64_t kMaxFrames = 100'000;

struct RelightArguments {
  CameraFlags view;
  LightFlags lights;
  uint64_t auto_lights = 3;
  std::optional<uint64_t> light;
  std::optional<Vec3d> by;
  uint64_t frames = 10, compare = 3;
  std::string out, base, color, output;
  StrategyFlags strategy;
  BuildFlags build;
  SessionFlags session;
};

void Register(FlagSet* flags, RelightArguments* a) {
  a->view.width = 960;
  a->view.height = 540;
  a->view.Register(flags);
  flags->Heading("Lights");
  a->lights.Register(flags);
  flags->Count("auto-lights", "N", "lights placed by rule where none of the above is given",
               &a->auto_lights, 1, 3);
  flags->Custom("move", "LIGHT",
                "the light that moves: its number from 0, in the order of --light, --sun, "
                "--sun-at, --sky",
                "the last", [a](const std::string& text) -> absl::Status {
                  uint64_t light = 0;
                  if (!absl::SimpleAtoi(text, &light)) {
                    return absl::InvalidArgumentError("wants the number of a light from 0");
                  }
                  a->light = light;
                  return absl::OkStatus();
                });
  flags->Point("by",
               "how far it moves from the first frame to the last, scene units; a sun's direction "
               "changes by it; required",
               &a->by);
  flags->Count("frames", "N", "pictures with the light moved, the last as far as --by says",
               &a->frames, 1, kMaxFrames);
  flags->Count("compare", "N",
               "of these, the first so many are also traced from the start: to be timed beside "
               "each other, and compared; answers that differ are an error, unless --intersector "
               "lets another test than the predicate decide",
               &a->compare, 0, kMaxFrames);
  flags->Heading("Results");
  flags->Text("out", "FILE.png", "a picture of the last frame", &a->out);
  flags->Text("color", "FILE.npy",
              "the last frame's color buffer: the weights of the lights that reach each pixel, "
              "float64 [height, width]",
              &a->color);
  flags->Text("base", "FILE.npy", "the base buffer: the same without the light that moves",
              &a->base);
  RegisterOutput(flags, &a->output);
  flags->Heading("Work");
  a->strategy.Register(flags);
  a->session.Register(flags, /*embeddable=*/true);
  a->build.RegisterForQuery(flags);
}

double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Where the light is in frame `frame` of `frames`, counted from 1.
client::Light Moved(client::Light light, Vec3d by, uint64_t frame, uint64_t frames) {
  const double share = static_cast<double>(frame) / static_cast<double>(frames);
  client::Point3& at =
      light.kind == client::Light::Kind::kDirectional ? light.direction : light.position;
  for (int axis = 0; axis < 3; ++axis) at[axis] += share * by[axis];
  return light;
}

// What each light reaches, light by light, as TileImage::lit has it.
std::vector<uint8_t> AllLit(const client::Relighting& picture) {
  std::vector<uint8_t> lit;
  for (uint32_t k = 0; k < picture.lights().size(); ++k) {
    lit.insert(lit.end(), picture.lit(k).begin(), picture.lit(k).end());
  }
  return lit;
}

struct Times {
  double first = 0;                   // Of the first picture, with all that is kept.
  std::vector<double> moved, traced;  // Of frames, relit and from the start.
  uint64_t differing = 0;             // Answers of compared frames.
};

class Frames {
 public:
  Frames(const RelightArguments& a, const Session& session, client::TileQuery query)
      : a_(a), session_(session), query_(std::move(query)) {}

  absl::Status Run(Progress* progress) {
    const absl::Time start = absl::Now();
    SL_ASSIGN_OR_RETURN(picture_, client::Relighting::Make(session_.client(),
                                                           {.scene = query_.scene,
                                                            .camera = query_.camera,
                                                            .lights = query_.lights,
                                                            .options = query_.options},
                                                           session_.stream()));
    times_.first = absl::ToDoubleSeconds(absl::Now() - start);
    const auto light = static_cast<uint32_t>(a_.light.value_or(query_.lights.size() - 1));
    SL_RETURN_IF_ERROR(picture_->Choose(light));
    const client::Light from = query_.lights[light];
    for (uint64_t frame = 1; frame <= a_.frames; ++frame) {
      query_.lights[light] = Moved(from, *a_.by, frame, a_.frames);
      const absl::Time begin = absl::Now();
      SL_RETURN_IF_ERROR(picture_->Move(query_.lights[light]));
      times_.moved.push_back(absl::ToDoubleSeconds(absl::Now() - begin));
      if (frame <= a_.compare) SL_RETURN_IF_ERROR(Compare());
      progress->Update(frame);
    }
    return absl::OkStatus();
  }

  // The last frame. Its hits are traced here, since the server alone has them.
  absl::StatusOr<Image> Picture(Vec3d up) const {
    client::TileQuery query = query_;
    query.outputs = {.hits = true, .ids = true, .depths = true};
    const std::vector<client::Light> lights = std::exchange(query.lights, {});
    SL_ASSIGN_OR_RETURN(client::TileImage image,
                        session_.client().TraceImage(query, session_.stream()));
    image.lit = AllLit(*picture_);
    image.samples = static_cast<uint32_t>(lights.size());
    return LitPicture(image, query.camera, lights, up);
  }

  const client::QueryOptions& options() const { return query_.options; }
  const client::Relighting& picture() const { return *picture_; }
  const Times& times() const { return times_; }

 private:
  absl::Status Compare() {
    const absl::Time begin = absl::Now();
    SL_ASSIGN_OR_RETURN(const client::TileImage image,
                        session_.client().TraceImage(query_, session_.stream()));
    times_.traced.push_back(absl::ToDoubleSeconds(absl::Now() - begin));
    const std::vector<uint8_t> relit = AllLit(*picture_);
    if (relit.size() != image.lit.size()) {
      return absl::InternalError(absl::StrCat("a frame traced from the start has ",
                                              image.lit.size(), " answers, relit ", relit.size()));
    }
    for (size_t i = 0; i < relit.size(); ++i) times_.differing += relit[i] != image.lit[i];
    return absl::OkStatus();
  }

  const RelightArguments& a_;
  const Session& session_;
  client::TileQuery query_;
  std::unique_ptr<client::Relighting> picture_;
  Times times_;
};

absl::Status WriteBuffer(const std::string& path, const RelightArguments& a,
                         const std::vector<double>& buffer) {
  if (path.empty()) return absl::OkStatus();
  const size_t shape[] = {a.view.height, a.view.width};
  return WithExitCode(WriteNpy<double>(path, shape, buffer), kExitCannotCreate);
}

void Print(const std::string& scene, const RelightArguments& a, const Frames& frames,
           Context& context) {
  const Times& times = frames.times();
  const double moved = Median(times.moved), traced = Median(times.traced);
  if (a.output == "json") {
    Json json;
    json["command"] = "relight";
    json["scene"] = scene;
    json["pixels"] = a.view.pixels();
    json["lights"] = frames.picture().lights().size();
    json["moving_light"] = frames.picture().chosen();
    json["frames"] = times.moved.size();
    json["first_picture_s"] = times.first;
    json["moved_s"] = moved;
    json["compared_frames"] = times.traced.size();
    json["traced_s"] = times.traced.empty() ? Json(nullptr) : Json(traced);
    json["gain"] = times.traced.empty() ? Json(nullptr) : Json(traced / moved);
    json["differing_answers"] = times.differing;
    PrintJson(json, context.out);
    return;
  }
  std::vector<std::pair<std::string, std::string>> rows = {
      {"lights", absl::StrFormat("%d, of which %d moves", frames.picture().lights().size(),
                                 frames.picture().chosen())},
      {"first picture", absl::StrFormat("%.2f ms", 1e3 * times.first)},
      {"light moved",
       absl::StrFormat("%.2f ms, median of %d frames", 1e3 * moved, times.moved.size())}};
  if (!times.traced.empty()) {
    rows.emplace_back("traced from the start",
                      absl::StrFormat("%.2f ms, median of %d: %.2f times as long", 1e3 * traced,
                                      times.traced.size(), traced / moved));
    rows.emplace_back("answers that differ", GroupedCount(times.differing));
  }
  PrintTable(rows, context.out);
  for (const std::string& path : {a.out, a.color, a.base}) {
    if (!path.empty()) context.out << "wrote " << path << '\n';
  }
}

}  // namespace

absl::Status RelightCommand(std::span<const std::string> args, Context& context) {
  RelightArguments a;
  FlagSet flags("sightline relight SCENE --by X,Y,Z [flags]",
                "Moves one of a picture's lights: the server keeps what the camera sees, and each "
                "frame asks about the shadows of that light alone.");
  Register(&flags, &a);
  std::vector<std::string> words;
  SL_ASSIGN_OR_RETURN(bool go, ParseOrHelp(&flags, args, {"SCENE"}, SceneHelp(), context, &words));
  if (!go) return absl::OkStatus();
  SL_ASSIGN_OR_RETURN(const SceneBuild build,
                      a.build.ForQuery(flags, words[0], a.strategy.Trees()));
  if (!a.by) return UsageError("wants --by X,Y,Z: how far the light moves");
  if (!a.out.empty() && !absl::EndsWith(a.out, ".png")) {
    return UsageError(absl::StrCat("--out wants a name that ends in .png; got '", a.out, "'"));
  }
  SL_RETURN_IF_ERROR(CheckOutputs({a.out, a.base, a.color}));
  SL_ASSIGN_OR_RETURN(std::unique_ptr<Session> session,
                      Session::Open(a.session, context.interruption.calls()));
  SL_ASSIGN_OR_RETURN(std::unique_ptr<OpenedScene> scene,
                      OpenScene(*session, words[0], context.err, build));
  SL_ASSIGN_OR_RETURN(const ViewChoice view,
                      ChooseView(*session, *scene, words[0], a.view, a.view.aspect()));
  client::TileQuery query;
  query.scene = scene->scene().name;
  query.options.revision = scene->scene().revision;
  a.strategy.Apply(&query.options);
  query.outputs = {.hits = true, .lit = true};
  SL_ASSIGN_OR_RETURN(query.camera, a.view.CameraOf(view));
  SL_ASSIGN_OR_RETURN(query.lights, LightsOf(a.lights, view, a.auto_lights));
  if (query.lights.empty()) return UsageError("wants a light that moves: give --light X,Y,Z");
  if (a.light.value_or(0) >= query.lights.size()) {
    return UsageError(absl::StrCat("--move names light ", *a.light, ", but there are ",
                                   query.lights.size(), ", numbered from 0"));
  }
  SL_RETURN_IF_ERROR(CheckAnswers(query.lights.size(), a.view.pixels(), "pixels",
                                  "give a smaller --size or fewer lights"));
  Frames frames(a, *session, std::move(query));
  {
    Progress progress(context.err, context.err_is_terminal, "relighting", "frames", a.frames);
    SL_RETURN_IF_ERROR(frames.Run(&progress));
    progress.Finish();
  }
  if (!a.out.empty()) {
    SL_ASSIGN_OR_RETURN(const Image picture, frames.Picture(view.up));
    SL_RETURN_IF_ERROR(WithExitCode(WritePng(a.out, picture), kExitCannotCreate));
  }
  SL_RETURN_IF_ERROR(WriteBuffer(a.color, a, frames.picture().color()));
  SL_RETURN_IF_ERROR(WriteBuffer(a.base, a, frames.picture().base()));
  Print(words[0], a, frames, context);
  // A published test's answers may depend on which rays walk together: told above, and no error.
  const bool exact = frames.options().intersector == client::Intersector::kExact;
  if (frames.times().differing == 0 || !exact) return absl::OkStatus();
  return absl::InternalError(
      absl::StrCat(frames.times().differing, " answers of relit frames differ from traced ones"));
}

}  // namespace sightline::cli
