// SPDX-License-Identifier: Apache-2.0
#include "client/cli/formats/file.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"

namespace sightline::cli {
namespace {

absl::Status Failed(int error, absl::string_view what, const std::string& path) {
  return absl::ErrnoToStatus(error, absl::StrCat(what, " '", path, "'"));
}

// How often who waits for a pipe looks whether that is still wanted.
constexpr int kLookMilliseconds = 20;

// Waits until a read would not; OK also where that cannot be told.
absl::Status WaitForBytes(int fd, const CancelToken* cancel) {
  while (true) {
    if (cancel != nullptr && cancel->cancelled()) return cancel->ToStatus();
    pollfd ready = {.fd = fd, .events = POLLIN, .revents = 0};
    const int events = ::poll(&ready, 1, cancel != nullptr ? kLookMilliseconds : -1);
    if (events > 0 || (events < 0 && errno != EINTR)) return absl::OkStatus();
  }
}

absl::Status WriteAll(int fd, absl::string_view bytes, const std::string& path) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd, bytes.data(), bytes.size());
    if (n < 0) {
      if (errno == EINTR) continue;
      return Failed(errno, "cannot write", path);
    }
    bytes.remove_prefix(static_cast<size_t>(n));
  }
  return absl::OkStatus();
}

absl::Status WriteParts(int fd, std::span<const absl::string_view> parts, const std::string& path) {
  absl::Status status;
  for (const absl::string_view part : parts) {
    if (status.ok()) status = WriteAll(fd, part, path);
  }
  return status;
}

// Closes what it holds; the writers close by hand where they must see the error.
class FileDescriptor {
 public:
  explicit FileDescriptor(int fd) : fd_(fd) {}
  ~FileDescriptor() { Close(); }
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  int get() const { return fd_; }
  bool Close() {
    const bool ok = fd_ < 0 || ::close(fd_) == 0;
    fd_ = -1;
    return ok;
  }

 private:
  int fd_;
};

// Where a write to `path` ends up: links are followed, so that they stay links.
std::string Resolve(const std::string& path) {
  std::error_code error;
  const std::filesystem::path resolved = std::filesystem::weakly_canonical(path, error);
  return error ? path : resolved.string();
}

}  // namespace

absl::StatusOr<std::string> ReadFile(const std::string& path, const CancelToken* cancel) {
  // O_NONBLOCK: opening a named pipe would wait for its writer. Of regular files it says nothing.
  FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (file.get() < 0) return Failed(errno, "cannot open", path);
  struct stat info;
  if (::fstat(file.get(), &info) != 0) return Failed(errno, "cannot read", path);
  if (S_ISDIR(info.st_mode)) {
    return absl::InvalidArgumentError(absl::StrCat("'", path, "' is a folder, not a file"));
  }
  std::string bytes;
  if (info.st_size > 0) bytes.reserve(static_cast<size_t>(info.st_size));
  // The size is a hint alone: pipes say 0, and a file may grow or shrink while it is read.
  constexpr size_t kChunk = size_t{1} << 20;
  while (true) {
    if (absl::Status s = WaitForBytes(file.get(), cancel); !s.ok()) return s;
    const size_t old_size = bytes.size();
    bytes.resize(old_size + kChunk);
    const ssize_t n = ::read(file.get(), bytes.data() + old_size, kChunk);
    if (n < 0 && (errno == EINTR || errno == EAGAIN)) {
      bytes.resize(old_size);
      continue;
    }
    if (n < 0) return Failed(errno, "cannot read", path);
    bytes.resize(old_size + static_cast<size_t>(n));
    if (n == 0) return bytes;
  }
}

absl::Status WriteFile(const std::string& path, absl::string_view bytes) {
  return WriteFile(path, std::span(&bytes, 1));
}

absl::Status WriteFile(const std::string& path, std::span<const absl::string_view> parts) {
  struct stat old;
  const bool exists = ::stat(path.c_str(), &old) == 0;
  if (exists && !S_ISREG(old.st_mode)) {
    FileDescriptor file(::open(path.c_str(), O_WRONLY | O_CLOEXEC));
    if (file.get() < 0) return Failed(errno, "cannot write", path);
    return WriteParts(file.get(), parts, path);
  }
  static std::atomic<int> counter{0};
  const std::string target = Resolve(path);
  const std::string temporary = absl::StrCat(target, ".", ::getpid(), ".", ++counter, ".tmp");
  const mode_t mode = exists ? old.st_mode & 0777 : 0666;
  FileDescriptor file(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode));
  if (file.get() < 0) return Failed(errno, "cannot write", path);
  absl::Status status;
  // What the umask took of an old file's permissions; a new file's are those that it leaves.
  if (exists && ::fchmod(file.get(), mode) != 0) status = Failed(errno, "cannot write", path);
  if (status.ok()) status = WriteParts(file.get(), parts, path);
  if (!file.Close() && status.ok()) status = Failed(errno, "cannot write", path);
  if (status.ok() && ::rename(temporary.c_str(), target.c_str()) != 0) {
    status = Failed(errno, "cannot write", path);
  }
  if (!status.ok()) ::unlink(temporary.c_str());
  return status;
}

absl::Status CheckWritable(const std::string& path) {
  if (path.empty()) return absl::InvalidArgumentError("an output file needs a name");
  struct stat info;
  if (::stat(path.c_str(), &info) == 0) {
    if (S_ISDIR(info.st_mode)) {
      return absl::InvalidArgumentError(absl::StrCat("cannot write '", path, "': it is a folder"));
    }
    if (::access(path.c_str(), W_OK) != 0) return Failed(errno, "cannot write", path);
    if (!S_ISREG(info.st_mode)) return absl::OkStatus();
  }
  const std::string folder = std::filesystem::path(Resolve(path)).parent_path().string();
  if (::access(folder.empty() ? "." : folder.c_str(), W_OK | X_OK) != 0) {
    return Failed(errno, "cannot write", path);
  }
  return absl::OkStatus();
}

}  // namespace sightline::cli
