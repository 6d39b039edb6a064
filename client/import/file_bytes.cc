// SPDX-License-Identifier: Apache-2.0
#include "client/import/file_bytes.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"

namespace sightline {
namespace {

absl::Status OpenError(int error) {
  const std::string reason = absl::StrCat("cannot be opened: ", std::strerror(error));
  if (error == ENOENT || error == ENOTDIR) return absl::NotFoundError("no such file");
  // For whatever reason: nothing is said of what is in it.
  return absl::PermissionDeniedError(reason);
}

// The path without its ".xz" or ".gz".
std::filesystem::path Uncompressed(const std::string& path) {
  const std::string suffix = CompressionSuffix(path);
  return path.substr(0, path.size() - (suffix.empty() ? 0 : suffix.size() + 1));
}

}  // namespace

absl::StatusOr<std::string> ReadFileBytes(const std::string& path, uint64_t max_bytes) {
  // O_NONBLOCK: opening a named pipe must not wait for its writer.
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return OpenError(errno);
  absl::Cleanup close_file = [fd] { close(fd); };
  struct stat info;
  if (fstat(fd, &info) != 0) return OpenError(errno);
  if (S_ISDIR(info.st_mode)) return absl::InvalidArgumentError("is a folder, not a file");
  if (!S_ISREG(info.st_mode)) return absl::InvalidArgumentError("is not a regular file");
  const uint64_t size = static_cast<uint64_t>(info.st_size);
  if (size == 0) return absl::InvalidArgumentError("the file is empty");
  if (size > max_bytes) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the file holds ", size, " bytes; the limit max_file_bytes is ", max_bytes));
  }
  std::string bytes(size, '\0');
  size_t have = 0;
  while (have < bytes.size()) {
    const ssize_t got = read(fd, bytes.data() + have, bytes.size() - have);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) {
      return absl::DataLossError(
          absl::StrCat("read ", have, " of ", size,
                       " bytes: ", got < 0 ? std::strerror(errno) : "it became shorter"));
    }
    have += static_cast<size_t>(got);
  }
  return bytes;
}

std::string CompressionSuffix(const std::string& path) {
  const std::string ending =
      absl::AsciiStrToLower(path.substr(path.size() - std::min<size_t>(3, path.size())));
  return ending == ".xz" || ending == ".gz" ? ending.substr(1) : "";
}

std::string MeshExtension(const std::string& path) {
  const std::string extension = Uncompressed(path).extension().string();
  return absl::AsciiStrToLower(extension.empty() ? extension : extension.substr(1));
}

std::string FileStem(const std::string& path) { return Uncompressed(path).stem().string(); }

std::string FileFolder(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return folder.empty() ? "." : folder;
}

}  // namespace sightline
