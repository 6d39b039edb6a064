// SPDX-License-Identifier: Apache-2.0
//
// Relevant triangles tracing gives brute force's bits: tiles of every antialiasing, of eyes and of
// lights, in nasty scenes and in scenes of large triangles, where most tiles must be answered by
// their lists.
#include "core/traverse/rtt.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <iterator>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/accel/kd_builder.h"
#include "core/accel/kd_validation.h"
#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

void Build(bool perfect, IndexedGeometry* indexed) {
  ThreadPool pool(1);
  absl::StatusOr<KdTree> tree = BuildKdTree(indexed->geometry, {.perfect_splits = perfect}, pool);
  ASSERT_TRUE(tree.ok()) << tree.status();
  indexed->kd_tree = *std::move(tree);
}

constexpr int64_t kSparseScenes = 300;

Vec3d Unit(Vec3d v) { return v * (1 / Length(v)); }

// A pyramid of side × side rays, in squares of four by four as core/query lays tiles out, cut into
// packets.
struct Tile {
  std::unique_ptr<RayPacket[]> packets;
  size_t count = 0;
  std::vector<AnsweredBy> answered_by;

  std::span<RayPacket> span() { return {packets.get(), count}; }
  RayPacket& Of(size_t ray) { return packets[ray / RayPacket::kMaxRays]; }
};

class RttTest : public KernelsFixture {
 protected:
  struct Totals {
    int64_t rays = 0, hits = 0;
    WalkStats stats;
    int64_t by_list = 0, by_shaft = 0;
  };

