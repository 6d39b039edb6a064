// SPDX-License-Identifier: Apache-2.0
#include "server/auth/secret_file.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cstdint>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/regular_file.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

constexpr uint64_t kMaxBytes = 1 << 20;

absl::Status CheckOwnerAndMode(const std::string& path, const struct stat& file) {
  constexpr mode_t kForbidden = S_IWGRP | S_IXGRP | S_IRWXO;
  if ((file.st_mode & kForbidden) != 0) {
    return absl::PermissionDeniedError(absl::StrFormat(
        "%s has mode %04o and holds a secret: chmod 600 it (or 640: a group may read it)", path,
        static_cast<unsigned>(file.st_mode & 07777)));
  }
  if (file.st_uid != geteuid() && file.st_uid != 0) {
    return absl::PermissionDeniedError(
        absl::StrCat(path, " belongs to user ", file.st_uid, ", who is neither this one nor root"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::string> ReadFile(const std::string& path, bool secret) {
  const absl::StatusOr<RegularFile> file = RegularFile::Open(path);
  if (!file.ok()) return OfFile(path, file.status());
  if (secret) SL_RETURN_IF_ERROR(CheckOwnerAndMode(path, file->facts()));
  absl::StatusOr<std::string> text = file->Read(kMaxBytes);
  if (!text.ok()) return OfFile(path, text.status());
  return text;
}

}  // namespace

absl::StatusOr<std::string> ReadSecretFile(const std::string& path) {
  return ReadFile(path, /*secret=*/true);
}

absl::StatusOr<std::string> ReadPublicFile(const std::string& path) {
  return ReadFile(path, /*secret=*/false);
}

}  // namespace sightline
