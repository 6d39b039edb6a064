// SPDX-License-Identifier: Apache-2.0
//
// Reads a file that holds a secret, and refuses one that others could have read or changed.
//
// Thread safety: functions only.
//
//   SL_ASSIGN_OR_RETURN(const std::string key, ReadSecretFile("server.key"));
#ifndef SIGHTLINE_SERVER_AUTH_SECRET_FILE_H_
#define SIGHTLINE_SERVER_AUTH_SECRET_FILE_H_

#include <string>

#include "absl/status/statusor.h"

namespace sightline {

// At most 1 MiB. What RegularFile returns, with the file's name; PermissionDenied where others may
// read or write it, the group may write it, or it belongs to neither this user nor root. (The group
// may read it, which is how containers are given secrets.)
absl::StatusOr<std::string> ReadSecretFile(const std::string& path);

// The same without the checks of its mode: certificates are public.
absl::StatusOr<std::string> ReadPublicFile(const std::string& path);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_AUTH_SECRET_FILE_H_
