// SPDX-License-Identifier: Apache-2.0
//
// What the commands about a running server share: --output, the flags of a connection, --help, and
// the session itself.
//
// Thread safety: belongs to one command.
//
//   RemoteCommand command("sightline scene show NAME --server HOST:PORT [flags]", "Describes ...");
//   command.flags().Switch("objects", "list its objects too", &with_objects);
//   SL_ASSIGN_OR_RETURN(bool go, command.Begin(args, {"NAME"}, context));
//   if (!go) return absl::OkStatus();
//   ... command.client().GetScene(SceneName(command.word(0)), command.call()) ...
#ifndef SIGHTLINE_CLIENT_CLI_COMMANDS_REMOTE_COMMAND_H_
#define SIGHTLINE_CLIENT_CLI_COMMANDS_REMOTE_COMMAND_H_

#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/commands/command.h"
#include "client/cli/session.h"
#include "core/base/status_macros.h"

namespace sightline::cli {

class RemoteCommand {
 public:
  RemoteCommand(std::string usage, std::string about) : flags_(std::move(usage), std::move(about)) {
    RegisterOutput(&flags_, &output_);
    session_flags_.Register(&flags_, /*embeddable=*/false);
  }
  RemoteCommand(const RemoteCommand&) = delete;
  RemoteCommand& operator=(const RemoteCommand&) = delete;

  FlagSet& flags() { return flags_; }

  // Parses, wants as many words as `word_names` names, and connects. False: --help was printed.
  absl::StatusOr<bool> Begin(std::span<const std::string> args,
                             const std::vector<std::string>& word_names, Context& context,
                             const std::string& epilogue = "") {
    SL_ASSIGN_OR_RETURN(const bool go,
                        ParseOrHelp(&flags_, args, word_names, epilogue, context, &words_));
    if (!go) return false;
    SL_ASSIGN_OR_RETURN(session_, OpenRemote(session_flags_, context.interruption.calls()));
    return true;
  }

  // REQUIRES, for all below: Begin returned true.
  bool json() const { return output_ == "json"; }
  const std::string& word(size_t i) const { return words_[i]; }
  Session& session() { return *session_; }
  const client::Client& client() { return session_->client(); }
  client::CallOptions call() { return session_->call(); }

  // Says what was done to a scene: "deleted scenes/hall".
  void PrintDone(const char* done, const std::string& name, Context& context) const {
    if (json()) {
      PrintJson(Json{{done, name}}, context.out);
    } else {
      context.out << done << ' ' << name << '\n';
    }
  }
  void Print(const client::Scene& scene, Context& context) const {
    if (json()) {
      PrintJson(SceneJson(scene), context.out);
    } else {
      PrintScene(scene, context.out);
    }
  }

 private:
  FlagSet flags_;
  std::string output_;
  SessionFlags session_flags_;
  std::vector<std::string> words_;
  std::unique_ptr<Session> session_;
};

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_COMMANDS_REMOTE_COMMAND_H_
