// SPDX-License-Identifier: Apache-2.0
#include "client/cli/run.h"

#include <span>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "client/cli/commands/command.h"
#include "client/cli/exit_code.h"
#include "client/cli/finish.h"
#include "core/base/edit_distance.h"

namespace sightline::cli {
namespace {

constexpr char kVersion[] = SIGHTLINE_VERSION;

struct Entry {
  const char* name;  // One or two words.
  const char* summary;
  Command run;
};

constexpr Entry kCommands[] = {
    {"view", "what a camera sees and which lights reach it, as pictures and arrays", ViewCommand},
    {"relight", "one of a picture's lights moves, over hits that are kept", RelightCommand},
    {"shade", "which lights reach which points", ShadeCommand},
    {"segments", "which segments are blocked", SegmentsCommand},
    {"import", "read a mesh file and write a native scene file, ready to be mapped", ImportCommand},
    {"check", "what a mesh or native scene file holds and what is wrong with it", CheckCommand},
    {"scene load", "load a scene into a server", SceneLoadCommand},
    {"scene unload", "take a scene out of a server's memory; its file stays", SceneUnloadCommand},
    {"scene reload", "load a scene's file again, as a new revision", SceneReloadCommand},
    {"scene repository", "list the scene files of a server", SceneRepositoryCommand},
    {"scene list", "list the scenes of a server", SceneListCommand},
    {"scene show", "describe a scene of a server", SceneShowCommand},
    {"scene delete", "take a scene away from a server", SceneDeleteCommand},
    {"health", "is the server there, and what can it do", HealthCommand},
};

std::string GeneralHelp() {
  std::string help =
      "sightline tells, exactly and for many points at once, whether anything stands between A and "
      "B.\n"
      "\nUsage: sightline COMMAND [words] [flags]\n\nCommands:\n";
  for (const Entry& entry : kCommands) {
    absl::StrAppend(&help, absl::StrFormat("  %-17s %s\n", entry.name, entry.summary));
  }
  absl::StrAppend(
      &help,
      "  help              this text; sightline help COMMAND or COMMAND --help lists its flags\n"
      "\nExamples:\n"
      "  sightline view builtin:hall --out hall.png\n"
      "  sightline view city.obj.xz --out lit:lit.png --out depth:depth.png --stats\n"
      "  sightline relight builtin:hall --by 2,0,0 --out moved.png\n"
      "  sightline shade city.obj.xz --points P.npy --sun 0.3,-0.5,0.8 --out lit.npy\n"
      "  sightline segments city.obj.xz --segments S.npy --out hit.npy\n"
      "  sightline import city.obj.xz -o city.slscene\n"
      "\n",
      ExitCodeHelp());
  return help;
}

std::vector<std::string> CommandNames() {
  std::vector<std::string> names = {"help"};
  for (const Entry& entry : kCommands) names.emplace_back(entry.name);
  return names;
}

// The command that `args` begins with, and how many words name it; null if there is none.
const Entry* FindCommand(std::span<const std::string> args, size_t* words) {
  for (const Entry& entry : kCommands) {
    const absl::string_view name = entry.name;
    const size_t blank = name.find(' ');
    *words = blank == absl::string_view::npos ? 1 : 2;
    if (args.size() < *words || args[0] != name.substr(0, blank)) continue;
    if (*words == 1 || args[1] == name.substr(blank + 1)) return &entry;
  }
  return nullptr;
}

absl::Status UnknownCommand(std::span<const std::string> args) {
  std::string text = args[0];
  if (args[0] == "scene") {
    if (args.size() < 2)
      return UsageError("scene wants load, unload, reload, repository, list, show or delete");
    absl::StrAppend(&text, " ", args[1]);
  }
  const std::string nearest = NearestWord(text, CommandNames());
  return UsageError(absl::StrCat("unknown command '", absl::CHexEscape(text), "'",
                                 nearest.empty() ? "; see sightline help" : "; did you mean ",
                                 nearest));
}

absl::Status Dispatch(std::span<const std::string> args, Context& context, std::string* command) {
  if (args.empty()) return UsageError("wants a command; see sightline help");
  if (args[0] == "--version") {
    context.out << "sightline " << kVersion << '\n';
    return absl::OkStatus();
  }
  const bool help = args[0] == "help" || args[0] == "--help" || args[0] == "-h";
  if (help && args.size() == 1) {
    context.out << GeneralHelp();
    return absl::OkStatus();
  }
  if (help) args = args.subspan(1);
  // `sightline scene --help`: the general help lists what scene can do.
  if (args[0] == "scene" && (args.size() == 1 ? help : args[1] == "--help" || args[1] == "-h")) {
    context.out << GeneralHelp();
    return absl::OkStatus();
  }
  size_t words = 0;
  const Entry* entry = FindCommand(args, &words);
  if (entry == nullptr) return UnknownCommand(args);
  *command = entry->name;
  if (help) {
    const std::string flag = "--help";
    return entry->run(std::span(&flag, 1), context);
  }
  return entry->run(args.subspan(words), context);
}

}  // namespace

int RunCli(const std::vector<std::string>& args, std::ostream& out, std::ostream& err,
           bool err_is_terminal, Interruption* interruption) {
  Interruption never;
  Context context{out, err, err_is_terminal, interruption == nullptr ? never : *interruption};
  std::string command;
  absl::Status status = WithoutExceptions([&] { return Dispatch(args, context, &command); });
  // Whichever step it was that could not go on; an error of another kind is told as it is.
  if (context.interruption.interrupted() && MayComeOfInterruption(status)) {
    status = absl::CancelledError("interrupted before it was done");
  }
  return Finish(std::move(status),
                command.empty() ? "sightline" : absl::StrCat("sightline ", command), out, err);
}

}  // namespace sightline::cli
