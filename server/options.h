// SPDX-License-Identifier: Apache-2.0
//
// What a server is started with. One table holds every option's name, help and meaning; flags, the
// environment and a file are read through it (option_sources.h).
//
// Thread safety: plain values and functions.
//
//   absl::StatusOr<ParsedOptions> parsed = ReadOptions(argc, argv, environ);
//   absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(parsed->options);
#ifndef SIGHTLINE_SERVER_OPTIONS_H_
#define SIGHTLINE_SERVER_OPTIONS_H_

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "core/base/file_calls.h"
#include "server/auth/certificate_store.h"
#include "server/base/limits.h"
#include "server/base/log.h"
#include "server/scenes/scene_repository.h"

namespace sightline {

// What is cut off when a drain's time is over ends soon after it, but for built-in scenes that are
// being made and disks that do not answer: these are not waited for any longer.
inline constexpr absl::Duration kCutOffTimeout = absl::Seconds(8);

struct ServerOptions {
  // HOST:PORT, port 0 takes a free one, or unix:PATH. Empty: in-process channels alone.
  std::vector<std::string> listen = {"127.0.0.1:0"};
  int unix_socket_mode = 0600;  // Permissions of Unix sockets' files.
  TlsFiles tls;
  bool client_certificate_optional = false;  // With tls.client_ca.
  std::string access_file;                   // Who may do what; empty: everybody everything.
  absl::Duration reload_interval = absl::Seconds(10);  // Of certificates and the access file.
  std::string port_file;  // Gets the bound port when it is bound; empty: none.
  std::vector<std::string>
      scenes;  // [ID=]builtin:NAME[:TRIANGLES][,seed=N], made before the port is bound.
  // A folder of native scene files, where scenes are stored; empty: none.
  std::string repository;
  bool load_repository = true;  // Whether all of them are loaded before the port is bound.
  SceneFiles scene_files = SceneFiles::kMapped;  // How its files are held.
  bool evict_least_used = false;                 // Whether stored scenes make room for others.
  FileCalls* files = &FileCalls::System();  // What reaches the repository; tests put faults there.
  int threads = 0;                          // That answer queries; 0: one per hardware thread.
  // That build scenes and make point sets; 0: half as many as there are hardware threads, or one.
  int build_threads = 0;
  // HOST:PORT of probes and metrics over HTTP; empty: none.
  std::string metrics_listen;
  absl::Duration slow_query_log = absl::InfiniteDuration();  // Items that took as long are logged.
  // How long a drain leaves all but readiness and health as it is, before anything is refused.
  absl::Duration drain_delay = absl::ZeroDuration();
  absl::Duration drain_timeout = absl::Seconds(30);
  // Connections that have no call for so long are closed. Streams have no end of their own, so
  // connections have no greatest age.
  absl::Duration connection_idle_timeout = absl::Minutes(30);
  LogLevel log_level = LogLevel::kInfo;
  Limits limits;
};

// An option that something else than the default decided.
struct GivenOption {
  std::vector<std::string> values;  // As they were written.
  std::string origin;  // "--threads", "SIGHTLINE_THREADS", "sightlined.yaml:3: threads".
};

struct ParsedOptions {
  ServerOptions options;
  std::string config;         // The configuration file; empty: none.
  bool listen_given = false;  // The default is not one of several.
  bool help = false, version = false, check_config = false, print_config = false;
  std::map<std::string, GivenOption, std::less<>> given;  // By name.
  std::vector<std::string> warnings;                      // What was seen and is not used.
};

struct Option {
  std::string name;   // With dashes.
  std::string takes;  // What stands for the value in --help; empty for a switch, a flag alone.
  std::string help;
  std::string default_text;
  // InvalidArgument: "VALUE": what it must be. Called once per value.
  std::function<absl::Status(absl::string_view, ParsedOptions*)> set;
  bool repeated = false;         // May be given more than once; else the last one counts.
  std::string default_origin{};  // Where the default is from, if that differs between machines.
};

// What `sightlined` starts with: budgets are shares of the memory that it may take.
Limits DefaultLimits();

// In the order of --help.
const std::vector<Option>& OptionTable();

struct SceneOption {
  std::string id, spec;  // The spec with its "builtin:".
};
// One of ServerOptions::scenes. InvalidArgument.
absl::StatusOr<SceneOption> ParseSceneOption(absl::string_view text);

// Those of ServerOptions::scenes that the repository has by now and that are left out therefore: a
// warning each. Looks at the folder.
std::vector<std::string> StoredInstead(const ServerOptions& options);

// What can be wrong with options together, or with what they name: found before anything starts, by
// --check-config and by Server::Start. InvalidArgument.
absl::Status CheckOptions(const ServerOptions& options);

// What was given and does nothing because of what was not: a warning each.
std::vector<std::string> WithoutEffect(const ParsedOptions& parsed);

// What will go wrong later with what the options name, and does not keep the server from starting:
// a warning each.
std::vector<std::string> ForeseenTroubles(const ServerOptions& options);

// The text of --help: every flag, what it takes, its default.
std::string HelpText();

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_OPTIONS_H_
