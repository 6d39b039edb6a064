// SPDX-License-Identifier: Apache-2.0
#include "client/load/check_source.h"

#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "client/cli/exit_code.h"
#include "client/cli/native_scene.h"
#include "client/cli/scene_argument.h"
#include "client/import/import.h"
#include "core/base/status_macros.h"
#include "core/geometry/vec3.h"
#include "core/mesh/builtin/builtin.h"
#include "core/scene/scene_file.h"

namespace sightline::load {
namespace {

// The objects of a mesh file or of builtin:NAME, as a server would be given them.
absl::StatusOr<std::vector<ObjectInput>> ReadObjects(const std::string& argument,
                                                     const CancelToken* cancel) {
  if (cli::KindOf(argument) == cli::SceneKind::kBuiltin) {
    SL_ASSIGN_OR_RETURN(const BuiltinSpec spec,
                        ParseBuiltin(std::string(absl::StripPrefix(argument, "builtin:"))));
    SL_ASSIGN_OR_RETURN(BuiltinScene scene, MakeBuiltin(spec, cancel));
    return std::move(scene.objects);
  }
  SL_ASSIGN_OR_RETURN(ImportedScene scene, ImportFile(argument, {.cancel = cancel}));
  return std::move(scene.objects);
}

absl::StatusOr<std::shared_ptr<const Scene>> Open(const std::string& argument, Vec3d origin,
                                                  ThreadPool& pool, const CancelToken* cancel) {
  if (cli::KindOf(argument) == cli::SceneKind::kNative) {
    SL_ASSIGN_OR_RETURN(const SceneBytes file, cli::OpenSceneFile(argument));
    return LoadScene(file, argument, {}, pool, cancel);
  }
  SL_ASSIGN_OR_RETURN(const std::vector<ObjectInput> objects, ReadObjects(argument, cancel));
  return BuildScene(argument, /*revision=*/1, objects, origin, {}, pool, cancel);
}

std::string Sizes(uint64_t objects, uint64_t triangles, uint64_t vertices) {
  return absl::StrCat(triangles, " triangles of ", vertices, " vertices in ", objects, " objects");
}

std::string Words(Vec3d v) { return absl::StrCat("(", v.x, ", ", v.y, ", ", v.z, ")"); }

}  // namespace

absl::StatusOr<CheckSource> ChooseCheck(const LoadOptions& options, const client::Scene& scene) {
  using By = CheckSource::By;
  if (options.check == Check::kNone) return CheckSource{};
  if (!options.check_scene.empty()) return CheckSource{By::kEngine, options.check_scene};
  if (cli::KindOf(options.scene) != cli::SceneKind::kServer) {
    return CheckSource{By::kEngine, options.scene};
  }
  if (!scene.builtin.empty()) return CheckSource{By::kEngine, scene.builtin};
  if (options.reload_every > 0 && options.reload_by == ReloadBy::kEdit) {
    return cli::UsageError(absl::StrCat(
        "answers cannot be checked while '", options.scene,
        "' is edited: the server does not say what it is made of. Give --check-scene, or --check ",
        "none"));
  }
  return CheckSource{By::kServer, ""};
}

absl::StatusOr<std::shared_ptr<const Scene>> OpenCheckScene(const std::string& argument,
                                                            const client::Scene& served,
                                                            ThreadPool& pool,
                                                            const CancelToken* cancel) {
  const Vec3d origin{served.origin[0], served.origin[1], served.origin[2]};
  SL_ASSIGN_OR_RETURN(std::shared_ptr<const Scene> scene, Open(argument, origin, pool, cancel));
  const SceneGeometry& geometry = scene->geometry;
  const std::string here =
      Sizes(geometry.objects.size(), geometry.triangles.size(), geometry.vertices.size());
  const std::string there = Sizes(served.objects, served.triangles, served.vertices);
  if (here != there) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", argument, "' is not what ", served.name, " is made of: it has ", here,
                     ", the server's scene ", there, ". Give another --check-scene"));
  }
  if (!(geometry.origin == origin)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "'", argument, "' is not what ", served.name, " is made of: it is relative to ",
        Words(geometry.origin), ", the server's scene to ", Words(origin),
        ", so that other floats are stored. Give another --check-scene"));
  }
  return scene;
}

}  // namespace sightline::load