  // Rows are `flat` times as far from one another as columns.
  Tile MakeTile(Vec3f origin, Vec3d toward, double spacing, int side, double roll,
                double flat = 1) {
    Tile tile;
    const size_t rays = static_cast<size_t>(side) * static_cast<size_t>(side);
    tile.count = (rays + RayPacket::kMaxRays - 1) / RayPacket::kMaxRays;
    tile.packets = std::make_unique<RayPacket[]>(tile.count);
    tile.answered_by.assign(rays, AnsweredBy::kNoRay);
    const Vec3d w = Unit(toward);
    const Vec3d e = std::abs(w.x) < 0.6 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0};
    const Vec3d a = Unit(Cross(w, e)), b = Cross(w, a);
    const Vec3d u = std::cos(roll) * a + std::sin(roll) * b, v = Cross(w, u);
    size_t ray = 0;
    for (int y = 0; y < side; y += 4) {
      for (int x = 0; x < side; x += 4) {
        for (int k = 0; k < 16; ++k, ++ray) {
          const Vec3d d = w + (x + k % 4 - 0.5 * side) * spacing * u +
                          (y + k / 4 - 0.5 * side) * spacing * flat * v;
          SetTarget(tile, ray, ToFloat(d), kNoTriangle);
        }
      }
    }
    for (size_t p = 0; p < tile.count; ++p) {
      RayPacket& packet = tile.packets[p];
      packet.origin = origin;
      packet.segments = false;
      packet.count =
          static_cast<int>(std::min<size_t>(RayPacket::kMaxRays, rays - p * RayPacket::kMaxRays));
      packet.answered_by = tile.answered_by.data() + p * RayPacket::kMaxRays;
    }
    return tile;
  }

  static void SetTarget(Tile& tile, size_t ray, Vec3f target, uint32_t source) {
    RayPacket& packet = tile.Of(ray);
    const size_t lane = ray % RayPacket::kMaxRays;
    packet.target_x[lane] = target.x;
    packet.target_y[lane] = target.y;
    packet.target_z[lane] = target.z;
    packet.target_source[lane] = source;
  }

  // Traces the tile as any and as closest hit, and compares with brute force.
  void Check(const IndexedGeometry& scene, Tile& tile, const RttOptions& options, bool closest_too,
             Totals* totals) {
    for (RayPacket& packet : tile.span()) {
      std::vector<TraceRay> queries;
      for (int lane = 0; lane < packet.count; ++lane) {
        queries.push_back(
            {.ray = packet.ray(lane),
             .mask = packet.mask,
             .from_source = packet.origin_source,
             .to_source = packet.segments ? packet.target_source[lane] : kNoTriangle});
      }
      std::vector<Hit> truth(queries.size());
      WalkStats ignored;
      ASSERT_TRUE(kernels().closest_brute(scene, queries, truth, nullptr, &ignored));
      truths_.insert(truths_.end(), truth.begin(), truth.end());
    }
    for (const bool any : {true, false}) {
      if (!any && !closest_too) continue;
      ASSERT_TRUE((any ? kernels().occluded_rtt : kernels().closest_rtt)(
          scene, tile.span(), options, nullptr, &totals->stats));
      for (size_t ray = 0; ray < truths_.size(); ++ray) {
        const RayPacket& packet = tile.Of(ray);
        const int lane = static_cast<int>(ray % RayPacket::kMaxRays);
        const Hit hit = packet.hit(lane), truth = truths_[ray];
        const TraceRay query = {.ray = packet.ray(lane)};
        ASSERT_EQ(hit.triangle != kNoTriangle, truth.triangle != kNoTriangle)
            << (any ? "any" : "closest") << ", ray " << ray << ": " << Printed{query};
        totals->by_shaft += tile.answered_by[ray] == AnsweredBy::kShaft;
        totals->by_list += tile.answered_by[ray] == AnsweredBy::kTriangles;
        ASSERT_NE(tile.answered_by[ray], AnsweredBy::kNoRay);
        ++totals->rays;
        totals->hits += truth.triangle != kNoTriangle;
        if (any) continue;
        ASSERT_EQ(hit.triangle, truth.triangle) << "ray " << ray << ": " << Printed{query};
        ASSERT_EQ(std::bit_cast<uint32_t>(hit.t), std::bit_cast<uint32_t>(truth.t))
            << "ray " << ray << ": " << Printed{query};
      }
    }
  }

  // An eye's tile, then the segments from a light to its hits.
  void CheckEyeAndLight(const IndexedGeometry& scene, Vec3f eye, Vec3d toward, Vec3f light,
                        double spacing, int n, bool shared_edges, TestRng& rng, Totals* eyes,
                        Totals* lights, double flat = 1) {
    const RttOptions options{.tile_rays = RttTileRays(n), .shared_edges = shared_edges};
    // Several tiles of one ray a pixel fill a packet.
    const int side = n == 1 ? 16 : 4 * n;
    Tile tile = MakeTile(eye, toward, spacing, side, rng.Uniform(0, 6), flat);
    truths_.clear();
    ASSERT_NO_FATAL_FAILURE(Check(scene, tile, options, true, eyes));
    const double sources = rng.Chance(0.5) ? 1 : rng.Uniform(0, 1);
    for (size_t ray = 0; ray < truths_.size(); ++ray) {
      RayPacket& packet = tile.Of(ray);
      const Vec3d d = ToDouble(packet.target(static_cast<int>(ray % RayPacket::kMaxRays)));
      const bool hit = truths_[ray].triangle != kNoTriangle;
      const double t = hit ? truths_[ray].t : 1.0;
      SetTarget(tile, ray, ToFloat(ToDouble(eye) + t * d),
                rng.Chance(sources) ? truths_[ray].triangle : kNoTriangle);
    }
    for (RayPacket& packet : tile.span()) {
      packet.origin = light;
      packet.segments = true;
    }
    truths_.clear();
    ASSERT_NO_FATAL_FAILURE(Check(scene, tile, options, rng.Chance(0.3), lights));
  }

  std::vector<Hit> truths_;
};

SIGHTLINE_FOR_EACH_TARGET(RttTest);

