// SPDX-License-Identifier: Apache-2.0
#include "server/auth/secret_file.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <memory>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

constexpr size_t kMaxBytes = 1 << 20;

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
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rbe"),
                                                             &std::fclose);
  if (file == nullptr) return absl::ErrnoToStatus(errno, absl::StrCat("cannot read ", path));
  // Of what was opened, not of what stands there by now.
  struct stat facts {};
  if (fstat(fileno(file.get()), &facts) != 0) {
    return absl::ErrnoToStatus(errno, absl::StrCat("cannot read ", path));
  }
  if (!S_ISREG(facts.st_mode)) {
    return absl::InvalidArgumentError(absl::StrCat(path, " is no regular file"));
  }
  if (secret) SL_RETURN_IF_ERROR(CheckOwnerAndMode(path, facts));
  std::string text(kMaxBytes + 1, '\0');
  text.resize(std::fread(text.data(), 1, text.size(), file.get()));
  if (std::ferror(file.get()) != 0) {
    return absl::UnavailableError(absl::StrCat("cannot read ", path));
  }
  if (text.size() > kMaxBytes) {
    return absl::InvalidArgumentError(absl::StrCat(path, " is longer than ", kMaxBytes, " bytes"));
  }
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
