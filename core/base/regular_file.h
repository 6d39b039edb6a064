// SPDX-License-Identifier: Apache-2.0
//
// A file that somebody named, opened for reading: certainly a regular one. A folder, a device or a
// pipe is an error at once; a pipe's writer, who may never come, is not waited for.
//
// Errors are one line without the file's name, which the caller knows and says (OfFile).
//
// Thread safety: constant after construction.
//
//   SL_ASSIGN_OR_RETURN(const RegularFile file, RegularFile::Open("server.key"));
//   if ((file.facts().st_mode & S_IRWXO) != 0) ...
//   SL_ASSIGN_OR_RETURN(const std::string text, file.Read(1 << 20));
#ifndef SIGHTLINE_CORE_BASE_REGULAR_FILE_H_
#define SIGHTLINE_CORE_BASE_REGULAR_FILE_H_

#include <sys/stat.h>

#include <cstdint>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "core/base/cancel.h"

namespace sightline {

class RegularFile {
 public:
  // Links are followed. NotFound; InvalidArgument (no regular file); PermissionDenied for whatever
  // else keeps it from being opened, since nothing is said then of what is in it.
  static absl::StatusOr<RegularFile> Open(const std::string& path);
  RegularFile(RegularFile&& other) noexcept
      : descriptor_(std::exchange(other.descriptor_, -1)), facts_(other.facts_) {}
  RegularFile& operator=(RegularFile&&) = delete;
  ~RegularFile();

  // Of what was opened, not of what stands at its path by now.
  const struct stat& facts() const { return facts_; }
  uint64_t size() const { return static_cast<uint64_t>(facts_.st_size); }
  // All of it. ResourceExhausted (more than `max_bytes`), DataLoss (it cannot be read to its end,
  // or has become shorter since it was opened), or the status of `cancel` once that stops.
  absl::StatusOr<std::string> Read(uint64_t max_bytes, const CancelToken* cancel = nullptr) const;

 private:
  RegularFile(int descriptor, const struct stat& facts) : descriptor_(descriptor), facts_(facts) {}

  int descriptor_;  // -1: moved away.
  struct stat facts_;
};

// The same error with the file's name before it: "server.key: no such file".
absl::Status OfFile(const std::string& path, const absl::Status& status);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_REGULAR_FILE_H_