TEST_P(RttTest, NastyScenesGiveBruteForcesBits) {
  TestRng rng;
  Totals eyes, lights;
  for (NastyScene& scene : MakeNastyScenes(rng)) {
    NastyRays rays(scene.indexed, rng);
    for (const bool perfect : {false, true}) {
      SCOPED_TRACE(absl::StrCat(scene.name, perfect ? ", perfect" : ""));
      ASSERT_NO_FATAL_FAILURE(Build(perfect, &scene.indexed));
      for (int64_t i = ScaledCount(40, 10); i > 0; --i) {
        const Vec3f eye = rays.Point();
        const Vec3d toward = ToDouble(rays.Target(eye, false));
        if (!(Length(toward) > 0) || !std::isfinite(Length(toward))) continue;
        const double spacing = std::ldexp(1.0, -static_cast<int>(rng.Below(16)) - 3);
        ASSERT_NO_FATAL_FAILURE(CheckEyeAndLight(scene.indexed, eye, toward, rays.Point(), spacing,
                                                 1 + static_cast<int>(rng.Below(6)),
                                                 rng.Chance(0.5), rng, &eyes, &lights));
      }
    }
  }
  EXPECT_GT(eyes.stats.tiles_answered, 0u);
  EXPECT_GT(lights.stats.tiles_answered, 0u);
}

// Corners that are cut before a cell must part when they come to it, whatever it holds: with what
// runs into it the cut has lost more, here the corner of the cells before it that holds `target`.
//
//   z < 10, x < 1, y < 1: a part of `cover`; all corners end in it.
//   z < 10, x < 1, y > 1: a little of `cover`, and `target`.
//   z < 10, x > 1:        nothing, or nothing near. The corners are cut before it.
//   z > 10:               the rest of `cover`.
TEST_P(RttTest, CellsBehindACutAreNeverPassedBy) {
  const Vec3d cover[] = {{0.3, 0, 7.8}, {4, 0, 22.6}, {4, 7, 22.6}};
  const Vec3d target[] = {{0.976, 1.011, 9.9}, {0.988, 1.011, 9.9}, {0.982, 1.023, 9.9}};
  const Vec3d elsewhere[] = {{5, -50, 5}, {6, -50, 5}, {5, -51, 6}};
  for (const bool holds_things : {false, true}) {
    SCOPED_TRACE(holds_things ? "things elsewhere" : "an empty cell");
    ObjectInput object;
    object.vertices.insert(object.vertices.end(), std::begin(cover), std::end(cover));
    object.vertices.insert(object.vertices.end(), std::begin(target), std::end(target));
    if (holds_things) {
      object.vertices.insert(object.vertices.end(), std::begin(elsewhere), std::end(elsewhere));
    }
    for (uint32_t i = 0; i < object.vertices.size(); ++i) object.indices.push_back(i);
    IndexedGeometry scene = IndexObjects({object}, Vec3d{});
    const auto box_of = [&](uint32_t id) {
      Box3f box;
      for (const Vec3f& corner : scene.geometry.Corners(id)) box.Extend(corner);
      return box;
    };
    KdTree tree;
    tree.triangle_count = static_cast<uint32_t>(scene.geometry.triangles.size());
    for (uint32_t id = 0; id < tree.triangle_count; ++id) tree.bounds.Extend(box_of(id));
    tree.max_depth = 3;
    for (const KdNode node :
         {KdNode::Inner(2, 10, 1), KdNode::Inner(0, 1, 3), KdNode::Leaf(holds_things ? 3 : 2),
          KdNode::Inner(1, 1, 5), holds_things ? KdNode::Leaf(2) : KdNode::EmptyLeaf(),
          KdNode::Leaf(0), KdNode::Leaf(1)}) {
      tree.nodes.push_back(node);
    }
    const auto add_leaf = [&](Box3f cell, std::initializer_list<uint32_t> ids) {
      Box3f hull;
      for (const uint32_t id : ids) hull.Extend(box_of(id));
      KdLeaf leaf{};
      for (int axis = 0; axis < 3; ++axis) {
        leaf.lo[axis] = std::max(hull.lo[axis], cell.lo[axis]);
        leaf.hi[axis] = std::min(hull.hi[axis], cell.hi[axis]);
      }
      leaf.first = static_cast<uint32_t>(tree.ids.size());
      leaf.count = static_cast<uint32_t>(ids.size());
      for (const uint32_t id : ids) tree.ids.push_back(id);
      tree.leaves.push_back(leaf);
    };
    const Box3f all = tree.bounds;
    add_leaf({all.lo, {1, 1, 10}}, {0});
    add_leaf({{all.lo.x, 1, all.lo.z}, {1, all.hi.y, 10}}, {0, 1});
    if (holds_things) add_leaf({{1, all.lo.y, all.lo.z}, {all.hi.x, all.hi.y, 10}}, {2});
    add_leaf({{all.lo.x, all.lo.y, 10}, all.hi}, {0});
    for (size_t i = 0; i < tree.nodes.size(); ++i) tree.reach.push_back(Box3f());
    for (size_t i = tree.nodes.size(); i-- > 0;) {
      const KdNode node = tree.nodes[i];
      if (!node.is_leaf()) {
        tree.reach[i].Extend(tree.reach[node.first_child()]);
        tree.reach[i].Extend(tree.reach[node.first_child() + 1]);
      } else if (!node.is_empty_leaf()) {
        for (const uint32_t id : tree.LeafIds(tree.leaves[node.leaf()])) {
          tree.reach[i].Extend(box_of(id));
        }
      }
    }
    ASSERT_TRUE(ValidateKdTree(tree, scene.geometry).ok()) << ValidateKdTree(tree, scene.geometry);
    scene.kd_tree = std::move(tree);

    Tile tile = MakeTile({0, 0, 0}, {0, 0, 1}, 0.001, 4, 0);
    constexpr size_t kThrough = 2;  // The ray that meets `target`.
    for (size_t i = 0; i < 16; ++i) {
      const double at = i == kThrough ? 0.0092 / 0.06 : static_cast<double>(i) / 15;
      SetTarget(tile, i, ToFloat({0.09 + 0.06 * at, 0.096 + 0.044 * at, 1}), kNoTriangle);
    }
    truths_.clear();
    Totals totals;
    EXPECT_NO_FATAL_FAILURE(Check(scene, tile, {}, true, &totals));
    EXPECT_NEAR(truths_[kThrough].t, 9.9, 1e-5);
    for (size_t i = 0; i < 16; ++i) {
      EXPECT_EQ(truths_[i].triangle, i == kThrough ? 1u : 0u) << i;
    }
  }
}

