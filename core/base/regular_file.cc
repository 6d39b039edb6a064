// SPDX-License-Identifier: Apache-2.0
#include "core/base/regular_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "absl/strings/str_cat.h"

namespace sightline {
namespace {

// A few milliseconds of a fast disk: so often a reader looks whether it is still wanted.
constexpr size_t kReadAtOnce = size_t{8} << 20;

absl::Status OpenError(int error) {
  if (error == ENOENT || error == ENOTDIR) return absl::NotFoundError("no such file");
  // What a socket says to whoever opens it.
  if (error == ENXIO) return absl::InvalidArgumentError("is not a regular file");
  return absl::PermissionDeniedError(absl::StrCat("cannot be opened: ", std::strerror(error)));
}

absl::Status CheckKind(const struct stat& facts) {
  if (S_ISREG(facts.st_mode)) return absl::OkStatus();
  return absl::InvalidArgumentError(S_ISDIR(facts.st_mode)    ? "is a folder, not a file"
                                    : S_ISFIFO(facts.st_mode) ? "is a pipe, not a regular file"
                                                              : "is not a regular file");
}

}  // namespace

absl::StatusOr<RegularFile> RegularFile::Open(const std::string& path) {
  // O_NONBLOCK: opening a named pipe would wait for its writer. Of regular files it says nothing.
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) return OpenError(errno);
  RegularFile file(descriptor, {});
  if (fstat(descriptor, &file.facts_) != 0) return OpenError(errno);
  if (absl::Status status = CheckKind(file.facts_); !status.ok()) return status;
  return file;
}

RegularFile::~RegularFile() {
  if (descriptor_ >= 0) close(descriptor_);
}

absl::StatusOr<std::string> RegularFile::Read(uint64_t max_bytes, const CancelToken* cancel) const {
  // A byte more than there is, or than there may be: it shows the end, or what is too much.
  std::string bytes(std::min(size(), max_bytes) + 1, '\0');
  uint64_t have = 0;
  while (have <= max_bytes) {
    if (have == bytes.size()) bytes.resize(std::min(max_bytes, 2 * have) + 1);
    if (cancel != nullptr && cancel->cancelled()) return cancel->ToStatus();
    const size_t most = std::min(kReadAtOnce, bytes.size() - have);
    const ssize_t got = pread(descriptor_, bytes.data() + have, most, static_cast<off_t>(have));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) {
      return absl::DataLossError(absl::StrCat("cannot be read: ", std::strerror(errno)));
    }
    if (got == 0) break;
    have += static_cast<uint64_t>(got);
  }
  if (have > max_bytes) {
    return absl::ResourceExhaustedError(absl::StrCat("is longer than ", max_bytes, " bytes"));
  }
  if (have < size()) {
    return absl::DataLossError(
        absl::StrCat("read ", have, " of ", size(), " bytes: it became shorter"));
  }
  bytes.resize(have);
  return bytes;
}

absl::Status OfFile(const std::string& path, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat(path, ": ", status.message()));
}

}  // namespace sightline
