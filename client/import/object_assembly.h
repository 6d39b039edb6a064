// SPDX-License-Identifier: Apache-2.0
//
// From a reader's raw arrays to objects: each object gets the vertices that it uses, and a name
// that is fit for the wire and unique.
//
// Thread safety: free functions; a VertexCompactor belongs to one thread.
//
//   VertexCompactor compactor(&pool);
//   scene.objects.push_back(compactor.MakeObject("roof", global_indices));
//   FinishNames("city", &scene.objects);
#ifndef SIGHTLINE_CLIENT_IMPORT_OBJECT_ASSEMBLY_H_
#define SIGHTLINE_CLIENT_IMPORT_OBJECT_ASSEMBLY_H_

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/mesh/object.h"

namespace sightline {

// Hands out the used part of one pool of vertices, object by object, in time proportional to the
// object.
class VertexCompactor {
 public:
  explicit VertexCompactor(const std::vector<Vec3d>* pool) : pool_(pool) {}

  // Vertices in the order in which `indices` first name them.
  // REQUIRES: every index is below the pool's size.
  ObjectInput MakeObject(std::string name, std::span<const uint32_t> indices);

 private:
  const std::vector<Vec3d>* const pool_;
  // Of the pool's vertex v: the object that last used it, and its number there.
  struct Slot {
    uint32_t object = 0;
    uint32_t local = 0;
  };
  std::vector<Slot> slots_;
  uint32_t objects_ = 0;
};

// Longest name kept, in bytes; the rest is cut at a character's border.
inline constexpr size_t kMaxNameBytes = 512;

// The text with malformed UTF-8 and control characters replaced by U+FFFD, blanks trimmed, cut to
// kMaxNameBytes.
std::string CleanName(std::string_view raw);

// Cleans every name, gives nameless objects the fallback's, and numbers repeats: "leg", "leg (2)",
// ...
void FinishNames(std::string_view fallback, std::vector<ObjectInput>* objects);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_OBJECT_ASSEMBLY_H_