// Few triangles, small and large, in deep trees with empty cells: tiles of any shape and roll, as
// rows of pixels and rolled cameras have them, wide enough for their corners to go different ways.
TEST_P(RttTest, SparseScenesInPerfectSplitsGiveBruteForcesBits) {
  TestRng rng;
  Totals eyes, lights;
  ThreadPool pool(1);
  for (int64_t i = ScaledCount(kSparseScenes, 10); i > 0; --i) {
    ObjectInput object;
    for (int left = 2 + static_cast<int>(rng.Below(24)); left > 0; --left) {
      const double size = std::ldexp(1.0, static_cast<int>(rng.Below(8)) - 4);
      const auto at = [&](double half) {
        return Vec3d{rng.Uniform(-half, half), rng.Uniform(-half, half), rng.Uniform(-half, half)};
      };
      const Vec3d centre = at(5);
      for (int k = 0; k < 3; ++k) {
        object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
        object.vertices.push_back(centre + at(size));
      }
    }
    IndexedGeometry scene = IndexObjects({object}, Vec3d{});
    absl::StatusOr<KdTree> tree = BuildKdTree(
        scene.geometry,
        {.traversal_cost = 0.05f, .perfect_splits = true, .max_depth = 20, .max_references = 32},
        pool);
    ASSERT_TRUE(tree.ok()) << tree.status();
    scene.kd_tree = *std::move(tree);
    for (int tiles = 8; tiles > 0; --tiles) {
      const auto within = [&] {
        return Vec3d{rng.Uniform(-6, 6), rng.Uniform(-6, 6), rng.Uniform(-6, 6)};
      };
      const double spacing = std::ldexp(1.0, -static_cast<int>(rng.Below(5)) - 3);
      const double flat = rng.Chance(0.5) ? 1 : rng.Chance(0.5) ? 0 : rng.Uniform(0, 0.2);
      const int n = rng.Chance(0.8) ? 1 : 2;
      ASSERT_NO_FATAL_FAILURE(CheckEyeAndLight(scene, ToFloat(within()), within() - within(),
                                               ToFloat(within()), spacing, n, rng.Chance(0.5), rng,
                                               &eyes, &lights, flat));
    }
  }
  EXPECT_GT(eyes.stats.tiles_answered, eyes.stats.tiles / 20);
  EXPECT_GT(lights.stats.tiles_answered, lights.stats.tiles / 20);
}

