// SPDX-License-Identifier: Apache-2.0
#include "core/base/file_image.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <new>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// A few milliseconds of a fast disk: so often a reader looks whether it is still wanted.
constexpr size_t kReadAtOnce = size_t{8} << 20;

absl::Status ReadAll(FileCalls& calls, int file, const std::string& shown,
                     const CancelToken* cancel, std::span<std::byte> out) {
  size_t done = 0;
  while (done < out.size()) {
    if (cancel != nullptr && cancel->cancelled()) return cancel->ToStatus();
    const size_t most = std::min(kReadAtOnce, out.size() - done);
    const ssize_t got = calls.ReadAt(file, out.data() + done, most, static_cast<off_t>(done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return FileError(errno, "cannot read", shown);
    if (got == 0) {
      return absl::DataLossError(absl::StrCat(shown, " was cut short while it was read, to ", done,
                                              " of ", out.size(), " bytes: put it there again"));
    }
    done += static_cast<size_t>(got);
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::shared_ptr<const FileImage>> FileImage::Read(FileCalls& calls, int folder,
                                                                 const std::string& name,
                                                                 const std::string& shown,
                                                                 MemoryCheck room,
                                                                 const CancelToken* cancel) {
  // Not to be held up by a pipe of that name.
  const int file =
      calls.OpenAt(folder, name.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0);
  if (file < 0) return FileError(errno, "cannot open", shown);
  const absl::Cleanup close = [file] { ::close(file); };
  struct stat status;
  if (::fstat(file, &status) != 0) return FileError(errno, "cannot look at", shown);
  if (!S_ISREG(status.st_mode)) {
    return absl::FailedPreconditionError(absl::StrCat(shown, " is not a regular file"));
  }
  const auto size = static_cast<size_t>(status.st_size);
  SL_RETURN_IF_ERROR(room(size));
  std::shared_ptr<FileImage> image(new FileImage);
  try {
    image->bytes_.ResizeUninitialized(size);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat("no memory for the ", size, " bytes of ",
                                                     shown, ": free some, or map the file"));
  }
  SL_RETURN_IF_ERROR(ReadAll(calls, file, shown, cancel, {image->bytes_.data(), size}));
  return std::shared_ptr<const FileImage>(std::move(image));
}

}  // namespace sightline
