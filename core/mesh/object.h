// SPDX-License-Identifier: Apache-2.0
//
// What a caller hands in to make a scene: objects with a name, world-space double vertices,
// triangle indices and per-object flags. Plain data without invariants; CompileScene
// (scene_geometry.h) checks it.
//
// Thread safety: plain values.
//
//   ObjectInput floor{.name = "floor", .vertices = {...}, .indices = {0, 1, 2, 0, 2, 3}};
#ifndef SIGHTLINE_CORE_MESH_OBJECT_H_
#define SIGHTLINE_CORE_MESH_OBJECT_H_

#include <cstdint>
#include <string>
#include <vector>

#include "core/geometry/affine.h"
#include "core/geometry/vec3.h"

namespace sightline {

// Which triangles of an object block, as seen from the segment's origin (the eye, the light or
// `from`). The front of triangle ABC is the side from which A, B, C run counter-clockwise.
enum class Culling : uint8_t {
  kNone = 0,   // Two-sided (the default).
  kBack = 1,   // Back faces do not block.
  kFront = 2,  // Front faces do not block.
};

struct ObjectInput {
  std::string name;  // UTF-8, unique within a scene; empty names are numbered "object-<i>".
  std::vector<Vec3d> vertices;    // Local coordinates; `transform` places them in the world.
  std::vector<uint32_t> indices;  // Three per triangle.
  Affine3d transform;
  uint32_t mask = 0xFFFFFFFFu;  // An object is seen when (object & query & light mask) != 0.
  Culling culling = Culling::kNone;
  // Keeps the local doubles in the scene, so that later revisions can change the transform.
  bool dynamic = false;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_OBJECT_H_
