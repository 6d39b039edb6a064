// SPDX-License-Identifier: Apache-2.0
//
// What the options of leaf culling do to the counts of one fixed picture, and the size of packets:
// one that nobody reads would change none. The order of tests (aperture_first), the edge tests left
// out (skip_edges), the order of a node's rays (node_test) and `split` change the cost alone, which
// no count tells.
#include "core/traverse/leaf_culling.h"

#include <cstdint>

#include "core/accel/binary_bvh_builder.h"
#include "core/accel/kd_builder.h"
#include "core/query/tiles.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"

namespace sightline {
namespace {

using testing_support::MakeIcosphere;
using testing_support::MakeScene;
using testing_support::MakeTerrain;

constexpr uint32_t kSide = 96;

// A ball over waves, in leaves of many triangles.
const IndexedGeometry& Scene() {
  static const IndexedGeometry* const scene = [] {
    auto* made = new IndexedGeometry(
        MakeScene({MakeTerrain(24, 8, {-4, -4, -1}), MakeIcosphere(3, 1.5, Affine3d())}));
    ThreadPool pool(1);
    made->kd_tree =
        BuildKdTree(made->geometry, {.traversal_cost = 0.3f, .min_leaf_triangles = 12}, pool)
            .value();
    made->binary_bvh = BuildBinaryBvh(made->geometry, {.cost_ratio = 0.1f}, pool).value();
    return made;
  }();
  return *scene;
}

QueryStats Count(Strategy strategy, Structure structure, const LeafCulling& culling,
                 int packet_side = 16) {
  const Camera camera = testing_support::LookingDown({0, 0, 9}, 0.5, kSide);
  TileResult tile;
  const absl::Status status = TraceTile(Scene(), camera, {0, 0, kSide, kSide}, {}, {.ids = true},
                                        {.strategy = strategy,
                                         .structure = structure,
                                         .leaf_culling = culling,
                                         .packet_side = packet_side,
                                         .simd = SimdTarget::kAvx2},
                                        &tile);
  EXPECT_TRUE(status.ok()) << status;
  return tile.primary;
}

LeafCulling With(LeafCulling culling, bool LeafCulling::*option, bool on) {
  culling.*option = on;
  return culling;
}

const LeafCulling kNone = LeafCulling::None(), kAll;

TEST(LeafCullingTest, NothingIsLeftOutUnlessAsked) {
  for (const Strategy strategy : {Strategy::kPacket, Strategy::kSingle}) {
    for (const Structure structure : {Structure::kBvh, Structure::kKdTree, Structure::kBinaryBvh}) {
      EXPECT_EQ(Count(strategy, structure, kNone).culled_tests, 0u);
      EXPECT_GT(Count(strategy, structure, kAll).culled_tests, 0u);
    }
  }
}

TEST(LeafCullingTest, EachTestOfPacketsCulls) {
  const QueryStats none = Count(Strategy::kPacket, Structure::kBinaryBvh, kNone);
  for (bool LeafCulling::*const option :
       {&LeafCulling::side_planes, &LeafCulling::near_far, &LeafCulling::aperture}) {
    const QueryStats one =
        Count(Strategy::kPacket, Structure::kBinaryBvh, With(kNone, option, true));
    EXPECT_GT(one.culled_tests, 0u);
    EXPECT_LT(one.triangle_tests, none.triangle_tests);
  }
  const QueryStats masked =
      Count(Strategy::kPacket, Structure::kBinaryBvh, With(kNone, &LeafCulling::ray_mask, true));
  EXPECT_LT(masked.triangle_tests, none.triangle_tests);
}

TEST(LeafCullingTest, FewerRaysInTheFrustumCullMore) {
  uint64_t culled = 0;
  for (const FrustumRays rays : {FrustumRays::kAll, FrustumRays::kRows, FrustumRays::kMasked}) {
    LeafCulling culling;
    culling.frustum = rays;
    const uint64_t now = Count(Strategy::kPacket, Structure::kBinaryBvh, culling).culled_tests;
    EXPECT_GT(now, culled);
    culled = now;
  }
}

TEST(LeafCullingTest, TheLongestAxisCullsMoreThanTheFirst) {
  EXPECT_GT(
      Count(Strategy::kPacket, Structure::kBinaryBvh, kAll).culled_tests,
      Count(Strategy::kPacket, Structure::kBinaryBvh, With(kAll, &LeafCulling::first_axis, true))
          .culled_tests);
}

TEST(LeafCullingTest, SmallerPacketsVisitMoreNodes) {
  uint64_t nodes = UINT64_MAX;
  for (const int side : kPacketSides) {
    const uint64_t now = Count(Strategy::kPacket, Structure::kBinaryBvh, kAll, side).nodes;
    EXPECT_LT(now, nodes) << side;
    nodes = now;
  }
}

// From more triangles on than any leaf has: as without ray boxes.
TEST(LeafCullingTest, RayBoxesCullInLeavesThatAreLargeEnough) {
  const auto from = [](uint32_t triangles) {
    LeafCulling culling;
    culling.ray_box_min_triangles = triangles;
    return Count(Strategy::kSingle, Structure::kKdTree, culling);
  };
  EXPECT_GT(from(1).culled_tests, from(8).culled_tests);
  EXPECT_GT(from(8).culled_tests, from(1000).culled_tests);
  const QueryStats without =
      Count(Strategy::kSingle, Structure::kKdTree, With(kAll, &LeafCulling::ray_box, false));
  EXPECT_EQ(from(1000).culled_tests, without.culled_tests);
  EXPECT_EQ(from(1000).triangle_tests, without.triangle_tests);
  EXPECT_GT(Count(Strategy::kSingle, Structure::kBinaryBvh, kAll).culled_tests,
            Count(Strategy::kSingle, Structure::kBinaryBvh,
                  With(kAll, &LeafCulling::ray_box_update, false))
                .culled_tests);
}

TEST(LeafCullingTest, MailboxesSparePairsThatWereTested) {
  EXPECT_LT(Count(Strategy::kSingle, Structure::kKdTree, With(kNone, &LeafCulling::mailbox, true))
                .triangle_tests,
            Count(Strategy::kSingle, Structure::kKdTree, kNone).triangle_tests);
}

// Stored boxes leave out the empty cells around a leaf, so that fewer rays come to it.
TEST(LeafCullingTest, CellsAreLargerThanStoredBoxes) {
  for (const Strategy strategy : {Strategy::kPacket, Strategy::kSingle}) {
    EXPECT_GT(
        Count(strategy, Structure::kKdTree, With(kAll, &LeafCulling::cell_boxes, true)).leaves,
        Count(strategy, Structure::kKdTree, kAll).leaves);
  }
}

}  // namespace
}  // namespace sightline
