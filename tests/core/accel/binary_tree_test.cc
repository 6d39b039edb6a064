// SPDX-License-Identifier: Apache-2.0
#include "core/accel/binary_tree.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/mutex.h"
#include "core/base/parallel.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline::bvh_build {
namespace {

using testing_support::TestRng;

// One small triangle at each place.
SceneGeometry TrianglesAt(const std::vector<Vec3f>& places, float size) {
  SceneGeometry geometry;
  for (const Vec3f& p : places) {
    const auto first = static_cast<uint32_t>(geometry.vertices.size());
    for (const Vec3f& corner : {p, Vec3f{p.x + size, p.y, p.z}, Vec3f{p.x, p.y + size, p.z}}) {
      geometry.vertices.push_back(corner);
      geometry.bounds.Extend(corner);
    }
    geometry.triangles.push_back({first, first + 1, first + 2});
  }
  return geometry;
}

BinaryTree BuildTree(const SceneGeometry& geometry, const SahCost& cost,
                     const BinaryTreeOptions& options,
                     const std::function<void(double)>& progress = nullptr) {
  ThreadPool pool(2);
  BinaryTree tree;
  pool.ParallelFor(1, 1, [&](size_t, size_t) {
    tree = BuildGridTree(geometry, cost, options, nullptr, progress);
  });
  return tree;
}

// Inner nodes on the longest path; appends the leaves' ids.
int Depth(const BinaryTree& tree, uint32_t node, std::vector<uint32_t>& ids) {
  const BinaryNode& n = tree.nodes[node];
  if (n.wide.is_binary_leaf()) {
    ids.insert(ids.end(), &tree.ids[n.first], &tree.ids[n.first] + n.count);
    return 0;
  }
  return 1 + std::max(Depth(tree, n.first, ids), Depth(tree, n.first + 1, ids));
}

// Places whose distances from a corner halve and halve: each plane takes a few off.
TEST(GridTreeTest, NoPathIsTooLong) {
  TestRng rng;
  for (int i = 0; i < 40; ++i) {
    std::vector<Vec3f> places(20 + rng.Below(4000));
    for (Vec3f& p : places) {
      for (int axis = 0; axis < 3; ++axis) {
        p[axis] = static_cast<float>(std::exp2(rng.Uniform(-110, 0)));
      }
    }
    const SceneGeometry geometry = TrianglesAt(places, 0x1p-115f);
    const SahCost cost{.max_leaf_triangles = static_cast<int>(1 + rng.Below(4))};
    for (const bool cells : {false, true}) {
      const BinaryTreeOptions options{.bins = 8, .cells = cells, .full_leaves = true};
      std::vector<uint32_t> ids;
      EXPECT_LE(Depth(BuildTree(geometry, cost, options), 0, ids), options.max_depth)
          << places.size() << " triangles, leaves of " << cost.max_leaf_triangles;
      std::sort(ids.begin(), ids.end());
      ASSERT_EQ(ids.size(), places.size());
      for (uint32_t id = 0; id < ids.size(); ++id) ASSERT_EQ(ids[id], id);
    }
  }
}

// Crowds in the corners of a cube, each in a cell of the grid: of all sizes around those that count
// as placed by themselves, or are divided by cells.
TEST(GridTreeTest, ProgressEndsWithAll) {
  TestRng rng;
  for (const size_t crowd : {2'047u, 2'048u, 3'000u, 4'096u, 4'097u, 10'000u}) {
    for (const bool cells : {false, true}) {
      std::vector<Vec3f> places;
      for (int corner = 0; corner < 8; ++corner) {
        for (size_t i = 0; i < crowd; ++i) {
          Vec3f p;
          for (int axis = 0; axis < 3; ++axis) {
            p[axis] = static_cast<float>((corner >> axis & 1) + rng.Uniform(0, 1e-3));
          }
          places.push_back(p);
        }
      }
      Mutex mutex;
      double largest = 0;
      BuildTree(TrianglesAt(places, 1e-4f), {}, {.bins = 8, .cells = cells, .full_leaves = true},
                [&](double share) {
                  MutexLock lock(mutex);
                  largest = std::max(largest, share);
                });
      EXPECT_EQ(largest, 1.0) << crowd << (cells ? " by cells" : "");
    }
  }
}

}  // namespace
}  // namespace sightline::bvh_build
