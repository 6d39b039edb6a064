// SPDX-License-Identifier: Apache-2.0
#include "core/accel/binary_tree.h"

#include <algorithm>
#include <vector>

#include "core/accel/range_builder.h"
#include "core/base/check.h"
#include "core/base/parallel.h"

namespace sightline::bvh_build {
namespace {

constexpr size_t kGrain = 1 << 14;

// Fills `primitives` with the triangles that are not inert, by id; their boxes into `range`.
// Incomplete once `cancel` has fired.
void MakePrimitives(const SceneGeometry& geometry, const CancelToken* cancel, Primitive* primitives,
                    RangeBuilder::Range& range) {
  const size_t n = geometry.triangles.size();
  const AlignedVector<uint32_t>& inert = geometry.inert;
  std::vector<std::pair<BuildBox, BuildBox>> boxes((n + kGrain - 1) / kGrain);
  ParallelFor(
      n, kGrain,
      [&](size_t begin, size_t end) {
        BuildBox bounds, centroids;
        auto skip = std::lower_bound(inert.begin(), inert.end(), begin);
        Primitive* p = primitives + (begin - static_cast<size_t>(skip - inert.begin()));
        for (size_t id = begin; id < end; ++id) {
          if (skip != inert.end() && *skip == id) {
            ++skip;
            continue;
          }
          *p = MakePrimitive(geometry, static_cast<uint32_t>(id));
          bounds.Extend(*p);
          centroids.Extend(p->centroid());
          ++p;
        }
        boxes[begin / kGrain] = {bounds, centroids};
      },
      cancel);
  for (const auto& [bounds, centroids] : boxes) {
    range.bounds.Extend(bounds);
    range.centroids.Extend(centroids);
  }
}

}  // namespace

BinaryTree BuildBinaryTree(const SceneGeometry& geometry, const SahCost& cost,
                           const BinaryTreeOptions& options, const CancelToken* cancel,
                           const std::function<void(double)>& progress) {
  const size_t n = geometry.triangles.size() - geometry.inert.size();
  SIGHTLINE_CHECK_GT(n, 0u);
  BinaryTree tree;
  tree.ids.ResizeUninitialized(n);
  AlignedVector<Primitive> primitives[2];
  for (auto& buffer : primitives) buffer.ResizeUninitialized(n);
  RangeBuilder::Range all{.end = n};
  MakePrimitives(geometry, cancel, primitives[0].data(), all);
  if (cancel != nullptr && cancel->cancelled()) return tree;
  RangeBuilder builder(tree, n, 1, cost, options, cancel, progress);
  RangeBuilder::NodeBlock block;
  const uint32_t root = builder.AllocatePair(block);
  SIGHTLINE_CHECK_EQ(root, 0u);
  builder.Build({{primitives[0].data(), primitives[1].data()}, tree.ids.data(), 0}, all, root, 1,
                block);
  return tree;
}

}  // namespace sightline::bvh_build
