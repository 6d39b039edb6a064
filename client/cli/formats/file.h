// SPDX-License-Identifier: Apache-2.0
//
// Whole files in and out. What is written appears at its path complete or not at all: the bytes go
// to a temporary file beside the target, which is then renamed. A target that exists keeps its
// permissions, though not its owner; the temporary file has them from the start. One that is no
// regular file (/dev/null, a pipe) is written to as it is. Nothing is synced: a file is there when
// its command has ended, not when the power failed right after. What must outlive that is a scene's
// file, written by core/base/file_replacement.h.
//
// Thread safety: free functions; two writers of one path race for the rename, and one of them wins.
//
//   SL_RETURN_IF_ERROR(WriteFile("lit.npy", bytes));
#ifndef SIGHTLINE_CLIENT_CLI_FORMATS_FILE_H_
#define SIGHTLINE_CLIENT_CLI_FORMATS_FILE_H_

#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/base/cancel.h"

namespace sightline::cli {

// All bytes of the file, or of a pipe until its writers have closed it. NOT_FOUND,
// PERMISSION_DENIED or INVALID_ARGUMENT (a folder) name the path. Once `cancel` (may be null)
// stops, its status; a pipe without a writer, or with one that writes nothing, is waited for no
// longer.
absl::StatusOr<std::string> ReadFile(const std::string& path, const CancelToken* cancel = nullptr);

// Puts `bytes` at `path`. The errors name the path and what the system said.
absl::Status WriteFile(const std::string& path, absl::string_view bytes);
// The same of bytes that lie in several places, in this order.
absl::Status WriteFile(const std::string& path, std::span<const absl::string_view> parts);

// Fails now rather than after minutes of work: the folder of `path` must exist and take a new file.
absl::Status CheckWritable(const std::string& path);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_FORMATS_FILE_H_
