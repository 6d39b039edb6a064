// SPDX-License-Identifier: Apache-2.0
//
// The file by which a script learns the port of a server that took a free one. It appears whole or
// not at all. It is not synced: a port means nothing after the machine was off.
//
// Thread safety: functions only.
//
//   SL_RETURN_IF_ERROR(WritePortFile("run/port", server.port()));
#ifndef SIGHTLINE_SERVER_PORT_FILE_H_
#define SIGHTLINE_SERVER_PORT_FILE_H_

#include <string>

#include "absl/status/status.h"

namespace sightline {

// Writes beside `path`, then renames. Unavailable naming the file and the reason.
absl::Status WritePortFile(const std::string& path, int port);
// Takes it away again; one that is gone already is fine.
void RemovePortFile(const std::string& path);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_PORT_FILE_H_
