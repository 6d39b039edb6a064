// SPDX-License-Identifier: Apache-2.0
//
// sightline scene unload|reload|repository: the scene files that a server keeps.
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/commands/command.h"
#include "client/cli/commands/remote_command.h"
#include "client/cli/scene_argument.h"
#include "client/cli/session.h"
#include "core/base/status_macros.h"

namespace sightline::cli {

absl::Status SceneUnloadCommand(std::span<const std::string> args, Context& context) {
  RemoteCommand command(
      "sightline scene unload NAME --server HOST:PORT [flags]",
      "Takes a stored scene out of a server's memory; its file stays in the repository.");
  SL_ASSIGN_OR_RETURN(bool go, command.Begin(args, {"NAME"}, context));
  if (!go) return absl::OkStatus();
  const std::string name = SceneName(command.word(0));
  SL_RETURN_IF_ERROR(command.client().UnloadScene(name, command.call()));
  command.PrintDone("unloaded", name, context);
  return absl::OkStatus();
}

absl::Status SceneReloadCommand(std::span<const std::string> args, Context& context) {
  RemoteCommand command(
      "sightline scene reload NAME --server HOST:PORT [flags]",
      "Loads a scene's file again, as its next revision. If that fails, the revision "
      "before goes on serving.");
  SL_ASSIGN_OR_RETURN(bool go, command.Begin(args, {"NAME"}, context));
  if (!go) return absl::OkStatus();
  SL_ASSIGN_OR_RETURN(const client::Scene scene,
                      command.client().ReloadScene(SceneName(command.word(0)), command.call()));
  command.Print(scene, context);
  return absl::OkStatus();
}

absl::Status SceneRepositoryCommand(std::span<const std::string> args, Context& context) {
  RemoteCommand command(
      "sightline scene repository --server HOST:PORT [flags]",
      "Lists the scene files of a server's repository, and whether they are loaded.");
  SL_ASSIGN_OR_RETURN(bool go, command.Begin(args, {}, context));
  if (!go) return absl::OkStatus();
  SL_ASSIGN_OR_RETURN(const std::vector<client::StoredScene> scenes,
                      command.client().ListStoredScenes(command.call()));
  if (command.json()) {
    Json json = Json::array();
    for (const client::StoredScene& scene : scenes) {
      Json row;
      row["name"] = scene.name;
      row["state"] = StateName(scene.state);
      if (!scene.state_message.empty()) row["state_message"] = scene.state_message;
      row["revision"] = scene.revision;
      row["file_bytes"] = scene.file_bytes;
      row["modify_time"] = absl::FormatTime(scene.modify_time, absl::UTCTimeZone());
      json.push_back(std::move(row));
    }
    PrintJson(json, context.out);
    return absl::OkStatus();
  }
  context.out << absl::StreamFormat("%-32s %-9s %8s %16s  %s\n", "scene", "state", "revision",
                                    "file bytes", "why");
  for (const client::StoredScene& scene : scenes) {
    context.out << absl::StreamFormat("%-32s %-9s %8d %16s  %s\n", scene.name,
                                      StateName(scene.state), scene.revision,
                                      GroupedCount(scene.file_bytes), scene.state_message);
  }
  return absl::OkStatus();
}

}  // namespace sightline::cli
