// SPDX-License-Identifier: Apache-2.0
//
// What a server is started with. One table (options.cc) holds every option's name, help and
// meaning; flags are read through it, and so will be an environment and a file.
//
// Thread safety: plain values and functions.
//
//   absl::StatusOr<ParsedOptions> parsed = ParseFlags(argc, argv);
//   absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(parsed->options);
#ifndef SIGHTLINE_SERVER_OPTIONS_H_
#define SIGHTLINE_SERVER_OPTIONS_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/base/limits.h"
#include "server/base/log.h"

namespace sightline {

struct ServerOptions {
  // HOST:PORT; port 0 takes a free one. Empty: no socket, in-process channels alone.
  std::string listen = "127.0.0.1:0";
  std::string port_file;            // Gets the bound port when it is bound; empty: none.
  std::vector<std::string> scenes;  // [ID=]builtin:NAME[:TRIANGLES], made before the port is bound.
  int threads = 0;                  // That answer queries; 0: one per hardware thread.
  int build_threads = 0;            // That build scenes; 0: one per hardware thread.
  absl::Duration drain_timeout = absl::Seconds(30);
  LogLevel log_level = LogLevel::kInfo;
  Limits limits;
};

struct ParsedOptions {
  ServerOptions options;
  bool help = false, version = false;
};

// Reads --name=value and --name value; '-' and '_' are the same in names. InvalidArgument naming
// the flag, its value and what it takes.
absl::StatusOr<ParsedOptions> ParseFlags(int argc, const char* const* argv);

// The text of --help: every flag, what it takes, its default.
std::string HelpText();

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_OPTIONS_H_
