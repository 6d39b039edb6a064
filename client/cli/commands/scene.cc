// SPDX-License-Identifier: Apache-2.0
//
// sightline scene load|list|show|delete: the scenes that a server holds.
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/build_flags.h"
#include "client/cli/commands/command.h"
#include "client/cli/commands/remote_command.h"
#include "client/cli/exit_code.h"
#include "client/cli/scene_argument.h"
#include "client/cli/session.h"
#include "core/base/status_macros.h"

namespace sightline::cli {
absl::Status SceneLoadCommand(std::span<const std::string> args, Context& context) {
  std::string name;
  BuildFlags build;
  RemoteCommand command(
      "sightline scene load SCENE --server HOST:PORT [--name NAME] [flags]",
      "Loads a file or a built-in scene into a server, where it stays until it is deleted; or, as "
      "scenes/NAME, a scene of the server's repository.");
  command.flags().Text(
      "name", "NAME",
      "name of the new scene: 1 to 63 of a-z, 0-9, - _ and ., starting with a letter or digit; "
      "without it the server makes one up",
      &name);
  build.Register(&command.flags());
  SL_ASSIGN_OR_RETURN(bool go, command.Begin(args, {"SCENE"}, context, SceneHelp()));
  if (!go) return absl::OkStatus();
  if (name.substr(0, 7) == "scenes/") name = name.substr(7);
  SL_RETURN_IF_ERROR(build.Check(command.flags(), command.word(0)));
  client::Scene scene;
  if (KindOf(command.word(0)) == SceneKind::kServer) {
    if (!name.empty()) {
      return UsageError(
          absl::StrCat("'", command.word(0), "' has a name of its own; leave out --name"));
    }
    SL_ASSIGN_OR_RETURN(scene, command.client().LoadScene(command.word(0), command.call()));
  } else {
    SL_ASSIGN_OR_RETURN(scene,
                        LoadScene(command.session(), command.word(0), name, build.ForServer(),
                                  /*temporary=*/false, context.err, nullptr));
  }
  command.Print(scene, context);
  return absl::OkStatus();
}

absl::Status SceneListCommand(std::span<const std::string> args, Context& context) {
  RemoteCommand command("sightline scene list --server HOST:PORT [flags]",
                        "Lists the scenes of a server.");
  SL_ASSIGN_OR_RETURN(bool go, command.Begin(args, {}, context));
  if (!go) return absl::OkStatus();
  SL_ASSIGN_OR_RETURN(std::vector<client::Scene> scenes,
                      command.client().ListScenes(command.call()));
  if (command.json()) {
    Json json = Json::array();
    for (const client::Scene& scene : scenes) json.push_back(SceneJson(scene));
    PrintJson(json, context.out);
    return absl::OkStatus();
  }
  context.out << absl::StreamFormat("%-32s %8s %10s %14s %16s\n", "scene", "revision", "objects",
                                    "triangles", "bytes");
  for (const client::Scene& scene : scenes) {
    context.out << absl::StreamFormat("%-32s %8d %10s %14s %16s\n", scene.name, scene.revision,
                                      GroupedCount(scene.objects), GroupedCount(scene.triangles),
                                      GroupedCount(scene.report.resident_bytes));
  }
  return absl::OkStatus();
}

absl::Status SceneShowCommand(std::span<const std::string> args, Context& context) {
  bool with_objects = false;
  RemoteCommand command("sightline scene show NAME --server HOST:PORT [flags]",
                        "Describes one scene of a server.");
  command.flags().Switch("objects", "list its objects too", &with_objects);
  SL_ASSIGN_OR_RETURN(bool go, command.Begin(args, {"NAME"}, context));
  if (!go) return absl::OkStatus();
  const std::string name = SceneName(command.word(0));
  SL_ASSIGN_OR_RETURN(client::Scene scene, command.client().GetScene(name, command.call()));
  std::vector<client::SceneObject> objects;
  if (with_objects) {
    SL_ASSIGN_OR_RETURN(objects, command.client().ListSceneObjects(name, command.call()));
  }
  if (command.json()) {
    Json json = SceneJson(scene);
    if (with_objects) {
      json["object_list"] = Json::array();
      for (const client::SceneObject& object : objects) {
        json["object_list"].push_back({{"index", object.index},
                                       {"name", object.name},
                                       {"triangles", object.triangles},
                                       {"vertices", object.vertices},
                                       {"mask", object.mask},
                                       {"dynamic", object.dynamic}});
      }
    }
    PrintJson(json, context.out);
    return absl::OkStatus();
  }
  PrintScene(scene, context.out);
  if (with_objects) {
    context.out << '\n'
                << absl::StreamFormat("%8s %12s %12s  %s\n", "object", "triangles", "vertices",
                                      "name");
    for (const client::SceneObject& object : objects) {
      context.out << absl::StreamFormat("%8d %12s %12s  %s\n", object.index,
                                        GroupedCount(object.triangles),
                                        GroupedCount(object.vertices), object.name);
    }
  }
  return absl::OkStatus();
}

absl::Status SceneDeleteCommand(std::span<const std::string> args, Context& context) {
  RemoteCommand command("sightline scene delete NAME --server HOST:PORT [flags]",
                        "Takes a scene away from a server.");
  SL_ASSIGN_OR_RETURN(bool go, command.Begin(args, {"NAME"}, context));
  if (!go) return absl::OkStatus();
  const std::string name = SceneName(command.word(0));
  SL_RETURN_IF_ERROR(command.client().DeleteScene(name, command.call()));
  command.PrintDone("deleted", name, context);
  return absl::OkStatus();
}

}  // namespace sightline::cli
