// SPDX-License-Identifier: Apache-2.0
//
// A whole file in memory, or one line that says why not.
//
// Thread safety: free functions.
//
//   absl::StatusOr<std::string> bytes = ReadFileBytes("bunny.ply", options.max_file_bytes);
#ifndef SIGHTLINE_CLIENT_IMPORT_FILE_BYTES_H_
#define SIGHTLINE_CLIENT_IMPORT_FILE_BYTES_H_

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "core/base/cancel.h"

namespace sightline {

// NotFound, PermissionDenied, InvalidArgument (a folder, a device, an empty file),
// ResourceExhausted (larger than `max_bytes`), DataLoss (it cannot be read to its end), or the
// status of `cancel` once that stops. Messages do not name the file: the caller does.
absl::StatusOr<std::string> ReadFileBytes(const std::string& path, uint64_t max_bytes,
                                          const CancelToken* cancel = nullptr);

// "xz" or "gz" for a path that ends in ".xz" or ".gz" in either case, else empty.
std::string CompressionSuffix(const std::string& path);

// The lower-case extension without its dot, after a compression suffix is taken off; empty where
// there is none.
std::string MeshExtension(const std::string& path);

// The file's name without folders, compression suffix and extension.
std::string FileStem(const std::string& path);

// The folder that holds the file, "." where the path names none.
std::string FileFolder(const std::string& path);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_FILE_BYTES_H_
