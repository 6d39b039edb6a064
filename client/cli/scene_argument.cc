// SPDX-License-Identifier: Apache-2.0
#include "client/cli/scene_argument.h"

#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "client/cli/cancelled_work.h"
#include "client/cli/exit_code.h"
#include "client/cli/native_scene.h"
#include "client/import/import.h"
#include "client/lib/new_id.h"
#include "core/base/status_macros.h"

namespace sightline::cli {
namespace {

constexpr char kBuiltinPrefix[] = "builtin:";
constexpr char kServerPrefix[] = "scenes/";

// The library reads vertices as a flat row of doubles; a Vec3d is just that.
static_assert(sizeof(Vec3d) == 3 * sizeof(double) && std::is_standard_layout_v<Vec3d>);

client::ObjectUpload ToUpload(const ObjectInput& object) {
  client::ObjectUpload upload;
  upload.name = object.name;
  upload.vertices = std::span<const double>(reinterpret_cast<const double*>(object.vertices.data()),
                                            object.vertices.size() * 3);
  upload.indices = object.indices;
  if (!object.transform.IsIdentity()) upload.transform = object.transform.m;
  upload.mask = object.mask;
  upload.culling = object.culling == Culling::kBack    ? client::Culling::kBack
                   : object.culling == Culling::kFront ? client::Culling::kFront
                                                       : client::Culling::kNone;
  upload.dynamic = object.dynamic;
  return upload;
}

// `status` with another message, and with the details that it has.
absl::Status Reworded(const absl::Status& status, absl::string_view message) {
  absl::Status reworded(status.code(), message);
  status.ForEachPayload([&reworded](absl::string_view url, const absl::Cord& payload) {
    reworded.SetPayload(url, payload);
  });
  return reworded;
}

// Whether or not the session's calls are cancelled by now. Nothing more can be done about a failure
// here; the server's operator sees the scene in its list.
void DeleteTemporary(const Session& session, const std::string& name) {
  session.client().DeleteScene(name, {.deadline = absl::Now() + absl::Seconds(10)}).IgnoreError();
}

// Whether a scene may have been made though `status` is what came of it: it was given up here, or
// the connection was lost, and the server may have been done with it by then.
bool MayBeThere(const absl::Status& status) {
  return absl::IsCancelled(status) || absl::IsDeadlineExceeded(status) ||
         absl::IsUnavailable(status);
}

std::string ArgumentHelp(absl::string_view name, bool at_server) {
  std::string help = absl::StrCat(
      name,
      " is one of\n"
      "  FILE                       a mesh: .obj .ply .stl .off .gltf .glb, .3ds and what else "
      "assimp\n"
      "                             reads; also with .xz or .gz behind it\n"
      "  FILE.slscene               a native scene file (sightline import)",
      at_server ? ", mapped instead of built\n" : "\n",
      "  builtin:NAME[:TRIANGLES]   a scene that is generated, such as builtin:hall:1M; with\n"
      "                             ,seed=N behind it another one of its kind\n",
      at_server ? "  scenes/NAME                a scene that the server at --server holds\n" : "",
      "Built-in scenes:\n");
  for (const BuiltinInfo& info : BuiltinScenes()) {
    absl::StrAppend(&help, absl::StrFormat("  %-10s %s\n", std::string(info.name),
                                           std::string(info.description)));
  }
  return help;
}

}  // namespace

std::string SceneHelp() { return ArgumentHelp("SCENE", /*at_server=*/true); }
std::string SceneFileHelp() { return ArgumentHelp("FILE", /*at_server=*/false); }

SceneKind KindOf(const std::string& argument) {
  if (absl::StartsWith(argument, kBuiltinPrefix)) return SceneKind::kBuiltin;
  // A file of that path wins only when it is written as one ("./scenes/x").
  if (absl::StartsWith(argument, kServerPrefix)) return SceneKind::kServer;
  if (IsSceneFileName(argument)) return SceneKind::kNative;
  return SceneKind::kFile;
}

std::string SceneName(const std::string& argument) {
  return absl::StartsWith(argument, kServerPrefix) ? argument : kServerPrefix + argument;
}

void WarnOfLosses(const std::string& name, const ImportReport& report, std::ostream& err) {
  const auto warn = [&](absl::string_view what) {
    err << "warning: '" << name << "': " << what << '\n';
  };
  const auto warn_of = [&](uint64_t count, absl::string_view what) {
    if (count > 0) warn(absl::StrCat(count, " ", what, " (see sightline check)"));
  };
  for (const std::string& warning : report.warnings) warn(warning);
  warn_of(report.faces_bad_index + report.faces_too_few_corners,
          "faces with bad indices or too few corners were left out");
  warn_of(report.non_finite_triangles, "triangles with corners that are not finite are never hit");
  warn_of(report.skipped_primitives, "points and lines were skipped");
}

absl::StatusOr<client::Scene> LoadScene(const Session& session, const std::string& argument,
                                        const std::string& scene_id, const SceneBuild& build,
                                        bool temporary, std::ostream& err,
                                        ImportedScene* imported) {
  client::SceneSource source;
  source.scene_id = scene_id;
  source.build_preset = build.preset;
  source.kd_tree = build.kd_tree;
  source.binary_bvh = build.binary_bvh;
  source.without_bvh = build.without_bvh;
  source.temporary = temporary;
  ImportedScene file;
  switch (KindOf(argument)) {
    case SceneKind::kServer:
      return UsageError(absl::StrCat("'", argument,
                                     "' is a scene that a server holds already; "
                                     "give a file or builtin:NAME"));
    case SceneKind::kNative: {
      SL_ASSIGN_OR_RETURN(const SceneBytes native, OpenSceneFile(argument));
      return session.LoadNative(native, scene_id.empty() ? client::NewId("cli") : scene_id);
    }
    case SceneKind::kBuiltin: {
      const std::string name(absl::StripPrefix(argument, kBuiltinPrefix));
      absl::StatusOr<BuiltinSpec> spec = ParseBuiltin(name);
      if (!spec.ok()) return WithExitCode(spec.status(), kExitUsage);
      source.builtin = argument;
      break;
    }
    case SceneKind::kFile: {
      const CancelledWork work(session.call().cancellation);
      SL_ASSIGN_OR_RETURN(file, ImportFile(argument, {.cancel = work.token()}));
      WarnOfLosses(argument, file.report, err);
      for (const ObjectInput& object : file.objects) source.objects.push_back(ToUpload(object));
      break;
    }
  }
  // Where the server does not even say this, nothing is made there.
  SL_RETURN_IF_ERROR(session.client().GetCapabilities(session.call()).status());
  absl::StatusOr<client::Scene> scene = session.client().CreateScene(source, session.call());
  if (!scene.ok()) {
    const absl::Status& status = scene.status();
    if (temporary && MayBeThere(status)) DeleteTemporary(session, SceneName(scene_id));
    // What the server says of the arrays is said of the file.
    if (KindOf(argument) != SceneKind::kFile || absl::IsUnavailable(status)) return status;
    return Reworded(status, absl::StrCat("'", argument, "': ", status.message()));
  }
  if (imported != nullptr) *imported = std::move(file);
  return scene;
}

absl::StatusOr<std::unique_ptr<OpenedScene>> OpenScene(const Session& session,
                                                       const std::string& argument,
                                                       std::ostream& err, const SceneBuild& build) {
  if (KindOf(argument) == SceneKind::kServer) {
    if (session.embedded()) {
      return UsageError(absl::StrCat("'", argument,
                                     "' names a scene of a server; give --server, or "
                                     "'./",
                                     argument, "' for a file of that name"));
    }
    absl::StatusOr<client::Scene> scene = session.client().GetScene(argument, session.call());
    if (absl::IsNotFound(scene.status())) {
      return Reworded(scene.status(), absl::StrCat(scene.status().message(),
                                                   ": sightline scene list says which there are"));
    }
    SL_RETURN_IF_ERROR(scene.status());
    return std::make_unique<OpenedScene>(session, *std::move(scene), /*temporary=*/false);
  }
  ImportedScene imported;
  absl::StatusOr<client::Scene> scene =
      LoadScene(session, argument, client::NewId("cli"), build, /*temporary=*/true, err, &imported);
  SL_RETURN_IF_ERROR(scene.status());
  auto opened =
      std::make_unique<OpenedScene>(session, *std::move(scene), /*temporary=*/!session.embedded());
  opened->objects_ = std::move(imported.objects);
  opened->format_ = imported.report.format;
  if (KindOf(argument) == SceneKind::kBuiltin) {
    // Views are the same at every size: make the smallest to learn them.
    SL_ASSIGN_OR_RETURN(BuiltinSpec spec,
                        ParseBuiltin(std::string(absl::StripPrefix(argument, kBuiltinPrefix))));
    for (const BuiltinInfo& info : BuiltinScenes()) {
      if (info.name == spec.name) spec.target_triangles = info.min_triangles;
    }
    SL_ASSIGN_OR_RETURN(BuiltinScene smallest, MakeBuiltin(spec));
    if (!smallest.views.empty()) opened->builtin_view_ = smallest.views.front();
  }
  return opened;
}

OpenedScene::~OpenedScene() {
  if (temporary_) DeleteTemporary(session_, scene_.name);
}

}  // namespace sightline::cli