// Blocks in a room, of triangles much larger than tiles.
IndexedGeometry MakeRoom() {
  return IndexObjects(
      {MakeClosedBox(1, {-10, -10, -10}, {10, 10, 10}), MakeClosedBox(1, {-3, -10, -2}, {1, -4, 3}),
       MakeClosedBox(2, {4, -10, 1}, {6, 2, 4}), MakeClosedSphere(12, 18, 2, {-5, 3, 4})},
      Vec3d{});
}

TEST_P(RttTest, MostTilesOfARoomNeedNoRays) {
  TestRng rng;
  IndexedGeometry room = MakeRoom();
  ASSERT_NO_FATAL_FAILURE(Build(false, &room));
  for (const int n : {1, 2, 3, 4, 5, 6}) {
    SCOPED_TRACE(n);
    uint64_t answered[2];
    for (const bool shared_edges : {false, true}) {
      Totals eyes, lights;
      TestRng same(static_cast<uint64_t>(n));
      for (int64_t i = ScaledCount(60, 10); i > 0; --i) {
        const auto within = [&] {
          return Vec3d{same.Uniform(-9, 9), same.Uniform(3, 9), same.Uniform(-9, 9)};
        };
        ASSERT_NO_FATAL_FAILURE(CheckEyeAndLight(room, ToFloat(within()), within() - within(),
                                                 ToFloat(within()), 0.003 / n, n, shared_edges,
                                                 same, &eyes, &lights));
      }
      EXPECT_EQ(eyes.hits, eyes.rays);  // The room is closed.
      EXPECT_GT(eyes.stats.tiles_answered, eyes.stats.tiles / 4);
      EXPECT_GT(lights.stats.tiles_answered, lights.stats.tiles / 4);
      EXPECT_GT(lights.by_shaft, 0);
      EXPECT_GT(eyes.by_list, 0);
      answered[shared_edges] = eyes.stats.tiles_answered;
    }
    EXPECT_GE(answered[1], answered[0]);
  }
}

