// SPDX-License-Identifier: Apache-2.0
//
// Native scene files (.slscene; layout: scene_file_format.h): a scene's geometry with the
// structures built over it, written once and mapped from then on. A loaded scene's large arrays are
// those of the file, so that a scene of ten million triangles in the system's cache answers within
// a second.
//
// A file is believed in nothing: before a scene is handed out its header, its sizes, its sums, its
// coordinates, every index, every count, every box, the shape of the tree, its revision and its
// names (UTF-8) were checked. Whatever is wrong with it is an error that names the file, the
// section and the fault:
//
//   InvalidArgument     it is no scene file
//   Unimplemented       it is of another version
//   DataLoss            truncated, changed, or not consistent
//   ResourceExhausted   over a limit
//
// Answers on a loaded scene are those on the scene that was written, bit for bit.
//
// Thread safety: functions only.
//
//   SL_RETURN_IF_ERROR(WriteSceneFile(*scene, folder, "hall.slscene", pool));
//   SL_ASSIGN_OR_RETURN(SceneBytes bytes, MapSceneFile(folder, "hall.slscene"));
//   SL_ASSIGN_OR_RETURN(auto again, LoadScene(bytes, "hall", {}, pool));
#ifndef SIGHTLINE_CORE_SCENE_SCENE_FILE_H_
#define SIGHTLINE_CORE_SCENE_SCENE_FILE_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/base/folder.h"
#include "core/base/parallel.h"
#include "core/mesh/scene_geometry.h"
#include "core/scene/scene.h"
#include "core/scene/scene_file_format.h"

namespace sightline {

inline constexpr char kSceneFileEnding[] = ".slscene";

// A file's bytes, wherever they are. REQUIRES of whoever makes one: they start at a multiple of 64,
// and stay as they are while `owner` is held.
struct SceneBytes {
  std::span<const std::byte> bytes;
  std::shared_ptr<const void> owner;
  std::string shown;  // What errors call it.
  // Whether all of them take memory as long as `owner` is held, used or not, as those of a file
  // that was read do. The pages of a mapped one are the system's to take back.
  bool in_memory = false;
};

absl::StatusOr<SceneBytes> MapSceneFile(const Folder& folder, const std::string& name);
// The same in memory of its own: FileImage's errors.
absl::StatusOr<SceneBytes> ReadSceneFile(const Folder& folder, const std::string& name,
                                         MemoryCheck room, const CancelToken* cancel = nullptr);

// What can be told without reading the arrays.
struct SceneFileInfo {
  uint32_t version = 0;
  uint64_t file_bytes = 0;
  std::vector<SceneFileSection> sections;
  uint64_t objects = 0, triangles = 0, vertices = 0;
  uint64_t revision = 0;
  // At most what a scene of it holds; most of it is the file itself.
  uint64_t scene_bytes = 0;
};

// Checks the header, the table, the sizes and the revision: after it every section lies within the
// file. A few kilobytes are read.
absl::StatusOr<SceneFileInfo> InspectSceneFile(const SceneBytes& file);

// At most what LoadScene takes beside that to check the structures, about, in a pool of so many
// threads: given back once the scene is there. Of a kd-tree more than of the others, some 40 bytes
// a triangle and as many as its leaves name.
uint64_t SceneCheckBytes(const SceneFileInfo& info, int threads);

struct LoadOptions {
  MeshLimits limits;
  uint64_t revision = 0;  // Of the scene; 0: the one it was written with.
};

// Checks everything, and hands out the scene. Its arrays hold `file.owner`; report.memory_bytes
// counts the whole file if it is in memory, else what of it the scene uses.
absl::StatusOr<std::shared_ptr<const Scene>> LoadScene(
    const SceneBytes& file, std::string name, const LoadOptions& options, ThreadPool& pool,
    const CancelToken* cancel = nullptr, const std::function<void(double)>& progress = nullptr);

// Writes beside the target, syncs, and renames: afterwards the file is the whole scene, after an
// error what it was before, unless it says that the folder could not be synced (FileReplacement).
// FileError's errors; InvalidArgument (a revision that no file has); ResourceExhausted (no memory);
// Cancelled or DeadlineExceeded from `cancel`.
absl::Status WriteSceneFile(const Scene& scene, const Folder& folder, const std::string& name,
                            ThreadPool& pool, const CancelToken* cancel = nullptr,
                            const std::function<void(double)>& progress = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_SCENE_SCENE_FILE_H_
