// SPDX-License-Identifier: Apache-2.0
//
// What checking a tree takes is what is set aside for it, and not several times that.
#include <cstdint>

#include "absl/strings/str_cat.h"
#include "core/accel/kd_builder.h"
#include "core/accel/kd_validation.h"
#include "core/base/parallel.h"
#include "gtest/gtest.h"
#include "tests/core/accel/test_meshes.h"
#include "tests/support/failing_new.h"

namespace sightline {
namespace {

using testing_support::HeldByNew;
using testing_support::ScatteredTriangles;
using testing_support::TestRng;

TEST(ValidationMemoryTest, OfAKdTreeIsWhatWasForetold) {
  TestRng rng;
  ThreadPool pool(2);
  for (const size_t n : {10, 1'000, 20'000, 100'000}) {
    const SceneGeometry geometry = ScatteredTriangles(rng, n, 0.02);
    for (const bool perfect : {false, true}) {
      for (const float cost : {0.3f, 3.0f}) {  // Deep trees, and leaves of many.
        SCOPED_TRACE(absl::StrCat(n, " triangles, ", perfect ? "perfect, " : "", cost));
        const auto tree =
            BuildKdTree(geometry, {.traversal_cost = cost, .perfect_splits = perfect}, pool);
        ASSERT_TRUE(tree.ok()) << tree.status();
        absl::Status status;
        const HeldByNew held;
        pool.ParallelFor(1, 1, [&](size_t, size_t) { status = ValidateKdTree(*tree, geometry); });
        const auto most = static_cast<uint64_t>(held.most());
        EXPECT_TRUE(status.ok()) << status;
        EXPECT_LE(most, KdValidationBytes(n, tree->nodes.size(), tree->ids.size(), tree->perfect(),
                                          pool.threads()));
        // Four numbers for each triangle and each reference, but for what one thread takes apart.
        const uint64_t apart = 4 << 20, nodes = tree->nodes.size() * (perfect ? 40 : 10);
        EXPECT_LE(most, 17 * (n + tree->ids.size()) + nodes + apart);
      }
    }
  }
}

}  // namespace
}  // namespace sightline
