// SPDX-License-Identifier: Apache-2.0
//
// The seam between this project and the file system: the few calls that can fail for reasons of the
// disk. Whatever is written or mapped goes through one of these, so that tests can put a full disk,
// a short write or a failed sync behind any step.
//
// Every member does what the system call of its name does, returns what that returns, and leaves
// errno as that does. Names are relative to the folder's descriptor.
//
// Thread safety: every member of FileCalls::System() from any thread; an override says its own.
//
//   class FullDisk final : public FileCalls {
//     ssize_t Write(int, const void*, size_t) override { return errno = ENOSPC, -1; }
//   };
#ifndef SIGHTLINE_CORE_BASE_FILE_CALLS_H_
#define SIGHTLINE_CORE_BASE_FILE_CALLS_H_

#include <sys/stat.h>
#include <sys/types.h>

#include <cstddef>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace sightline {

class FileCalls {
 public:
  virtual ~FileCalls() = default;

  virtual int OpenAt(int folder, const char* name, int flags, mode_t mode);
  virtual ssize_t Write(int file, const void* data, size_t bytes);
  virtual ssize_t ReadAt(int file, void* data, size_t bytes, off_t offset);  // pread.
  virtual int Sync(int file);
  virtual int StatAt(int folder, const char* name, struct stat* status);  // Follows no link.
  virtual int ChangeMode(int file, mode_t mode);                          // fchmod.
  virtual int AccessAt(int folder, const char* name, int mode);
  virtual int RenameAt(int folder, const char* from, const char* to);
  virtual int UnlinkAt(int folder, const char* name);
  // Read-only and shared, from the file's start; MAP_FAILED.
  virtual void* Map(int file, size_t bytes);

  // The real ones.
  static FileCalls& System();
};

// "<what> <path>: <the error's text>", and a remedy where there is one: ResourceExhausted for a
// full disk, a quota or no more descriptors, NotFound, PermissionDenied, FailedPrecondition for
// what is not a regular file, DataLoss for a failing device, else Unavailable.
absl::Status FileError(int error, absl::string_view what, absl::string_view path);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_FILE_CALLS_H_
