// SPDX-License-Identifier: Apache-2.0
//
// What every command of `sightline` is: a function of its words that writes to two streams. One
// file per command; run.cc knows them all.
//
// Thread safety: commands may run side by side, each with streams of its own.
#ifndef SIGHTLINE_CLIENT_CLI_COMMANDS_COMMAND_H_
#define SIGHTLINE_CLIENT_CLI_COMMANDS_COMMAND_H_

#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/cli/build_flags.h"
#include "client/cli/flags.h"
#include "client/cli/interruption.h"
#include "client/cli/light_flags.h"
#include "client/cli/progress.h"
#include "client/import/import_types.h"
#include "client/lib/types.h"

namespace sightline::cli {

using Json = nlohmann::ordered_json;

struct Context {
  std::ostream& out;
  std::ostream& err;
  bool err_is_terminal = false;
  Interruption& interruption;  // Ends every call to a server, and work of any length.
};

// The words after the command's name. The status becomes one line on `err` and the exit code.
using Command = absl::Status (*)(std::span<const std::string> args, Context& context);

absl::Status ViewCommand(std::span<const std::string> args, Context& context);
absl::Status RelightCommand(std::span<const std::string> args, Context& context);
absl::Status ShadeCommand(std::span<const std::string> args, Context& context);
absl::Status SegmentsCommand(std::span<const std::string> args, Context& context);
absl::Status SceneLoadCommand(std::span<const std::string> args, Context& context);
absl::Status SceneListCommand(std::span<const std::string> args, Context& context);
absl::Status SceneShowCommand(std::span<const std::string> args, Context& context);
absl::Status SceneDeleteCommand(std::span<const std::string> args, Context& context);
absl::Status SceneUnloadCommand(std::span<const std::string> args, Context& context);
absl::Status SceneReloadCommand(std::span<const std::string> args, Context& context);
absl::Status SceneRepositoryCommand(std::span<const std::string> args, Context& context);
absl::Status ImportCommand(std::span<const std::string> args, Context& context);
absl::Status HealthCommand(std::span<const std::string> args, Context& context);
absl::Status CheckCommand(std::span<const std::string> args, Context& context);

// ---- What commands share

// --output text|json, text unless said otherwise.
void RegisterOutput(FlagSet* flags, std::string* output);
// As --output json prints it. A file's name may be any bytes: what is no UTF-8 becomes U+FFFD.
void PrintJson(const Json& json, std::ostream& out);
// How the engine goes about a query, which is speed alone, but for the mask and the intersector.
struct StrategyFlags {
  uint32_t mask = 0xFFFFFFFFu;
  std::string strategy, structure;
  uint64_t rtt_antialiasing = 1;
  bool rtt_shared_edges = false;
  uint64_t rtt_side_by_side = 0;
  std::optional<client::LeafCulling> leaf_culling;
  std::string intersector;
  uint64_t packet_side = 16;
  bool pixel_shadow_packets = false;

  // --mask, --strategy, --structure and what they go by; all objects and AUTO unless said
  // otherwise.
  void Register(FlagSet* flags);
  void Apply(client::QueryOptions* options) const;
  // What a scene that is made for one query must have, too.
  BuildFlags::Trees Trees() const;
};

// Parses; on --help prints it with `epilogue` and returns false. Wants as many words as `words`
// names.
absl::StatusOr<bool> ParseOrHelp(FlagSet* flags, std::span<const std::string> args,
                                 const std::vector<std::string>& word_names,
                                 const std::string& epilogue, Context& context,
                                 std::vector<std::string>* words);

// What `check` says of a native scene file: header, sections, sums, and what it holds.
absl::Status CheckSceneFile(const std::string& path, bool with_objects, const std::string& output,
                            Context& context);

// CheckWritable for each file that is named, before work starts.
absl::Status CheckOutputs(std::initializer_list<std::string> paths);

// A usage error where the answers for `lights` lights at `places` `what` ("pixels"), a byte each,
// are more than a command keeps, 2^32; it names the `remedy`: "give fewer lights".
absl::Status CheckAnswers(uint64_t lights, uint64_t places, absl::string_view what,
                          absl::string_view remedy);

// What --sun-at found: an array of objects; rows for PrintTable.
Json SunsJson(const LightFlags& lights);
void AddSunRows(const LightFlags& lights, std::vector<std::pair<std::string, std::string>>* rows);

// What became of a file on the way in, every count of it.
Json ImportJson(const ImportReport& report);

// "ready", "unloaded" and so on.
const char* StateName(client::SceneState state);
Json SceneJson(const client::Scene& scene);
void PrintScene(const client::Scene& scene, std::ostream& out);
// Rays, rates and bytes of a query, as keys of `json`. `threads`: those of the server's engine.
void AddSummaryJson(const client::StreamSummary& summary, uint32_t threads, Json* json);
// Rays per second of the engine: rays over the time that its threads computed, shared among them.
double EngineRate(const client::StreamSummary& summary, uint32_t threads);
// Rays per second as the client saw them, from the first message to the last.
double ClientRate(const client::StreamSummary& summary);
// Rows of "name   value", the names in one column.
void PrintTable(const std::vector<std::pair<std::string, std::string>>& rows, std::ostream& out);
std::string Percent(double share);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_COMMANDS_COMMAND_H_
