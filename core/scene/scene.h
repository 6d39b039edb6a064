// SPDX-License-Identifier: Apache-2.0
//
// One immutable revision of a scene: its compiled geometry and the structures built over it.
// Queries hold a shared_ptr to the revision they pinned; an edit builds a new one beside it.
//
// Thread safety: immutable after BuildScene.
//
//   absl::StatusOr<std::shared_ptr<const Scene>> scene =
//       BuildScene("hall", /*revision=*/1, objects, std::nullopt, SceneBuildOptions{}, pool);
#ifndef SIGHTLINE_CORE_SCENE_SCENE_H_
#define SIGHTLINE_CORE_SCENE_SCENE_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/accel/binary_bvh_builder.h"
#include "core/accel/bvh.h"
#include "core/accel/bvh_builder.h"
#include "core/accel/indexed_geometry.h"
#include "core/accel/kd_builder.h"
#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

struct BuildReport {
  MeshReport mesh;
  double compile_seconds = 0;  // Checking, rebasing, counting.
  double bvh_seconds = 0;      // All 0 without a BVH.
  uint64_t bvh_nodes = 0, bvh_leaves = 0, bvh_depth = 0;
  bool bvh_refitted = false;  // That of the revision before, fitted to vertices that moved.
  // All 0 without a kd-tree. Leaves that are not empty; references: ids in them.
  double kd_tree_seconds = 0;
  uint64_t kd_tree_nodes = 0, kd_tree_leaves = 0, kd_tree_references = 0, kd_tree_depth = 0;
  uint64_t kd_tree_bytes = 0;
  // All 0 without a binary BVH.
  double binary_bvh_seconds = 0;
  uint64_t binary_bvh_nodes = 0, binary_bvh_leaves = 0, binary_bvh_depth = 0, binary_bvh_bytes = 0;
  uint64_t memory_bytes = 0;  // Geometry and structures, and what else is held of a file in memory.
};

// What a report says of such a tree, but for the seconds.
void ReportKdTree(const KdTree& tree, BuildReport* report);
void ReportBinaryBvh(const BinaryBvh& bvh, BuildReport* report);

// Queries take the IndexedGeometry in it: the rooms below know no names and no revisions.
struct Scene : IndexedGeometry {
  std::string name;
  uint64_t revision = 0;
  BuildReport report;
};

struct SceneBuildOptions {
  BvhBuildOptions bvh;
  // A kd-tree beside the BVH. What it takes is bounded by what EstimateSceneBytes says, as by
  // KdBuildOptions::max_bytes: 180 bytes a triangle, 360 with perfect splits that cost less to walk
  // than the default, and more in proportion to max_references above its default. No ordinary tree
  // comes to that.
  std::optional<KdBuildOptions> kd_tree;
  std::optional<BinaryBvhOptions> binary_bvh = std::nullopt;  // A binary BVH beside it.
  // No BVH: the kd-tree stands alone (IndexedGeometry::kd_tree_alone). REQUIRES, else
  // InvalidArgument: kd_tree is set.
  bool without_bvh = false;
  MeshLimits limits;
  // Asked about the compiled geometry, before anything is built over it: its error is the build's.
  std::function<absl::Status(const SceneGeometry&)> accept = nullptr;
};

// An upper estimate of what a scene of this size, built so, will hold, for a budget checked before
// building, which takes up to about as much again while it lasts.
uint64_t EstimateSceneBytes(uint64_t triangles, uint64_t vertices,
                            const SceneBuildOptions& options = {});
// What so many objects add to that, whose names have so many bytes together.
uint64_t EstimateObjectBytes(uint64_t objects, uint64_t name_bytes);

absl::StatusOr<std::shared_ptr<const Scene>> BuildScene(
    std::string name, uint64_t revision, std::span<const ObjectInput> objects,
    std::optional<Vec3d> origin, const SceneBuildOptions& options, ThreadPool& pool,
    const CancelToken* cancel = nullptr, const std::function<void(double)>& progress = nullptr);

// One step of an edit. Steps apply in order to the objects of the revision before.
struct SceneEdit {
  enum class Kind : uint8_t { kAdd, kRemove, kSetTransform, kSetVertices };
  Kind kind = Kind::kAdd;
  ObjectInput object;  // kAdd: the whole object. Others: name, and `transform` or `vertices` as the
                       // kind says.
};

// The revision after `base` with `edits` applied; keeps the base's origin. With
// `options.bvh.refit`, edits that only move vertices (kSetTransform, kSetVertices) keep the base's
// tree, fitted to them, unless a triangle lost or gained its area or the tree would cost
// kMaxRefitGrowth times what it did when it was built (core/accel/bvh_refit.h). Errors, each naming
// the object: NotFound (no such object), AlreadyExists (added twice), FailedPrecondition
// (kSetTransform of an object that is not dynamic), InvalidArgument (another number of vertices
// than the object has; what CompileScene says).
absl::StatusOr<std::shared_ptr<const Scene>> EditScene(
    const Scene& base, uint64_t revision, std::span<const SceneEdit> edits,
    const SceneBuildOptions& options, ThreadPool& pool, const CancelToken* cancel = nullptr,
    const std::function<void(double)>& progress = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_SCENE_SCENE_H_
