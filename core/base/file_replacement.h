// SPDX-License-Identifier: Apache-2.0
//
// Writes a file whole or not at all: beside its target, under a temporary name, then synced, then
// renamed over it, then the folder synced. Whatever fails or is killed, the target is the old file
// whole or the new one whole. It is the old one until Commit renames; if what follows fails,
// closing the new file or syncing the folder, the error comes with the new file in place. Once
// Commit has returned OK, that file survives a loss of power.
//
// A temporary name is the target's behind a dot with ".<pid>-<number>.tmp" after it: a process that
// is killed leaves one, which IsTemporaryName tells (Folder::RemoveTemporaries). It is locked
// (flock) until it is renamed. Names that the dead have left, in a container under the very pid of
// the living, are passed over.
//
// The new file has the old one's permission bits; where there was none, 0644 less the umask.
//
// Thread safety: one thread at a time per object. The folder's descriptor outlives it.
//
//   SL_ASSIGN_OR_RETURN(FileReplacement file, folder.Replace("hall.slscene"));
//   SL_RETURN_IF_ERROR(file.Append(bytes));
//   SL_RETURN_IF_ERROR(file.Commit());
#ifndef SIGHTLINE_CORE_BASE_FILE_REPLACEMENT_H_
#define SIGHTLINE_CORE_BASE_FILE_REPLACEMENT_H_

#include <cstddef>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/base/file_calls.h"

namespace sightline {

class FileReplacement {
 public:
  // FileError's errors; Unavailable where somebody takes every new file away, or too many that the
  // dead have left are in the way.
  static absl::StatusOr<FileReplacement> Create(FileCalls& calls, int folder,
                                                const std::string& name, const std::string& shown);
  FileReplacement(FileReplacement&& other) noexcept;
  FileReplacement& operator=(FileReplacement&&) = delete;
  // Takes the temporary file away unless it was committed.
  ~FileReplacement();

  // FileError's errors; after one only destruction is of use.
  absl::Status Append(std::span<const std::byte> bytes);
  absl::Status Commit();

 private:
  FileReplacement(FileCalls& calls, int folder, int file, std::string name, std::string temporary,
                  std::string shown);

  FileCalls& calls_;
  const int folder_;
  int file_;  // -1 once closed.
  const std::string name_, temporary_, shown_;
  bool renamed_ = false;
};

// Whether a file of this name was begun by a FileReplacement and never committed.
bool IsTemporaryName(absl::string_view name);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_FILE_REPLACEMENT_H_
