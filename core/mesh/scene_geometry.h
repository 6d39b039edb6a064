// SPDX-License-Identifier: Apache-2.0
//
// A scene's compiled geometry: every object's triangles in one list, as floats relative to the
// scene's own double origin. This is what "stored" means everywhere else: all answers are exact
// statements about these floats.
//
// Invariants of a SceneGeometry made by CompileScene:
//  1. Triangles are numbered object by object, in input order;
//     ids are stable: a triangle that cannot block (non-finite
//     corner, zero area) keeps its id and is listed in `inert`
//     instead of being dropped. So the order of ids is the order
//     of (object, triangle), and ties go to the lowest id.
//  2. Every index is in range; every coordinate of a triangle that is not inert has |x| <= 2^40.
//  3. Equal input doubles under equal transforms give equal floats: shared vertices stay shared.
//  4. No stored coordinate is -0, so equal positions have
//     equal bits. A vertex that was not finite is stored as
//     three NaNs, and no finite one is.
//  5. There are at most kMaxGeometryItems triangles, and at most as many vertices.
//
// Thread safety: immutable after construction, shared freely.
//
//   absl::StatusOr<SceneGeometry> geometry = CompileScene(objects, /*origin=*/std::nullopt, {});
#ifndef SIGHTLINE_CORE_MESH_SCENE_GEOMETRY_H_
#define SIGHTLINE_CORE_MESH_SCENE_GEOMETRY_H_

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "core/base/aligned_vector.h"
#include "core/base/cancel.h"
#include "core/geometry/affine.h"
#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"
#include "core/mesh/object.h"

namespace sightline {

inline constexpr uint32_t kNoTriangle = 0xFFFFFFFFu;
// The largest |coordinate|, stored or in the world: what the predicate's float stage can take.
inline constexpr double kMaxCoordinate = 1099511627776.0;  // 2^40
// The most triangles, and the most vertices, of any scene, whatever its limits say: walks fetch the
// three numbers of each by 32-bit offsets with a sign (core/traverse/ready_triangles-inl.h).
inline constexpr uint64_t kMaxGeometryItems = 715'827'882;  // (2^31 - 1) / 3

struct ObjectRecord {
  std::string name;
  uint32_t first_triangle = 0, triangle_count = 0;
  uint32_t first_vertex = 0, vertex_count = 0;
  uint32_t mask = 0xFFFFFFFFu;
  Culling culling = Culling::kNone;
  Affine3d transform;
  double largest_rounding = 0;  // As in MeshReport, of this object's vertices.
  // Local doubles of a `dynamic` object, for later transforms; null otherwise.
  std::shared_ptr<const std::vector<Vec3d>> source_vertices;
};

// What was wrong with the input, and what became of it. Nothing is dropped silently.
struct MeshReport {
  uint64_t triangles = 0;  // As handed in.
  uint64_t vertices = 0;
  uint64_t non_finite_vertices = 0;
  uint64_t non_finite_triangles = 0;  // Inert: at least one corner is not finite.
  uint64_t zero_area_triangles = 0;   // Inert: exactly zero area after rounding to stored floats.
  uint64_t duplicate_triangles = 0;   // Same three stored positions as an earlier one (any order).
                                      // Kept. Inert ones are not looked at.
  uint64_t inert_triangles = 0;       // non_finite + zero_area.
  double largest_rounding =
      0;  // Largest |world − (origin + stored)| of a coordinate of a finite vertex.
};

struct SceneGeometry {
  Vec3d origin;
  AlignedVector<Vec3f> vertices;                     // Relative to origin.
  AlignedVector<std::array<uint32_t, 3>> triangles;  // Into `vertices`.
  std::vector<ObjectRecord> objects;                 // Sorted by first_triangle.
  AlignedVector<uint32_t> inert;                     // Ids that never block, ascending.
  Box3f bounds;                                      // Of the triangles that are not inert.
  // True when every object has the full mask and no culling: no hit needs a look at its object.
  bool uniform = true;
  MeshReport report;

  // The object that owns triangle `id`. REQUIRES: id < triangles.size().
  uint32_t ObjectOf(uint32_t id) const;
  std::array<Vec3f, 3> Corners(uint32_t id) const {
    const auto& t = triangles[id];
    return {vertices[t[0]], vertices[t[1]], vertices[t[2]]};
  }
  size_t MemoryBytes() const;
};

struct MeshLimits {  // Above kMaxGeometryItems: as that, for triangles and vertices.
  uint64_t max_triangles = 200'000'000;
  uint64_t max_vertices = 600'000'000;
  uint64_t max_objects = 1'000'000;
};

// Checks and compiles `objects`. `origin` is given, or else the first finite vertex of the first
// object that has one, placed in the world (the zero vector for a scene without vertices).
//  - An index out of range, a number of indices that 3 does not
//    divide, a name that is doubled or not UTF-8, a non-finite
//    transform or origin, a finite coordinate beyond
//    kMaxCoordinate: InvalidArgument naming object, position and value.
//  - More triangles, vertices or objects than the limits, or more triangles or vertices than
//    kMaxGeometryItems: ResourceExhausted naming the limit and its value.
//  - Non-finite vertices, zero-area and duplicate triangles: counted in the report.
//  - Cancelled or DeadlineExceeded once `cancel` has fired.
// A stored vertex is fl32(world − origin), the subtraction in double. An object without a name is
// called "object-<its position>", or by the next number that is free. Runs in parallel within the
// pool of the calling thread (core/base/parallel.h), whatever that thread's floating-point state.
absl::StatusOr<SceneGeometry> CompileScene(std::span<const ObjectInput> objects,
                                           std::optional<Vec3d> origin, const MeshLimits& limits,
                                           const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_SCENE_GEOMETRY_H_
