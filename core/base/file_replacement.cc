// SPDX-License-Identifier: Apache-2.0
#include "core/base/file_replacement.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdint>
#include <optional>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

constexpr absl::string_view kTemporaryEnd = ".tmp";
// Linux writes at most 2 GiB less a page at once.
constexpr size_t kMostAtOnce = size_t{1} << 30;
// Temporary files that others may take away, one after the other, before one is locked.
constexpr int kMostTries = 16;
// Names that are taken, before one is free. More than a service that is killed in the middle of a
// write at every start leaves in years, should nobody ever clear them away.
constexpr int kMostTaken = 1 << 16;
constexpr mode_t kNewMode = 0644, kPermissions = 0777;

// Locks a file that was made just now, until it is closed, by whatever end: so others see that it
// is being written. False if somebody took it for one of the dead's before that. Where the file
// system has no locks there is none.
bool LockNew(int file) {
  if (::flock(file, LOCK_EX | LOCK_NB) != 0) return errno != EWOULDBLOCK;
  struct stat status;
  return ::fstat(file, &status) != 0 || status.st_nlink > 0;
}

// The permission bits of the file that is to be replaced; nothing if there is no plain file.
absl::StatusOr<std::optional<mode_t>> ModeOf(FileCalls& calls, int folder, const std::string& name,
                                             const std::string& shown) {
  struct stat old;
  if (calls.StatAt(folder, name.c_str(), &old) != 0) {
    if (errno != ENOENT) return FileError(errno, "cannot look at", shown);
    return std::nullopt;
  }
  if (!S_ISREG(old.st_mode)) return std::nullopt;
  return old.st_mode & kPermissions;
}

bool HasMode(int file, mode_t mode) {
  struct stat status;
  return ::fstat(file, &status) == 0 && (status.st_mode & kPermissions) == mode;
}

}  // namespace

absl::StatusOr<FileReplacement> FileReplacement::Create(FileCalls& calls, int folder,
                                                        const std::string& name,
                                                        const std::string& shown) {
  SL_ASSIGN_OR_RETURN(const std::optional<mode_t> old_mode, ModeOf(calls, folder, name, shown));
  const mode_t mode = old_mode.value_or(kNewMode);
  static std::atomic<uint64_t> number{0};
  int taken_away = 0, taken = 0;
  while (taken_away < kMostTries && taken < kMostTaken) {
    std::string temporary =
        absl::StrCat(".", name, ".", ::getpid(), "-",
                     number.fetch_add(1, std::memory_order_relaxed), kTemporaryEnd);
    const int flags = O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC;
    const int file = calls.OpenAt(folder, temporary.c_str(), flags, mode);
    if (file < 0) {
      if (errno != EEXIST) return FileError(errno, "cannot write", shown);
      ++taken;  // By a process that was killed, and had this one's pid.
      continue;
    }
    if (LockNew(file)) {
      FileReplacement replacement(calls, folder, file, name, std::move(temporary), shown);
      // What the umask took of the old file's permissions; a new file's are those that it leaves.
      if (old_mode.has_value() && !HasMode(file, mode) && calls.ChangeMode(file, mode) != 0) {
        return FileError(errno, "cannot set the permissions of", shown);
      }
      return replacement;
    }
    ::close(file);
    // Of whoever locked it, and may be killed before it is gone.
    (void)calls.UnlinkAt(folder, temporary.c_str());
    ++taken_away;
  }
  if (taken == kMostTaken) {
    return absl::UnavailableError(absl::StrCat(
        "cannot write ", shown, ": ", taken, " files that begin with \".", name,
        ".\" and end in \"", kTemporaryEnd, "\" are in the way: remove those that are left"));
  }
  return absl::UnavailableError(absl::StrCat(
      "cannot write ", shown, ": each new file beside it is taken away at once: try again later"));
}

FileReplacement::FileReplacement(FileCalls& calls, int folder, int file, std::string name,
                                 std::string temporary, std::string shown)
    : calls_(calls),
      folder_(folder),
      file_(file),
      name_(std::move(name)),
      temporary_(std::move(temporary)),
      shown_(std::move(shown)) {}

FileReplacement::FileReplacement(FileReplacement&& other) noexcept
    : calls_(other.calls_),
      folder_(other.folder_),
      file_(std::exchange(other.file_, -1)),
      name_(other.name_),
      temporary_(other.temporary_),
      shown_(other.shown_),
      renamed_(std::exchange(other.renamed_, true)) {}

FileReplacement::~FileReplacement() {
  if (file_ >= 0) ::close(file_);
  // What cannot be taken away now is taken away at the next start.
  if (!renamed_) (void)calls_.UnlinkAt(folder_, temporary_.c_str());
}

absl::Status FileReplacement::Append(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = calls_.Write(file_, bytes.data(), std::min(bytes.size(), kMostAtOnce));
    if (written < 0) {
      if (errno == EINTR) continue;
      return FileError(errno, "cannot write", shown_);
    }
    // A write of nothing would go on for ever; a short one goes on with the rest, and the system
    // says then what was wrong.
    if (written == 0) return FileError(ENOSPC, "cannot write", shown_);
    bytes = bytes.subspan(static_cast<size_t>(written));
  }
  return absl::OkStatus();
}

absl::Status FileReplacement::Commit() {
  if (calls_.Sync(file_) != 0) return FileError(errno, "cannot sync", shown_);
  // Still locked: who takes away what the dead have left must not take it for such.
  if (calls_.RenameAt(folder_, temporary_.c_str(), name_.c_str()) != 0) {
    return FileError(errno, "cannot rename a new file to", shown_);
  }
  renamed_ = true;
  if (::close(std::exchange(file_, -1)) != 0) return FileError(errno, "cannot close", shown_);
  if (calls_.Sync(folder_) != 0) return FileError(errno, "cannot sync the folder of", shown_);
  return absl::OkStatus();
}

bool IsTemporaryName(absl::string_view name) {
  return absl::StartsWith(name, ".") && absl::EndsWith(name, kTemporaryEnd);
}

}  // namespace sightline
