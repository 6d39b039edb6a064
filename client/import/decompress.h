// SPDX-License-Identifier: Apache-2.0
//
// xz (liblzma) and gzip (zlib) in memory, within a limit on what comes out. Several streams or
// members in one file are read one after another, as the xz and gzip tools do.
//
// Thread safety: free functions.
//
//   absl::StatusOr<std::string> text = DecompressXz(bytes, options.max_file_bytes);
#ifndef SIGHTLINE_CLIENT_IMPORT_DECOMPRESS_H_
#define SIGHTLINE_CLIENT_IMPORT_DECOMPRESS_H_

#include <cstdint>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "core/base/cancel.h"

namespace sightline {

// Memory that the xz decoder may take for its dictionary: `xz -9` needs 65 MiB, and only hand-made
// files need more than this.
inline constexpr uint64_t kXzDecoderBytes = uint64_t{512} << 20;

// DataLoss (truncated, corrupt, or no such stream), ResourceExhausted (over `max_bytes`, or over
// kXzDecoderBytes), or the status of `cancel` once that stops. The result may be empty.
absl::StatusOr<std::string> DecompressXz(std::string_view bytes, uint64_t max_bytes,
                                         const CancelToken* cancel = nullptr);
absl::StatusOr<std::string> DecompressGzip(std::string_view bytes, uint64_t max_bytes,
                                           const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_DECOMPRESS_H_
