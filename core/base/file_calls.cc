// SPDX-License-Identifier: Apache-2.0
#include "core/base/file_calls.h"

#include <fcntl.h>
#include <stdio.h>  // NOLINT(modernize-deprecated-headers): renameat is POSIX, not in <cstdio>.
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

#include "absl/strings/str_cat.h"

namespace sightline {

int FileCalls::OpenAt(int folder, const char* name, int flags, mode_t mode) {
  return ::openat(folder, name, flags, mode);
}
ssize_t FileCalls::Write(int file, const void* data, size_t bytes) {
  return ::write(file, data, bytes);
}
ssize_t FileCalls::ReadAt(int file, void* data, size_t bytes, off_t offset) {
  return ::pread(file, data, bytes, offset);
}
int FileCalls::Sync(int file) { return ::fsync(file); }
int FileCalls::StatAt(int folder, const char* name, struct stat* status) {
  return ::fstatat(folder, name, status, AT_SYMLINK_NOFOLLOW);
}
int FileCalls::ChangeMode(int file, mode_t mode) { return ::fchmod(file, mode); }
int FileCalls::AccessAt(int folder, const char* name, int mode) {
  return ::faccessat(folder, name, mode, 0);
}
int FileCalls::RenameAt(int folder, const char* from, const char* to) {
  return ::renameat(folder, from, folder, to);
}
int FileCalls::UnlinkAt(int folder, const char* name) { return ::unlinkat(folder, name, 0); }
void* FileCalls::Map(int file, size_t bytes) {
  return ::mmap(nullptr, bytes, PROT_READ, MAP_SHARED, file, 0);
}

FileCalls& FileCalls::System() {
  static auto* const system = new FileCalls;
  return *system;
}

absl::Status FileError(int error, absl::string_view what, absl::string_view path) {
  const std::string text =
      absl::StrCat(what, " ", path, ": ", std::generic_category().message(error));
  switch (error) {
    case ENOENT:
    case ENOTDIR:
      return absl::NotFoundError(text);
    case EACCES:
    case EPERM:
    case EROFS:
      return absl::PermissionDeniedError(text);
    case ENOSPC:
    case EDQUOT:
    case EFBIG:
      return absl::ResourceExhaustedError(
          absl::StrCat(text, ": free some space, or raise the limit on a file's size"));
    case EMFILE:
    case ENFILE:
      return absl::ResourceExhaustedError(
          absl::StrCat(text, ": raise the limit on open files (ulimit -n)"));
    case ENOMEM:
      return absl::ResourceExhaustedError(text);
    case ELOOP:
      return absl::FailedPreconditionError(
          absl::StrCat(text, ": it is a link, and links are not followed"));
    case EISDIR:
    case ENXIO:
      return absl::FailedPreconditionError(absl::StrCat(text, ": it is not a regular file"));
    case EIO:
      return absl::DataLossError(text);
    default:
      return absl::UnavailableError(text);
  }
}

}  // namespace sightline
