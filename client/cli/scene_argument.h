// SPDX-License-Identifier: Apache-2.0
//
// The SCENE of a command line: a mesh file, a native scene file, `builtin:NAME`, or
// `scenes/NAME` that a server already holds. Files and built-in scenes become a scene of the
// session's server for the time of the command; on a server at --server that scene is deleted again
// afterwards.
//
// Thread safety: one thread per object.
//
//   SL_ASSIGN_OR_RETURN(auto scene, OpenScene(*session, "bunny.ply.xz", err));
//   scene->scene().triangles
#ifndef SIGHTLINE_CLIENT_CLI_SCENE_ARGUMENT_H_
#define SIGHTLINE_CLIENT_CLI_SCENE_ARGUMENT_H_

#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/session.h"
#include "client/import/import_types.h"
#include "core/mesh/builtin/builtin.h"
#include "core/mesh/object.h"

namespace sightline::cli {

// The paragraph on SCENE for --help, and that on FILE, of commands that ask no server.
std::string SceneHelp();
std::string SceneFileHelp();

enum class SceneKind { kFile, kNative, kBuiltin, kServer };
SceneKind KindOf(const std::string& argument);

// What is built of a scene that is made.
struct SceneBuild {
  client::BuildPreset preset = client::BuildPreset::kStatic;
  std::optional<client::KdTreeOptions> kd_tree = std::nullopt;
  std::optional<client::BinaryBvhOptions> binary_bvh = std::nullopt;
  bool without_bvh = false;
};

class OpenedScene {
 public:
  OpenedScene(const Session& session, client::Scene scene, bool temporary)
      : session_(session), scene_(std::move(scene)), temporary_(temporary) {}
  ~OpenedScene();
  OpenedScene(const OpenedScene&) = delete;
  OpenedScene& operator=(const OpenedScene&) = delete;

  const client::Scene& scene() const { return scene_; }
  // A file's own arrays, to look at; empty for others.
  const std::vector<ObjectInput>& objects() const { return objects_; }
  // A built-in scene's first view.
  const std::optional<BuiltinView>& builtin_view() const { return builtin_view_; }
  // "stl binary" and the like; empty for others.
  const std::string& format() const { return format_; }

 private:
  friend absl::StatusOr<std::unique_ptr<OpenedScene>> OpenScene(const Session&, const std::string&,
                                                                std::ostream&, const SceneBuild&);
  const Session& session_;
  const client::Scene scene_;
  const bool temporary_;
  std::vector<ObjectInput> objects_;
  std::optional<BuiltinView> builtin_view_;
  std::string format_;
};

// Says on `err` what was lost of the file `name` on the way, one line each: its reader's warnings,
// faces that were left out, triangles that are not finite, points and lines.
void WarnOfLosses(const std::string& name, const ImportReport& report, std::ostream& err);

// What a file lost on the way is said on `err`, by WarnOfLosses. `build` is for scenes that the
// server does not hold yet.
absl::StatusOr<std::unique_ptr<OpenedScene>> OpenScene(const Session& session,
                                                       const std::string& argument,
                                                       std::ostream& err,
                                                       const SceneBuild& build = {});

// Makes a scene on the session's server of a file or a built-in scene, with a name of its own or
// one that the server makes up (empty), built as `build` says; a `temporary` one, which has a name
// of its own, is not stored, and is deleted if it may be there in spite of an error. `imported`
// (may be null) receives a mesh file's arrays and report.
absl::StatusOr<client::Scene> LoadScene(const Session& session, const std::string& argument,
                                        const std::string& scene_id, const SceneBuild& build,
                                        bool temporary, std::ostream& err, ImportedScene* imported);

// "city" and "scenes/city" both name scenes/city.
std::string SceneName(const std::string& argument);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_SCENE_ARGUMENT_H_
