// SPDX-License-Identifier: Apache-2.0
//
// A whole file in the address space, read-only: its pages come from the system's cache when they
// are touched, and are shared between processes.
//
// The bytes are those of the file: whoever may write it in place can change them later, and a file
// that is cut short while it is mapped ends the process that reads beyond (SIGBUS). So files that
// are mapped belong in folders that nobody else writes, and are replaced by renaming another over
// them (file_replacement.h), which leaves what is mapped as it is. A page that the disk fails to
// deliver ends the process likewise; who cannot live with that reads files (file_image.h).
//
// Thread safety: constant after construction.
//
//   SL_ASSIGN_OR_RETURN(Folder folder, Folder::Open("/var/lib/sightline"));
//   SL_ASSIGN_OR_RETURN(std::shared_ptr<const MappedFile> file, folder.Map("hall.slscene"));
//   Parse(file->bytes());
#ifndef SIGHTLINE_CORE_BASE_MAPPED_FILE_H_
#define SIGHTLINE_CORE_BASE_MAPPED_FILE_H_

#include <cstddef>
#include <memory>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "core/base/file_calls.h"

namespace sightline {

class MappedFile {
 public:
  // `name` in the folder of that descriptor; `shown` is what errors call it. A link is not
  // followed. Errors: FileError's; FailedPrecondition for what is not a regular file.
  static absl::StatusOr<std::shared_ptr<const MappedFile>> Open(FileCalls& calls, int folder,
                                                                const std::string& name,
                                                                const std::string& shown);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  // Starts on a page; empty for an empty file.
  std::span<const std::byte> bytes() const { return {data_, size_}; }

 private:
  MappedFile(const std::byte* data, size_t size) : data_(data), size_(size) {}

  const std::byte* const data_;
  const size_t size_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_MAPPED_FILE_H_
