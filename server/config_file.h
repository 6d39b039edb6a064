// SPDX-License-Identifier: Apache-2.0
//
// A configuration file: one YAML mapping from option names to values. What an option means is not
// known here (options.h), only where it stands.
//
//   # sightlined.yaml
//   listen: 127.0.0.1:7070
//   threads: 8
//   scene:                      # An option that may be given more than once takes a list.
//     - hall=builtin:hall
//     - builtin:room
//
// Invariant: a key comes once; every value is a text, as it would follow a flag.
//
// Thread safety: functions only.
//
//   SL_ASSIGN_OR_RETURN(const std::vector<ConfigEntry> entries, ReadConfigFile("sightlined.yaml"));
#ifndef SIGHTLINE_SERVER_CONFIG_FILE_H_
#define SIGHTLINE_SERVER_CONFIG_FILE_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace sightline {

struct ConfigEntry {
  std::string key;
  std::vector<std::string> values;  // One, or those of a list, in its order.
  int line = 0;                     // From 1.
};

// In the order of the file. InvalidArgument naming file and line (no YAML, no mapping, a key twice,
// a value that is neither text nor a list of texts); what RegularFile returns, ResourceExhausted
// beyond 1 MiB.
absl::StatusOr<std::vector<ConfigEntry>> ReadConfigFile(const std::string& path);
// `name` stands for the file in errors.
absl::StatusOr<std::vector<ConfigEntry>> ParseConfig(absl::string_view name,
                                                     absl::string_view text);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CONFIG_FILE_H_
