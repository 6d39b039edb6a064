// SPDX-License-Identifier: Apache-2.0
//
// One folder of the file system, held open: its files by their names alone. A name has no
// separator, and links are not followed, so nothing outside the folder can be reached, even if the
// folder is renamed or replaced meanwhile.
//
// Thread safety: constant after construction; the file system orders what happens at once.
//
//   SL_ASSIGN_OR_RETURN(Folder folder, Folder::Open("/var/lib/sightline"));
//   SL_ASSIGN_OR_RETURN(auto file, folder.Map("hall.slscene"));
#ifndef SIGHTLINE_CORE_BASE_FOLDER_H_
#define SIGHTLINE_CORE_BASE_FOLDER_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/base/cancel.h"
#include "core/base/file_calls.h"
#include "core/base/file_image.h"
#include "core/base/file_replacement.h"
#include "core/base/mapped_file.h"

namespace sightline {

struct FolderEntry {
  std::string name;
  uint64_t bytes = 0;
  int64_t modified_ns = 0;  // Since 1970.
};

struct FileStamp {
  uint64_t inode = 0, bytes = 0;
  int64_t modified_ns = 0;

  bool operator==(const FileStamp&) const = default;
};

class Folder {
 public:
  // `calls` outlives the folder. FileError's errors.
  static absl::StatusOr<Folder> Open(const std::string& path,
                                     FileCalls& calls = FileCalls::System());
  Folder(Folder&& other) noexcept;
  Folder& operator=(Folder&&) = delete;
  ~Folder();

  const std::string& path() const { return path_; }

  // InvalidArgument for a bad name, else what MappedFile and FileReplacement say.
  absl::StatusOr<std::shared_ptr<const MappedFile>> Map(const std::string& name) const;
  // The same file in memory; what FileImage says.
  absl::StatusOr<std::shared_ptr<const FileImage>> Read(const std::string& name, MemoryCheck room,
                                                        const CancelToken* cancel) const;
  // Tells a file from another that took its place. Takes no descriptor. FileError's errors.
  absl::StatusOr<FileStamp> Stamp(const std::string& name) const;
  absl::StatusOr<FileReplacement> Replace(const std::string& name) const;
  absl::Status Remove(const std::string& name) const;
  // Whether files can be made and removed here, as far as rights tell. FileError's errors.
  absl::Status CheckWritable() const;
  // Plain files, by name.
  absl::StatusOr<std::vector<FolderEntry>> List() const;
  // Takes away what processes that were killed left half written. How many there were.
  absl::StatusOr<size_t> RemoveTemporaries() const;

 private:
  Folder(std::string path, int descriptor, FileCalls& calls)
      : path_(std::move(path)), descriptor_(descriptor), calls_(&calls) {}
  std::string Shown(const std::string& name) const;

  std::string path_;
  int descriptor_;
  FileCalls* calls_;
};

// OK for 1 to 255 bytes without '/' and control characters that are not "." or "..".
absl::Status CheckFileName(absl::string_view name);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_FOLDER_H_
