// SPDX-License-Identifier: Apache-2.0
#include "core/accel/bvh_builder.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/accel/area_scale.h"
#include "core/accel/binary_tree.h"
#include "core/accel/build_primitive.h"
#include "core/accel/leaf_mates_finder.h"
#include "core/accel/sah_split.h"
#include "core/accel/wide_tree.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

using bvh_build::BinaryTree;

// More triangles than this cannot stand in leaves, however full.
constexpr uint64_t kMaxTriangles = (uint64_t{ChildRef::kMaxUnit} + 1) * kUnitTriangles;
// Share of the time that goes into the binary tree; the leaves' rows are the rest.
constexpr double kBinaryTreeShare = 0.9;
constexpr int kDynamicBins = 8;  // Paper 004: more bring nothing to a scene that is built anew.

absl::Status ValidateOptions(const BvhBuildOptions& options) {
  if (options.bins < 2 || options.bins > bvh_build::kMaxBins) {
    return absl::InvalidArgumentError(
        absl::StrCat("bins = ", options.bins, " is outside 2 .. ", bvh_build::kMaxBins));
  }
  if (options.max_leaf_triangles < 1 || options.max_leaf_triangles > kMaxLeafTriangles) {
    return absl::InvalidArgumentError(
        absl::StrCat("max_leaf_triangles = ", options.max_leaf_triangles, " is outside 1 .. ",
                     kMaxLeafTriangles));
  }
  if (!(options.traversal_cost >= 0 && options.traversal_cost <= kMaxTraversalCost)) {
    return absl::InvalidArgumentError(absl::StrCat("traversal_cost = ", options.traversal_cost,
                                                   " is outside 0 .. ", kMaxTraversalCost));
  }
  return absl::OkStatus();
}

// On a thread of the pool.
absl::StatusOr<Bvh> Build(const SceneGeometry& geometry, const BvhBuildOptions& options,
                          const CancelToken* cancel, const std::function<void(double)>& progress) {
  const auto check_cancel = [cancel] {
    return cancel == nullptr ? absl::OkStatus() : cancel->ToStatus();
  };
  std::function<void(double)> tree_progress;
  if (progress) tree_progress = [&](double share) { progress(kBinaryTreeShare * share); };
  const bvh_build::SahCost cost{.max_leaf_triangles = options.max_leaf_triangles,
                                .node_visit = options.traversal_cost,
                                .area_scale = AreaScale(geometry.bounds)};
  const bvh_build::BinaryTreeOptions tree_options{.bins = options.bins,
                                                  .longest_axis_only = options.longest_axis_only,
                                                  .cells = options.grid,
                                                  .full_leaves = options.full_leaves,
                                                  .max_depth = static_cast<int>(kMaxBvhDepth)};
  const auto build_tree = options.grid ? bvh_build::BuildGridTree : bvh_build::BuildBinaryTree;
  BinaryTree tree = build_tree(geometry, cost, tree_options, cancel, tree_progress);
  SL_RETURN_IF_ERROR(check_cancel());
  absl::StatusOr<Bvh> bvh = bvh_build::GatherWideTree(tree, geometry, options.leaf_rows, cancel);
  SL_RETURN_IF_ERROR(check_cancel());
  if (options.mates && bvh.ok()) {
    bvh->mates = FindLeafMates(*bvh, geometry, cancel);
    SL_RETURN_IF_ERROR(check_cancel());
  }
  if (progress) progress(1.0);
  return bvh;
}

}  // namespace

BvhBuildOptions BvhPresetOptions(BvhPreset preset) {
  switch (preset) {
    case BvhPreset::kStatic:
      return {};
    case BvhPreset::kCompact:
      return {.leaf_rows = false, .mates = false};
    case BvhPreset::kDynamic:
      return {.bins = kDynamicBins,
              .longest_axis_only = true,
              .grid = true,
              .mates = false,
              .refit = true};
  }
  return {};
}

absl::StatusOr<Bvh> BuildBvh(const SceneGeometry& geometry, const BvhBuildOptions& options,
                             ThreadPool& pool, const CancelToken* cancel,
                             const std::function<void(double)>& progress) {
  SL_RETURN_IF_ERROR(ValidateOptions(options));
  const uint64_t triangles = geometry.triangles.size() - geometry.inert.size();
  if (triangles == 0) return Bvh{};
  if (triangles > kMaxTriangles) {
    return absl::ResourceExhaustedError(absl::StrCat("the scene has ", triangles,
                                                     " triangles; a BVH holds at most ",
                                                     kMaxTriangles, ": split the scene"));
  }
  absl::StatusOr<Bvh> bvh;
  // One block: the calling thread enters the pool, and everything below runs within it.
  pool.ParallelFor(1, 1, [&](size_t, size_t) { bvh = Build(geometry, options, cancel, progress); });
  return bvh;
}

}  // namespace sightline
