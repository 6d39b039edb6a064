// SPDX-License-Identifier: Apache-2.0
//
// A whole file, read into memory: it takes as much memory as the file is long, and from then on no
// fault of the disk, nor anybody who cuts the file short, can touch what was read. (A mapped file
// is cheaper; a page of it that cannot be read ends the process. See mapped_file.h.)
//
// Invariant: the bytes start at a multiple of 64 and never change.
//
// Thread safety: constant after construction.
//
//   SL_ASSIGN_OR_RETURN(std::shared_ptr<const FileImage> file, folder.Read("hall.slscene", room));
//   Parse(file->bytes());
#ifndef SIGHTLINE_CORE_BASE_FILE_IMAGE_H_
#define SIGHTLINE_CORE_BASE_FILE_IMAGE_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/aligned_vector.h"
#include "core/base/cancel.h"
#include "core/base/file_calls.h"

namespace sightline {

// Asked before so many bytes are taken; an error keeps them from being.
using MemoryCheck = absl::FunctionRef<absl::Status(uint64_t bytes)>;

class FileImage {
 public:
  // `name` in the folder of that descriptor; `shown` is what errors call it. A link is not
  // followed. Errors: FileError's; FailedPrecondition for what is not a regular file; DataLoss for
  // one that was cut short meanwhile; ResourceExhausted (no memory); what `room` says; Cancelled or
  // DeadlineExceeded from `cancel`, which may be null.
  static absl::StatusOr<std::shared_ptr<const FileImage>> Read(FileCalls& calls, int folder,
                                                               const std::string& name,
                                                               const std::string& shown,
                                                               MemoryCheck room,
                                                               const CancelToken* cancel);
  FileImage(const FileImage&) = delete;
  FileImage& operator=(const FileImage&) = delete;

  std::span<const std::byte> bytes() const { return {bytes_.data(), bytes_.size()}; }

 private:
  FileImage() = default;

  AlignedVector<std::byte> bytes_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_FILE_IMAGE_H_