// Tiles that share a register fare as they do alone: the same are answered, by the same lists.
TEST_P(RttTest, TilesSideBySideWalkAsTheyDoAlone) {
  TestRng rng;
  IndexedGeometry room = MakeRoom();
  ASSERT_NO_FATAL_FAILURE(Build(rng.Chance(0.5), &room));
  uint64_t answered = 0, left = 0, nodes[3] = {};
  for (int64_t i = ScaledCount(200, 20); i > 0; --i) {
    const auto within = [&] {
      return Vec3d{rng.Uniform(-9, 9), rng.Uniform(-9, 9), rng.Uniform(-9, 9)};
    };
    const Vec3f eye = ToFloat(within());
    const Vec3d toward = within() - within();
    const double spacing = std::ldexp(1.0, -static_cast<int>(rng.Below(4)) - 5);
    const double roll = rng.Uniform(0, 6);
    const bool shared_edges = rng.Chance(0.5);
    const int n = rng.Chance(0.7) ? 1 : 2;
    WalkStats alone;
    std::vector<AnsweredBy> alone_by;
    for (const int side_by_side : {1, 2, 4}) {
      SCOPED_TRACE(absl::StrCat(side_by_side, " side by side"));
      Tile tile = MakeTile(eye, toward, spacing, 16, roll);
      truths_.clear();
      Totals totals;
      ASSERT_NO_FATAL_FAILURE(Check(
          room, tile,
          {.tile_rays = RttTileRays(n), .side_by_side = side_by_side, .shared_edges = shared_edges},
          true, &totals));
      nodes[side_by_side / 2] += totals.stats.nodes;
      if (side_by_side == 1) {
        alone = totals.stats;
        alone_by = tile.answered_by;
        answered += alone.tiles_answered;
        left += alone.tiles - alone.tiles_answered;
      }
      ASSERT_EQ(totals.stats.tiles, alone.tiles);
      ASSERT_EQ(totals.stats.tiles_answered, alone.tiles_answered);
      ASSERT_EQ(totals.stats.relevant_triangles, alone.relevant_triangles);
      ASSERT_EQ(tile.answered_by, alone_by);
    }
  }
  EXPECT_GT(answered, 0u);
  EXPECT_GT(left, 0u);
  // Nodes that several visit are visited once.
  EXPECT_LT(nodes[1], nodes[0]);
  EXPECT_LE(nodes[2], nodes[1]);
}

// The diagonal of a wall runs through the tile: neither triangle covers it, both together do.
TEST_P(RttTest, TrianglesThatShareAnEdgeCoverTogether) {
  // What stands behind the walls parts rays that are not stopped by them.
  IndexedGeometry room = IndexObjects(
      {MakeClosedBox(1, {-10, -10, -10}, {10, 10, 10}), MakeClosedSphere(60, 90, 12, {30, 0, 0})},
      Vec3d{});
  ASSERT_NO_FATAL_FAILURE(Build(false, &room));
  uint64_t answered[2];
  for (const bool shared_edges : {false, true}) {
    Totals totals;
    for (int i = 0; i < 20; ++i) {
      // Toward points of the x = 10 wall's diagonals, off the axes.
      const double at = -7 + 0.7 * i;
      for (const double other : {at, -at}) {
        Tile tile = MakeTile({0.1f, 0.2f, 0.3f}, {9.9, at - 0.2, other - 0.3}, 0.001, 4, 1);
        truths_.clear();
        ASSERT_NO_FATAL_FAILURE(Check(room, tile, {.shared_edges = shared_edges}, true, &totals));
      }
    }
    answered[shared_edges] = totals.stats.tiles_answered;
  }
  EXPECT_GT(answered[1], answered[0] + 10);
}

