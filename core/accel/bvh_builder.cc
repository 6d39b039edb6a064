// SPDX-License-Identifier: Apache-2.0
#include "core/accel/bvh_builder.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/accel/binary_tree.h"
#include "core/accel/build_primitive.h"
#include "core/accel/sah_split.h"
#include "core/accel/wide_tree.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

using bvh_build::BinaryTree;
using bvh_build::Box4;
using bvh_build::Primitive;

constexpr size_t kGrain = 1 << 14;
// More triangles than this cannot stand in leaves, however full.
constexpr uint64_t kMaxTriangles = (uint64_t{ChildRef::kMaxUnit} + 1) * kUnitTriangles;
// Share of the time that goes into the binary tree; the leaves' rows are the rest.
constexpr double kBinaryTreeShare = 0.9;

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

struct Primitives {
  AlignedVector<Primitive> list;  // Of the triangles that are not inert, in the order of their ids.
  Box4 bounds, centroids;
};

// Incomplete once `cancel` has fired.
Primitives MakePrimitives(const SceneGeometry& geometry, const CancelToken* cancel) {
  Primitives out;
  const size_t n = geometry.triangles.size();
  const std::vector<uint32_t>& inert = geometry.inert;
  out.list.ResizeUninitialized(n - inert.size());
  std::vector<std::pair<Box4, Box4>> boxes((n + kGrain - 1) / kGrain);
  ParallelFor(
      n, kGrain,
      [&](size_t begin, size_t end) {
        Box4 bounds, centroids;
        auto skip = std::lower_bound(inert.begin(), inert.end(), begin);
        Primitive* p = out.list.data() + (begin - static_cast<size_t>(skip - inert.begin()));
        for (size_t id = begin; id < end; ++id) {
          if (skip != inert.end() && *skip == id) {
            ++skip;
            continue;
          }
          const auto [a, b, c] = geometry.Corners(static_cast<uint32_t>(id));
          for (int axis = 0; axis < 3; ++axis) {
            p->lo[axis] = std::min(std::min(a[axis], b[axis]), c[axis]);
            p->hi[axis] = std::max(std::max(a[axis], b[axis]), c[axis]);
          }
          p->zero = 0;
          p->id = static_cast<uint32_t>(id);
          bounds.Extend(*p);
          centroids.Extend(p->centroid());
          ++p;
        }
        boxes[begin / kGrain] = {bounds, centroids};
      },
      cancel);
  for (const auto& [bounds, centroids] : boxes) {
    out.bounds.Extend(bounds);
    out.centroids.Extend(centroids);
  }
  return out;
}

// A power of two that brings the longest side of `bounds` to about 1: areas then reach neither the
// largest float nor, for anything that matters, the smallest.
float AreaScale(const Box4& bounds) {
  float longest = 0;
  for (int axis = 0; axis < 3; ++axis)
    longest = std::max(longest, bounds.hi[axis] - bounds.lo[axis]);
  if (!(longest > 0)) return 1.0f;
  return std::ldexp(1.0f, std::clamp(-std::ilogb(longest), -126, 126));
}

// On a thread of the pool.
absl::StatusOr<Bvh> Build(const SceneGeometry& geometry, const BvhBuildOptions& options,
                          const CancelToken* cancel, const std::function<void(double)>& progress) {
  const auto check_cancel = [cancel] {
    return cancel == nullptr ? absl::OkStatus() : cancel->ToStatus();
  };
  Primitives primitives = MakePrimitives(geometry, cancel);
  SL_RETURN_IF_ERROR(check_cancel());
  std::function<void(double)> tree_progress;
  if (progress) tree_progress = [&](double share) { progress(kBinaryTreeShare * share); };
  const bvh_build::SahCost cost{.max_leaf_triangles = options.max_leaf_triangles,
                                .node_visit = options.traversal_cost,
                                .area_scale = AreaScale(primitives.bounds)};
  BinaryTree tree = bvh_build::BuildBinaryTree(std::move(primitives.list), primitives.bounds,
                                               primitives.centroids, cost,
                                               {.bins = options.bins,
                                                .longest_axis_only = options.longest_axis_only,
                                                .max_depth = static_cast<int>(kMaxBvhDepth)},
                                               cancel, tree_progress);
  SL_RETURN_IF_ERROR(check_cancel());
  absl::StatusOr<Bvh> bvh = bvh_build::GatherWideTree(tree, geometry, cancel);
  SL_RETURN_IF_ERROR(check_cancel());
  if (progress) progress(1.0);
  return bvh;
}

}  // namespace

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
