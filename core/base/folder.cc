// SPDX-License-Identifier: Apache-2.0
#include "core/base/folder.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

constexpr size_t kMaxNameBytes = 255;
constexpr int kFolderFlags = O_RDONLY | O_DIRECTORY | O_CLOEXEC;

int64_t ModifiedNs(const struct stat& status) {
  return status.st_mtim.tv_sec * 1'000'000'000LL + status.st_mtim.tv_nsec;
}

// For writing, though nothing is written: over NFS, locks are those of fcntl, and an exclusive one
// is to be had on no other descriptor (flock(2)). Whoever may not write the file may still be
// allowed to take it away, and elsewhere a descriptor for reading will do.
int OpenToLock(FileCalls& calls, int folder, const std::string& name) {
  constexpr int kFlags = O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC;
  const int file = calls.OpenAt(folder, name.c_str(), O_WRONLY | kFlags, 0);
  if (file >= 0 || (errno != EACCES && errno != EROFS)) return file;
  return calls.OpenAt(folder, name.c_str(), O_RDONLY | kFlags, 0);
}

}  // namespace

absl::Status CheckFileName(absl::string_view name) {
  const bool good = !name.empty() && name.size() <= kMaxNameBytes && name != "." && name != ".." &&
                    std::all_of(name.begin(), name.end(), [](char c) {
                      return c != '/' && static_cast<unsigned char>(c) >= ' ' && c != '\x7f';
                    });
  if (good) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("\"", absl::CHexEscape(name.substr(0, kMaxNameBytes)),
                   "\" is no file name: 1 to 255 bytes, without a separator"));
}

absl::StatusOr<Folder> Folder::Open(const std::string& path, FileCalls& calls) {
  const int descriptor = calls.OpenAt(AT_FDCWD, path.c_str(), kFolderFlags, 0);
  if (descriptor < 0) return FileError(errno, "cannot open the folder", path);
  return Folder(path, descriptor, calls);
}

Folder::Folder(Folder&& other) noexcept
    : path_(std::move(other.path_)),
      descriptor_(std::exchange(other.descriptor_, -1)),
      calls_(other.calls_) {}

Folder::~Folder() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

std::string Folder::Shown(const std::string& name) const { return absl::StrCat(path_, "/", name); }

absl::StatusOr<std::shared_ptr<const MappedFile>> Folder::Map(const std::string& name) const {
  SL_RETURN_IF_ERROR(CheckFileName(name));
  return MappedFile::Open(*calls_, descriptor_, name, Shown(name));
}

absl::StatusOr<std::shared_ptr<const FileImage>> Folder::Read(const std::string& name,
                                                              MemoryCheck room,
                                                              const CancelToken* cancel) const {
  SL_RETURN_IF_ERROR(CheckFileName(name));
  return FileImage::Read(*calls_, descriptor_, name, Shown(name), room, cancel);
}

absl::StatusOr<FileStamp> Folder::Stamp(const std::string& name) const {
  SL_RETURN_IF_ERROR(CheckFileName(name));
  struct stat status;
  if (calls_->StatAt(descriptor_, name.c_str(), &status) != 0) {
    return FileError(errno, "cannot look at", Shown(name));
  }
  return FileStamp{.inode = status.st_ino,
                   .bytes = static_cast<uint64_t>(status.st_size),
                   .modified_ns = ModifiedNs(status)};
}

absl::StatusOr<FileReplacement> Folder::Replace(const std::string& name) const {
  SL_RETURN_IF_ERROR(CheckFileName(name));
  return FileReplacement::Create(*calls_, descriptor_, name, Shown(name));
}

absl::Status Folder::Remove(const std::string& name) const {
  SL_RETURN_IF_ERROR(CheckFileName(name));
  if (calls_->UnlinkAt(descriptor_, name.c_str()) != 0) {
    return FileError(errno, "cannot remove", Shown(name));
  }
  if (calls_->Sync(descriptor_) != 0) {
    return FileError(errno, "cannot sync the folder of", Shown(name));
  }
  return absl::OkStatus();
}

absl::Status Folder::CheckWritable() const {
  if (calls_->AccessAt(descriptor_, ".", W_OK | X_OK) == 0) return absl::OkStatus();
  return FileError(errno, "cannot write to the folder", path_);
}

absl::StatusOr<std::vector<FolderEntry>> Folder::List() const {
  // A descriptor of its own: reading moves a position that all copies of one share.
  const int own = calls_->OpenAt(descriptor_, ".", kFolderFlags, 0);
  if (own < 0) return FileError(errno, "cannot read the folder", path_);
  DIR* const stream = ::fdopendir(own);
  if (stream == nullptr) {
    const int error = errno;
    ::close(own);
    return FileError(error, "cannot read the folder", path_);
  }
  const absl::Cleanup close = [stream] { ::closedir(stream); };
  std::vector<FolderEntry> entries;
  while (true) {
    errno = 0;
    const dirent* const next = ::readdir(stream);
    if (next == nullptr) break;
    struct stat status;
    // One that is gone by now is not in the folder.
    if (::fstatat(descriptor_, next->d_name, &status, AT_SYMLINK_NOFOLLOW) != 0) continue;
    if (!S_ISREG(status.st_mode)) continue;
    entries.push_back({next->d_name, static_cast<uint64_t>(status.st_size), ModifiedNs(status)});
  }
  if (errno != 0) return FileError(errno, "cannot read the folder", path_);
  std::sort(entries.begin(), entries.end(),
            [](const FolderEntry& a, const FolderEntry& b) { return a.name < b.name; });
  return entries;
}

absl::StatusOr<size_t> Folder::RemoveTemporaries() const {
  SL_ASSIGN_OR_RETURN(const std::vector<FolderEntry> entries, List());
  size_t removed = 0;
  for (const FolderEntry& entry : entries) {
    if (!IsTemporaryName(entry.name)) continue;
    const int file = OpenToLock(*calls_, descriptor_, entry.name);
    const absl::Cleanup close = [file] {
      if (file >= 0) ::close(file);
    };
    // Somebody is writing it, or may be.
    if (file < 0 || ::flock(file, LOCK_EX | LOCK_NB) != 0) continue;
    if (calls_->UnlinkAt(descriptor_, entry.name.c_str()) != 0) {
      if (errno == ENOENT) continue;  // It was committed meanwhile.
      return FileError(errno, "cannot remove", Shown(entry.name));
    }
    ++removed;
  }
  return removed;
}

}  // namespace sightline
