// SPDX-License-Identifier: Apache-2.0
#include "client/import/file_bytes.h"

#include <algorithm>
#include <filesystem>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "core/base/regular_file.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// The path without its ".xz" or ".gz".
std::filesystem::path Uncompressed(const std::string& path) {
  const std::string suffix = CompressionSuffix(path);
  return path.substr(0, path.size() - (suffix.empty() ? 0 : suffix.size() + 1));
}

}  // namespace

absl::StatusOr<std::string> ReadFileBytes(const std::string& path, uint64_t max_bytes,
                                          const CancelToken* cancel) {
  SL_ASSIGN_OR_RETURN(const RegularFile file, RegularFile::Open(path));
  if (file.size() == 0) return absl::InvalidArgumentError("the file is empty");
  if (file.size() > max_bytes) {
    return absl::ResourceExhaustedError(absl::StrCat(
        "the file holds ", file.size(), " bytes; the limit max_file_bytes is ", max_bytes));
  }
  return file.Read(max_bytes, cancel);
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
