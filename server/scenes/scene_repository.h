// SPDX-License-Identifier: Apache-2.0
//
// The folder in which a server keeps scenes: one native scene file for each, `{scene}.slscene`.
// Scenes are named by their ids alone (resource_name.h), so that nothing outside can be reached.
//
// Files are mapped, or read into memory for those who would rather pay for it than lose the process
// to a page that the disk does not deliver.
//
// Other files are left alone, but those that a killed process left half written, which are taken
// away at the start. Nobody else may write a file in place: it may be mapped. To put one there, or
// another in its stead, rename it (`sightline import` does).
//
// Errors carry a reason: STORAGE_FAILED for what the file system says, SCENE_FILE_NOT_FOUND.
//
// Thread safety: every method from any thread but gRPC's (they wait for the disk).
//
//   SL_ASSIGN_OR_RETURN(auto repository, SceneRepository::Open("/var/lib/sightline"));
//   SL_ASSIGN_OR_RETURN(SceneBytes file, repository->OpenFile("hall", room, cancel));
#ifndef SIGHTLINE_SERVER_SCENES_SCENE_REPOSITORY_H_
#define SIGHTLINE_SERVER_SCENES_SCENE_REPOSITORY_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "core/base/folder.h"
#include "core/base/parallel.h"
#include "core/scene/scene_file.h"

namespace sightline {

struct StoredFile {
  std::string scene_id;
  uint64_t bytes = 0;
  absl::Time modify_time;
};

enum class SceneFiles { kMapped, kRead };

class SceneRepository {
 public:
  // Of a folder that exists. `files` outlives it.
  static absl::StatusOr<std::unique_ptr<SceneRepository>> Open(
      const std::string& path, FileCalls& files = FileCalls::System(),
      SceneFiles mode = SceneFiles::kMapped);

  // By id; files whose names are no ids are left out.
  absl::StatusOr<std::vector<StoredFile>> List() const;
  // Whether anything has the name of its file, readable or not; an error where that cannot be told.
  // Takes no descriptor. REQUIRES, here and below: CheckId(scene_id).
  absl::StatusOr<bool> Has(const std::string& scene_id) const;
  // `room` is asked before a file is read. Errors: those of both, and what `room` says.
  absl::StatusOr<SceneBytes> OpenFile(const std::string& scene_id, MemoryCheck room,
                                      const CancelToken* cancel) const;
  absl::StatusOr<FileStamp> Stamp(const std::string& scene_id) const;
  // Cancelled by `cancel`, which may be null: the file is what it was before.
  absl::Status Store(const std::string& scene_id, const Scene& scene, ThreadPool& pool,
                     const CancelToken* cancel) const;
  // OK if there is none.
  absl::Status Remove(const std::string& scene_id) const;

 private:
  SceneRepository(Folder folder, SceneFiles mode) : folder_(std::move(folder)), mode_(mode) {}
  const Folder folder_;
  const SceneFiles mode_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SCENES_SCENE_REPOSITORY_H_
