// SPDX-License-Identifier: Apache-2.0
//
// What the mesh readers share: the options that bound an import, the scene they hand back and the
// report of everything that was skipped, dropped or suspicious on the way ("nothing silent").
//
// Invariants of a scene that a reader returned with OK:
//  1. At least one object has a triangle, and an object without triangles is not listed.
//  2. Every index is below its object's vertex count.
//  3. A vertex is finite, or all three of its coordinates are the same quiet NaN (counted in the
//     report).
//  4. Names are valid UTF-8 without control characters, not empty, and unique.
//  5. The same bytes, name and options give the same scene, bit for bit.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CLIENT_IMPORT_IMPORT_TYPES_H_
#define SIGHTLINE_CLIENT_IMPORT_IMPORT_TYPES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "core/base/cancel.h"
#include "core/mesh/object.h"

namespace sightline {

enum class MeshFormat : uint8_t {
  kObj,
  kPly,
  kStl,
  kOff,
  kGltf,   // JSON, with its buffers as data URIs or as files beside it.
  kGlb,    // The binary container.
  kOther,  // Whatever assimp knows by the file's extension.
};

struct ImportOptions {
  // Bytes: the most that a file may hold, after decompression too. It bounds the memory of an
  // import: the readers allocate in proportion to the bytes that are there, never to a count that a
  // header claims. How much a byte of glTF's JSON may come to is large; there the limits of
  // gltf_json.h bound it, too.
  uint64_t max_file_bytes = uint64_t{4} << 30;
  // Triangles: the most that a scene may hold. Instancing (glTF nodes, assimp nodes) lets a small
  // file ask for any number of them; this is where it ends.
  uint64_t max_triangles = 100'000'000;
  // Seconds that assimp may take, in its own process (assimp_reader.h).
  double assimp_timeout_seconds = 300;
  // Names the only object of a format without names, and the format's file in messages. ImportFile
  // fills it in from the path.
  std::string name;
  // ImportBytes with kOther: the extension by which assimp recognizes the format ("3ds").
  std::string extension;
  // Where a .gltf may read its buffers from: files below this folder alone. Empty: data URIs only.
  // ImportFile fills it in with the file's folder.
  std::string base_folder;
  // Once it stops, the import ends with its status; may be null. It is looked at every few
  // milliseconds, but for what another library reads at one go: glTF's JSON.
  const CancelToken* cancel = nullptr;
};

// Of a loop of short steps, at step `step`: not OK once nobody wants its end any more. It looks now
// and then, and at step 0.
inline absl::Status CheckWanted(const CancelToken* cancel, uint64_t step) {
  constexpr uint64_t kStepsPerLook = 4096;  // Some tens of microseconds.
  return cancel == nullptr || step % kStepsPerLook != 0 ? absl::OkStatus() : cancel->ToStatus();
}

struct ImportReport {
  std::string format;  // "obj", "ply ascii", "stl binary", "glb", "assimp 3ds", ...

  // What was in the file.
  uint64_t polygons = 0;         // Faces, whatever became of them.
  uint64_t polygons_fanned = 0;  // Faces with more than three corners, cut as a fan from the first.
  uint64_t triangles = 0;        // Triangles in the scene.
  uint64_t skipped_primitives = 0;  // Point and line elements: nothing to hit.

  // Dropped.
  uint64_t faces_too_few_corners = 0;  // Fewer than three corners.
  uint64_t faces_bad_index = 0;  // A corner out of range, zero where one is first, or unreadable.

  // Kept here and judged by the scene compiler (which drops what cannot be hit).
  uint64_t non_finite_vertices = 0;   // NaN, infinite or unreadable coordinates.
  uint64_t non_finite_triangles = 0;  // Triangles that use such a vertex.
  uint64_t degenerate_triangles = 0;  // Two corners at the same position.
  uint64_t zero_area_triangles =
      0;  // Flat to within rounding (mesh_checks.h), degenerate ones included.
  uint64_t duplicate_triangles =
      0;  // Copies of an earlier triangle: same three positions, any order.

  // True where the library in between keeps 32-bit floats, so that digits of the file may be lost.
  bool float_precision_loss = false;
  std::vector<std::string> warnings;  // One line each.

  friend bool operator==(const ImportReport&, const ImportReport&) = default;
};

struct ImportedScene {
  std::vector<ObjectInput> objects;
  ImportReport report;
};

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_IMPORT_TYPES_H_