// So they do for a light's shadows, whose receivers lie beyond both: of the leaves behind the wall,
// among which the corner rays part, nothing need be known.
TEST_P(RttTest, TrianglesThatShareAnEdgeDarkenTogether) {
  TestRng rng;
  ObjectInput leaves;
  while (leaves.vertices.size() < 3 * 4000) {
    const Vec3d at = {rng.Uniform(10.5, 13), rng.Uniform(-10, 10), rng.Uniform(-10, 10)};
    for (int corner = 0; corner < 3; ++corner) {
      leaves.indices.push_back(static_cast<uint32_t>(leaves.vertices.size()));
      leaves.vertices.push_back(
          at + Vec3d{rng.Uniform(0, 0.1), rng.Uniform(0, 0.1), rng.Uniform(0, 0.1)});
    }
  }
  IndexedGeometry room =
      IndexObjects({MakeClosedBox(1, {-10, -10, -10}, {10, 10, 10}), leaves}, Vec3d{});
  ASSERT_NO_FATAL_FAILURE(Build(false, &room));
  // Receivers beyond the wall; one of them on it, as it says; and some beyond, some before it.
  enum Ends { kBeyond, kOn, kAcross };
  uint64_t answered[3][2];
  for (const Ends ends : {kBeyond, kOn, kAcross}) {
    for (const bool shared_edges : {false, true}) {
      Totals totals;
      for (int i = 0; i < 20; ++i) {
        const double at = -7 + 0.7 * i;
        for (const double other : {at, -at}) {
          const Vec3f light = {0.1f, 0.2f, 0.3f};
          Tile tile = MakeTile(light, {9.9, at - 0.2, other - 0.3}, 0.01, 4, 1);
          for (size_t ray = 0; ray < 16; ++ray) {
            const Vec3f d = tile.Of(ray).target(static_cast<int>(ray));
            const double x = ends == kAcross ? 9.99 + 0.01 * static_cast<double>(ray % 4) : 14;
            const TraceRay through = {.ray = PredicateRay::Ray(light, d)};
            Hit wall;
            WalkStats ignored;
            ASSERT_TRUE(
                kernels().closest_brute(room, {&through, 1}, {&wall, 1}, nullptr, &ignored));
            SetTarget(tile, ray, ToFloat(ToDouble(light) + ToDouble(d) * ((x - light.x) / d.x)),
                      ends == kOn && ray == 7 ? wall.triangle : kNoTriangle);
          }
          tile.packets[0].origin = light;
          tile.packets[0].segments = true;
          truths_.clear();
          ASSERT_NO_FATAL_FAILURE(Check(room, tile, {.shared_edges = shared_edges}, true, &totals));
        }
      }
      answered[ends][shared_edges] = totals.stats.tiles_answered;
    }
  }
  EXPECT_GT(answered[kBeyond][1], answered[kBeyond][0] + 10);
  EXPECT_EQ(answered[kOn][1], answered[kOn][0]);
  EXPECT_EQ(answered[kAcross][1], answered[kAcross][0]);
}

// Lamps stand in the planes of their fittings, and splits in both.
TEST_P(RttTest, OriginsInTheSplitsPlanesLoseNothing) {
  TestRng rng;
  IndexedGeometry room = MakeRoom();
  ASSERT_NO_FATAL_FAILURE(Build(false, &room));
  Totals eyes, lights;
  for (int64_t i = ScaledCount(200, 10); i > 0; --i) {
    const auto within = [&] {
      return Vec3d{rng.Uniform(-9, 9), rng.Uniform(3, 9), rng.Uniform(-9, 9)};
    };
    Vec3f eye = ToFloat(within()), light = ToFloat(within());
    for (const KdNode& node : room.kd_tree->nodes) {
      if (node.is_leaf() || std::abs(node.split()) > 9) continue;
      if (rng.Chance(0.2)) eye[node.axis()] = node.split();
      if (rng.Chance(0.2)) light[node.axis()] = node.split();
    }
    ASSERT_NO_FATAL_FAILURE(CheckEyeAndLight(room, eye, within() - within(), light, 0.003, 1,
                                             rng.Chance(0.5), rng, &eyes, &lights));
  }
  EXPECT_GT(eyes.stats.tiles_answered, eyes.stats.tiles / 4);
  EXPECT_GT(lights.stats.tiles_answered, lights.stats.tiles / 4);
}

TEST_P(RttTest, NothingToDoAndFiredTokens) {
  IndexedGeometry room = MakeRoom();
  ASSERT_NO_FATAL_FAILURE(Build(false, &room));
  WalkStats stats;
  EXPECT_TRUE(kernels().closest_rtt(room, {}, {}, nullptr, &stats));
  EXPECT_EQ(stats.tiles, 0u);
  CancelToken cancel;
  cancel.Cancel();
  for (const int n : {1, 6}) {
    Tile tile = MakeTile({0, 5, 0}, {1, 0, 0}, 0.001, 4 * n, 0);
    EXPECT_FALSE(
        kernels().closest_rtt(room, tile.span(), {.tile_rays = RttTileRays(n)}, &cancel, &stats));
  }
}

}  // namespace
}  // namespace sightline::testing_support
