// SPDX-License-Identifier: Apache-2.0
//
// Compiles a SceneGeometry from new objects and from objects of an earlier geometry, which keep
// their stored floats. CompileScene is the case without an earlier one; an edit is the other.
//
// Thread safety: functions only.
//
//   std::vector<ObjectSource> sources = {{.base_object = 0}, {.input = &chair}};
//   auto next = CompileSources(sources, &base, std::nullopt, limits, cancel);
#ifndef SIGHTLINE_CORE_MESH_SCENE_COMPILER_H_
#define SIGHTLINE_CORE_MESH_SCENE_COMPILER_H_

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/mesh/object.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

// What is pointed to must outlive the call.
struct ObjectSource {
  const ObjectInput* input = nullptr;  // A new object; if null, object `base_object` of the base.
  uint32_t base_object = 0;
  // If set, taken instead of the object's own. A new transform for an object of the base needs its
  // local doubles (REQUIRES: source_vertices, or `vertices` here).
  const Affine3d* transform = nullptr;
  const std::vector<Vec3d>* vertices = nullptr;  // As many as it has.
};

// As CompileScene says. With a `base`, its origin is kept and `origin` is not looked at.
// REQUIRES: base != null if a source has no input; base_object in range.
absl::StatusOr<SceneGeometry> CompileSources(std::span<const ObjectSource> sources,
                                             const SceneGeometry* base, std::optional<Vec3d> origin,
                                             const MeshLimits& limits, const CancelToken* cancel);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_SCENE_COMPILER_H_
