// SPDX-License-Identifier: Apache-2.0
#include "core/base/mapped_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"

namespace sightline {

absl::StatusOr<std::shared_ptr<const MappedFile>> MappedFile::Open(FileCalls& calls, int folder,
                                                                   const std::string& name,
                                                                   const std::string& shown) {
  // Not to be held up by a pipe of that name.
  const int file =
      calls.OpenAt(folder, name.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0);
  if (file < 0) return FileError(errno, "cannot open", shown);
  const absl::Cleanup close = [file] { ::close(file); };  // A mapping outlives its descriptor.
  struct stat status;
  if (::fstat(file, &status) != 0) return FileError(errno, "cannot look at", shown);
  if (!S_ISREG(status.st_mode)) {
    return absl::FailedPreconditionError(absl::StrCat(shown, " is not a regular file"));
  }
  const auto size = static_cast<size_t>(status.st_size);
  void* data = nullptr;
  if (size > 0) {
    data = calls.Map(file, size);
    if (data == MAP_FAILED) return FileError(errno, "cannot map", shown);
  }
  return std::shared_ptr<const MappedFile>(
      new MappedFile(static_cast<const std::byte*>(data), size));
}

MappedFile::~MappedFile() {
  if (size_ > 0) ::munmap(const_cast<std::byte*>(data_), size_);
}

}  // namespace sightline
