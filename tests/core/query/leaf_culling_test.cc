// SPDX-License-Identifier: Apache-2.0
//
// What the options of leaf culling do to the counts of one fixed picture, and the size of packets:
// one that nobody reads would change none. And that perfect splits, whose cells bound no distance,
// neither make closest hits look through the whole scene nor lose one; and that leaves without an
// extent along an axis are culled in as others are.
#include "core/traverse/leaf_culling.h"

#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/accel/binary_bvh_builder.h"
#include "core/accel/kd_builder.h"
#include "core/light/light.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "core/traverse/culled_kernels.h"
#include "core/traverse/kernels.h"
#include "core/traverse/trace_ray.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"

namespace sightline {
namespace {

using testing_support::MakeIcosphere;
using testing_support::MakeScene;
using testing_support::MakeTerrain;

constexpr uint32_t kCulledSide = 96;

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
  const Camera camera = testing_support::LookingDown({0, 0, 9}, 0.5, kCulledSide);
  TileResult tile;
  const absl::Status status =
      TraceTile(Scene(), camera, {0, 0, kCulledSide, kCulledSide}, {}, {.ids = true},
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

// A floor perpendicular to an axis: every leaf's box is flat along it.
IndexedGeometry MakeFlatScene(int axis) {
  constexpr int kCells = 12;
  ObjectInput floor;
  for (int y = 0; y <= kCells; ++y) {
    for (int x = 0; x <= kCells; ++x) {
      Vec3d p;
      p[axis] = 1;
      p[(axis + 1) % 3] = 0.5 * x - 3;
      p[(axis + 2) % 3] = 0.5 * y - 3;
      floor.vertices.push_back(p);
      if (x == kCells || y == kCells) continue;
      const auto at = static_cast<uint32_t>(y * (kCells + 1) + x);
      for (const uint32_t corner :
           {at, at + 1, at + kCells + 1, at + 1, at + kCells + 2, at + kCells + 1}) {
        floor.indices.push_back(corner);
      }
    }
  }
  IndexedGeometry scene = MakeScene({floor});
  ThreadPool pool(1);
  scene.kd_tree =
      BuildKdTree(scene.geometry, {.traversal_cost = 0.3f, .min_leaf_triangles = 12}, pool).value();
  scene.binary_bvh = BuildBinaryBvh(scene.geometry, {.cost_ratio = 0.1f}, pool).value();
  EXPECT_EQ(scene.kd_tree->bounds.lo[axis], scene.kd_tree->bounds.hi[axis]);
  return scene;
}

// Paper 000 widens such cells, since it divides by the distance of their faces. Here nothing is:
// looked at from ahead, at a slant, and from within the plane, which no ray meets.
TEST(LeafCullingTest, FlatLeavesNeedNoWidening) {
  for (int axis = 0; axis < 3; ++axis) {
    const IndexedGeometry scene = MakeFlatScene(axis);
    for (const double height : {5.0, 0.25, 0.0, -3.0}) {
      Vec3d eye = {-2.5, -2, -1.5}, at = {0.5, 0.25, -0.5};
      eye[axis] = 1 + height;
      at[axis] = 1;
      const absl::StatusOr<Camera> camera = LookAt(eye, at, {0.3, 0.5, 0.7}, 80, 40, 40);
      ASSERT_TRUE(camera.ok()) << camera.status();
      const TileOutputs outputs = {.ids = true, .depth = true};
      const auto trace = [&](const QueryOptions& options) {
        TileResult tile;
        const absl::Status status =
            TraceTile(scene, *camera, {0, 0, 40, 40}, {}, outputs, options, &tile);
        EXPECT_TRUE(status.ok()) << status;
        return tile;
      };
      const TileResult truth = trace({.strategy = Strategy::kBruteForce});
      uint64_t culled = 0;
      for (const Structure structure :
           {Structure::kBvh, Structure::kKdTree, Structure::kBinaryBvh}) {
        for (const FrustumRays rays : kAllFrustumRays) {
          for (const NodeTest nodes : kAllNodeTests) {
            for (const bool cells : {false, true}) {
              LeafCulling culling;
              culling.frustum = rays;
              culling.node_test = nodes;
              culling.cell_boxes = cells;
              const TileResult tile = trace({.strategy = Strategy::kPacket,
                                             .structure = structure,
                                             .leaf_culling = culling,
                                             .packet_side = 8});
              for (size_t i = 0; i < truth.triangle.size(); ++i) {
                ASSERT_EQ(tile.triangle[i], truth.triangle[i]) << axis << ", " << height;
                ASSERT_EQ(tile.depth[i], truth.depth[i]) << axis << ", " << height;
              }
              culled += tile.primary.culled_tests;
            }
          }
        }
      }
      EXPECT_GT(culled, 0u);
    }
  }
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

// Packets of a sun's rays have no leaf culling, no other tree than the BVH, no other test than the
// predicate and no first hits: there they are single rays, culled as those are. A light's stay.
TEST(LeafCullingTest, SunsAreSingleRaysAndLightsArePackets) {
  PreparedPoints points;
  for (int i = 0; i < 256; ++i) {
    points.positions.push_back(ToFloat(Vec3d{0.2 * (i % 16) - 1.5, 0.2 * (i / 16) - 1.5, 4}));
    points.sources.push_back(kNoTriangle);
    points.valid.push_back(true);
  }
  const auto shade = [&](const Light& light, const QueryOptions& options, bool first) {
    std::vector<LightSample> samples;
    EXPECT_TRUE(AppendSamples(light, 0, {}, &samples).ok());
    ShadowResult result;
    const absl::Status status =
        ComputeShadows(Scene(), PointRange::All(points), samples, {}, {},
                       {.bits = true, .blockers = first, .answered_by = true}, options, &result);
    EXPECT_TRUE(status.ok()) << status;
    return result;
  };
  const Light below = Light::Point({0, 0, -3}), sun = Light::Directional({0.1, 0, -1});
  for (const Structure structure : {Structure::kBvh, Structure::kKdTree, Structure::kBinaryBvh}) {
    for (const bool culls : {false, true}) {
      for (const Intersector test : {Intersector::kExact, Intersector::kWald}) {
        for (const bool first : {false, true}) {
          QueryOptions options = {.strategy = Strategy::kPacket, .structure = structure};
          if (culls) options.leaf_culling = kAll;
          options.intersector = test;
          options.simd = SimdTarget::kAvx2;
          SCOPED_TRACE(absl::StrCat(StructureName(structure), culls ? " culls" : "", first,
                                    IntersectorName(test)));
          EXPECT_THAT(shade(below, options, first).answered_by, testing::Each(AnsweredBy::kPacket));
          const bool together =
              structure == Structure::kBvh && !culls && !first && test == Intersector::kExact;
          const ShadowResult packets = shade(sun, options, first);
          EXPECT_THAT(packets.answered_by,
                      testing::Each(together ? AnsweredBy::kPacket : AnsweredBy::kRay));
          if (together) continue;
          options.strategy = Strategy::kSingle;
          const ShadowResult single = shade(sun, options, first);
          EXPECT_EQ(packets.stats.triangle_tests, single.stats.triangle_tests);
          EXPECT_EQ(packets.stats.culled_tests, single.stats.culled_tests);
          EXPECT_EQ(single.stats.culled_tests > 0, culls);
        }
      }
    }
  }
}

// Stored boxes leave out the empty cells around a leaf, so that fewer rays come to it.
TEST(LeafCullingTest, CellsAreLargerThanStoredBoxes) {
  for (const Strategy strategy : {Strategy::kPacket, Strategy::kSingle}) {
    EXPECT_GT(
        Count(strategy, Structure::kKdTree, With(kAll, &LeafCulling::cell_boxes, true)).leaves,
        Count(strategy, Structure::kKdTree, kAll).leaves);
  }
}

// ---- What only a walk's own counts tell

// Packets of side × side rays, 64 × 64 in all. `direction` of column and row, both in -1 .. 1.
// `same_as_brute_force`: answers are compared with brute force's.
template <typename Fn>
WalkStats Walk(const LeafCulling& culling, int side, Vec3f eye, const Fn& direction,
               bool same_as_brute_force = false) {
  WalkStats stats;
  const auto packet = std::make_unique<RayPacket>();
  packet->origin = eye;
  packet->segments = false;
  packet->count = side * side;
  const int packets = 64 / side;
  for (int p = 0; p < packets * packets; ++p) {
    for (int i = 0; i < packet->count; ++i) {
      const int x = p % packets * side + i % side, y = p / packets * side + i / side;
      const Vec3f d =
          direction((static_cast<float>(x) - 31.5f) / 32, (static_cast<float>(y) - 31.5f) / 32);
      packet->target_x[i] = d.x;
      packet->target_y[i] = d.y;
      packet->target_z[i] = d.z;
      packet->target_source[i] = kNoTriangle;
    }
    EXPECT_TRUE(CulledKernelsFor(SimdTarget::kAvx2)
                    .closest_packet(Scene(), culling, *packet, nullptr, &stats));
    for (int i = 0; same_as_brute_force && i < packet->count; ++i) {
      const TraceRay ray = packet->trace_ray(i);
      Hit truth;
      WalkStats unread;
      EXPECT_TRUE(KernelsFor(SimdTarget::kAvx2)
                      .closest_brute(Scene(), {&ray, 1}, {&truth, 1}, nullptr, &unread));
      EXPECT_EQ(packet->triangle[i], truth.triangle);
      EXPECT_EQ(packet->t[i], truth.t);
    }
  }
  return stats;
}

// From above.
WalkStats WalkDown(const LeafCulling& culling, int side, bool same_as_brute_force = false) {
  return Walk(
      culling, side, {0.03f, 0.05f, 9},
      [](float x, float y) {
        return Vec3f{0.4f * x, 0.4f * y, -1};
      },
      same_as_brute_force);
}

// The same triangles are left over, whichever test comes first; more come to the first.
TEST(LeafCullingTest, TheOrderOfTestsDecidesHowManyComeToEach) {
  LeafCulling planes_first;
  planes_first.side_planes = false;  // They would leave little to the others.
  LeafCulling aperture_first = planes_first;
  aperture_first.aperture_first = true;
  const WalkStats a = WalkDown(planes_first, 4), b = WalkDown(aperture_first, 4);
  EXPECT_LT(a.aperture_tests, b.aperture_tests);
  EXPECT_EQ(a.triangle_tests, b.triangle_tests);
  EXPECT_EQ(a.culled_tests, b.culled_tests);
  EXPECT_EQ(WalkDown(kNone, 16).aperture_tests, 0u);
}

// Of the papers' tests, too, whose distances alone are asked for then.
TEST(LeafCullingTest, EdgesAreSparedWhereAllCornerRaysAreInside) {
  for (const Intersector intersector :
       {Intersector::kExact, Intersector::kHavelHerout, Intersector::kHavelHeroutDivided,
        Intersector::kWald, Intersector::kShevtsov, Intersector::kKenslerShirley,
        Intersector::kMoellerTrumbore}) {
    SCOPED_TRACE(IntersectorName(intersector));
    LeafCulling spares, tests;
    spares.intersector = tests.intersector = intersector;
    tests.skip_edges = false;
    const WalkStats a = WalkDown(spares, 2), b = WalkDown(tests, 2);
    EXPECT_GT(a.edges_spared, a.triangle_tests / 50);
    EXPECT_EQ(b.edges_spared, 0u);
    EXPECT_EQ(a.triangle_tests, b.triangle_tests);
  }
}

// A frustum of the rays that meet a leaf's box settles the edges of those, and of no others, though
// registers are asked about whole.
TEST(LeafCullingTest, EdgesAreSparedWithoutARayMaskToo) {
  for (const Intersector intersector : {Intersector::kExact, Intersector::kHavelHerout}) {
    SCOPED_TRACE(IntersectorName(intersector));
    for (const FrustumRays rays : kAllFrustumRays) {
      for (const CulledTree tree : {CulledTree::kBinaryBvh, CulledTree::kKdTree}) {
        SCOPED_TRACE(absl::StrCat(static_cast<int>(rays), " ", static_cast<int>(tree)));
        LeafCulling spares;
        spares.tree = tree;
        spares.intersector = intersector;
        spares.frustum = rays;
        spares.ray_mask = false;
        LeafCulling tests = spares;
        tests.skip_edges = false;
        for (const int side : {2, 4}) {
          const WalkStats a = WalkDown(spares, side, intersector == Intersector::kExact),
                          b = WalkDown(tests, side);
          if (side == 2) {
            EXPECT_GT(a.edges_spared, a.triangle_tests / 100);
          }
          EXPECT_EQ(b.edges_spared, 0u);
          // What is left out of such tests counts as culled. (On the kd-tree a triangle may be hit
          // beyond the leaf, and the walk end sooner for it.)
          if (tree == CulledTree::kKdTree || intersector != Intersector::kExact) continue;
          EXPECT_EQ(a.triangle_tests + a.culled_tests, b.triangle_tests + b.culled_tests);
        }
      }
    }
  }
}

// Each way comes to the same nodes, by fewer and fewer tests of boxes.
TEST(LeafCullingTest, NodeTestsSpareTestsOfBoxes) {
  uint64_t tests = UINT64_MAX, nodes = 0;
  for (const NodeTest test : {NodeTest::kAllRays, NodeTest::kFirstActive, NodeTest::kCorners}) {
    LeafCulling culling;
    culling.node_test = test;
    const WalkStats now = WalkDown(culling, 16);
    EXPECT_LT(now.box_tests, tests) << static_cast<int>(test);
    tests = now.box_tests;
    if (nodes != 0) {
      EXPECT_EQ(now.nodes, nodes);
    }
    nodes = now.nodes;
  }
}

// From amid the scene: packets whose rays go both ways along each axis, but halves up or down.
TEST(LeafCullingTest, PacketsWithoutAnAxisArePartedOrGoRayByRay) {
  LeafCulling halves, rays;
  rays.split = PacketSplit::kSingleRays;
  const auto around = [](float x, float y) {
    const int row = static_cast<int>(std::lround(32 * y + 31.5f));
    return Vec3f{0.3f * std::sin(40 * x), 0.3f * std::sin(50 * y), row % 16 < 8 ? 1.0f : -1.0f};
  };
  const WalkStats a = Walk(halves, 16, {0.3f, 0.2f, 2.5f}, around),
                  b = Walk(rays, 16, {0.3f, 0.2f, 2.5f}, around);
  EXPECT_LT(a.nodes, b.nodes);
  // Where all go down there is an axis, and nothing to part.
  EXPECT_EQ(WalkDown(halves, 16).nodes, WalkDown(rays, 16).nodes);
}

// ---- Perfect splits

// Many floors below one another: closest hits that do not end early come to all of them.
TEST(LeafCullingTest, ClosestHitsEndEarlyOverPerfectSplits) {
  std::vector<ObjectInput> floors;
  for (int i = 0; i < 40; ++i) {
    floors.push_back(MakeTerrain(10, 8, {-4, -4, -1.0 * i}));
    floors.back().name = absl::StrCat("floor ", i);
  }
  IndexedGeometry scene = MakeScene(floors);
  const Camera camera = testing_support::LookingDown({0, 0, 9}, 0.3, kCulledSide);
  ThreadPool pool(1);
  const TileOutputs outputs = {.ids = true, .depth = true};
  TileResult truth;
  ASSERT_TRUE(TraceTile(scene, camera, {0, 0, kCulledSide, kCulledSide}, {}, outputs,
                        {.strategy = Strategy::kBruteForce}, &truth)
                  .ok());
  const auto count = [&](Strategy strategy, bool culls, bool perfect) {
    scene.kd_tree = BuildKdTree(scene.geometry, {.perfect_splits = perfect}, pool).value();
    EXPECT_EQ(scene.kd_tree->perfect(), perfect);
    TileResult tile;
    QueryOptions options{
        .strategy = strategy, .structure = Structure::kKdTree, .simd = SimdTarget::kAvx2};
    if (culls) options.leaf_culling = LeafCulling();
    EXPECT_TRUE(
        TraceTile(scene, camera, {0, 0, kCulledSide, kCulledSide}, {}, outputs, options, &tile)
            .ok());
    EXPECT_EQ(tile.triangle, truth.triangle) << StrategyName(strategy) << culls << perfect;
    EXPECT_EQ(tile.depth, truth.depth) << StrategyName(strategy) << culls << perfect;
    return tile.primary;
  };
  for (const Strategy strategy : {Strategy::kSingle, Strategy::kPacket, Strategy::kRtt}) {
    for (const bool culls : {false, true}) {
      if (culls && strategy == Strategy::kRtt) continue;
      const QueryStats plain = count(strategy, culls, false),
                       perfect = count(strategy, culls, true);
      EXPECT_LT(perfect.nodes, 3 * plain.nodes) << StrategyName(strategy) << ' ' << culls;
      EXPECT_LT(perfect.leaves, 3 * plain.leaves) << StrategyName(strategy) << ' ' << culls;
      EXPECT_LT(perfect.triangle_tests, 3 * plain.triangle_tests)
          << StrategyName(strategy) << ' ' << culls;
    }
  }
}

}  // namespace
}  // namespace sightline
