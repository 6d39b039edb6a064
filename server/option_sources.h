// SPDX-License-Identifier: Apache-2.0
//
// Where options come from: flag > environment > file > default. For each option of the table the
// strongest source that names it decides alone; the values of an option that may be given more than
// once are not mixed from several sources.
//
// The environment's name for --max-scenes is SIGHTLINE_MAX_SCENES; values of an option that may be
// given more than once are separated by blanks, and an empty variable is as good as none. The file
// is config_file.h's, named by --config or SIGHTLINE_CONFIG.
//
// Thread safety: functions and plain values.
//
//   absl::StatusOr<ParsedOptions> parsed = ReadOptions(argc, argv, environ);
//   if (parsed->print_config) std::fputs(ConfigText(*parsed).c_str(), stdout);
#ifndef SIGHTLINE_SERVER_OPTION_SOURCES_H_
#define SIGHTLINE_SERVER_OPTION_SOURCES_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/options.h"

namespace sightline {

// Reads --name=value and --name value; '-' and '_' are the same in names, in flags and in the file.
// `environment`: NAME=VALUE lines up to a null, as in environ; null: none. InvalidArgument naming
// the source (flag, variable, or file and line), the value and what it takes, and for an unknown
// name the nearest known; what reading the file returns.
absl::StatusOr<ParsedOptions> ReadOptions(int argc, const char* const* argv,
                                          const char* const* environment);

// Every option with its value and, behind it, where the value came from; a configuration file that
// gives the same options again.
std::string ConfigText(const ParsedOptions& parsed);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_OPTION_SOURCES_H_
