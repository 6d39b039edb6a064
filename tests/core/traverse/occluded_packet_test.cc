// SPDX-License-Identifier: Apache-2.0
//
// Packets for any hit against the definition, where they come nearest to losing a hit: a few
// triangles in leaves of one to three, or dozens in full ones, many lanes that lead to one point or
// along one edge, so that a group's rectangle is no wider than rounding; corners that a frame holds
// badly; lanes that it does not hold at all.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "core/accel/bvh_builder.h"
#include "core/base/cancel.h"
#include "core/intersect/predicate.h"
#include "core/mesh/object.h"
#include "core/mesh/scene_geometry.h"
#include "core/shaft/frame.h"
#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/triangle_cases.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

// A few triangles about a centre.
struct TinyScene {
  IndexedGeometry indexed;
  double size = 1;               // Half the side of the cube that holds them.
  std::vector<uint32_t> leaves;  // As RayPacket::first_leaf names them.
};

IndexedGeometry Index(const std::vector<Vec3d>& vertices, const std::vector<uint32_t>& indices,
                      const BvhBuildOptions& options) {
  IndexedGeometry indexed;
  const ObjectInput object = {.vertices = vertices, .indices = indices};
  absl::StatusOr<SceneGeometry> geometry = CompileScene({&object, 1}, Vec3d{}, MeshLimits{});
  EXPECT_TRUE(geometry.ok()) << geometry.status();
  if (!geometry.ok()) return indexed;
  indexed.geometry = *std::move(geometry);
  indexed.bvh = BuildOrFail(indexed.geometry, options);
  return indexed;
}

TinyScene MakeTinyScene(TestRng& rng) {
  TinyScene scene;
  scene.size = std::ldexp(1.0, static_cast<int>(rng.Below(16)) - 8);
  Vec3d centre;
  if (rng.Chance(0.5)) {
    const double away = scene.size * std::exp2(rng.Uniform(0, 22));
    for (int k = 0; k < 3; ++k) centre[k] = rng.Uniform(-away, away);
  } else if (rng.Chance(0.3)) {
    scene.size = std::ldexp(1.0, static_cast<int>(rng.Below(60)) - 30);
  }
  // Few lanes before many of a leaf's triangles are put to these one by one, many before few not.
  const bool full = rng.Chance(0.5);
  const uint64_t triangles = 1 + rng.Below(full ? 40 : 6), pool = 3 + rng.Below(3 * triangles);
  const bool lattice = rng.Chance(0.3), strip = rng.Chance(0.5);
  std::vector<Vec3d> vertices(pool);
  for (Vec3d& v : vertices) {
    for (int k = 0; k < 3; ++k) {
      v[k] = lattice ? static_cast<double>(rng.Below(5)) / 2 - 1 : rng.Uniform(-1, 1);
    }
    v = centre + v * scene.size;
  }
  std::vector<uint32_t> indices;
  for (uint64_t i = 0; i < triangles; ++i) {
    const auto first = static_cast<uint32_t>(rng.Below(pool));
    for (uint32_t k = 0; k < 3; ++k) {
      indices.push_back(static_cast<uint32_t>(strip ? (first + k) % pool : rng.Below(pool)));
    }
  }
  scene.indexed =
      Index(vertices, indices,
            {.max_leaf_triangles = 1 + static_cast<int>(rng.Below(full ? kMaxLeafTriangles : 3)),
             .leaf_rows = rng.Chance(0.8)});
  for (const BvhNode& node : scene.indexed.bvh.nodes) {
    for (const ChildRef child : node.child) {
      if (child.is_leaf()) scene.leaves.push_back(child.bits());
    }
  }
  return scene;
}

// Points of a scene's triangles: corners, middles of edges, along an edge, or inside.
class Spots {
 public:
  Spots(const TinyScene& scene, TestRng& rng) : geometry_(scene.indexed.geometry), rng_(rng) {}

  // From now on all lie on one edge, or (false) anywhere.
  void KeepToAnEdge(bool keep) {
    Choose();
    kept_ = keep;
  }
  Vec3f Next() {
    if (!kept_) Choose();
    const Vec3d a = ToDouble(corners_[0]), b = ToDouble(corners_[1]), c = ToDouble(corners_[2]);
    const double s = rng_.Uniform(0, 1), t = rng_.Uniform(0, 1 - s);
    switch (rng_.Below(kept_ ? 4 : 5)) {
      case 0:
        return corners_[0];
      case 1:
        return ToFloat((a + b) * 0.5);
      case 4:
        return ToFloat(a * (1 - s - t) + b * s + c * t);
      default:
        return ToFloat(a * (1 - s) + b * s);
    }
  }

 private:
  void Choose() {
    corners_ = geometry_.Corners(static_cast<uint32_t>(rng_.Below(geometry_.triangles.size())));
    std::rotate(corners_.begin(), corners_.begin() + rng_.Below(3), corners_.end());
  }

  const SceneGeometry& geometry_;
  TestRng& rng_;
  bool kept_ = false;
  std::array<Vec3f, 3> corners_;
};

// Moved by at most `ulps` along each axis, and within what may be stored.
Vec3f Beside(Vec3f p, uint64_t ulps, TestRng& rng) {
  for (int k = 0; k < 3; ++k) {
    p[k] = MoveByUlps(p[k], static_cast<int>(rng.Below(2 * ulps + 1)) - static_cast<int>(ulps));
  }
  return ClampToRange(p);
}

bool BlocksIt(const SceneGeometry& geometry, const TraceRay& query, uint32_t id) {
  if (id == query.from_source || id == query.to_source) return false;
  const auto [a, b, c] = geometry.Corners(id);
  return Blocks(query.ray, a, b, c);
}

void Set(RayPacket* packet, int lane, Vec3f target, uint32_t source = kNoTriangle) {
  packet->target_x[lane] = target.x;
  packet->target_y[lane] = target.y;
  packet->target_z[lane] = target.z;
  packet->target_source[lane] = source;
}
void Set(ParallelPacket* packet, int lane, Vec3f origin, uint32_t source = kNoTriangle) {
  packet->origin_x[lane] = origin.x;
  packet->origin_y[lane] = origin.y;
  packet->origin_z[lane] = origin.z;
  packet->origin_source[lane] = source;
}

class OccludedPacketTest : public KernelsFixture {
 protected:
  bool Walk(const IndexedGeometry& scene, RayPacket* packet, const CancelToken* cancel = nullptr) {
    return kernels().occluded_packet(scene, *packet, cancel, &stats_);
  }
  bool Walk(const IndexedGeometry& scene, ParallelPacket* packet,
            const CancelToken* cancel = nullptr) {
    return kernels().occluded_parallel_packet(scene, *packet, cancel, &stats_);
  }

  // Every lane is answered as the predicate has it, triangle by triangle.
  template <class Packet>
  void ExpectTruth(const IndexedGeometry& scene, Packet* packet) {
    std::fill_n(packet->triangle, Packet::kMaxRays, 12345u);  // To be overwritten.
    ASSERT_TRUE(Walk(scene, packet));
    for (int lane = 0; lane < packet->count; ++lane) {
      const TraceRay query = packet->trace_ray(lane);
      const uint32_t found = packet->triangle[lane];
      ++lanes_;
      if (found != kNoTriangle) {
        ++hits_;
        ASSERT_LT(found, scene.geometry.triangles.size());
        ASSERT_TRUE(BlocksIt(scene.geometry, query, found)) << Said(*packet, lane, found);
        continue;
      }
      for (uint32_t id = 0; id < scene.geometry.triangles.size(); ++id) {
        ASSERT_FALSE(BlocksIt(scene.geometry, query, id)) << Said(*packet, lane, id);
      }
    }
  }

  WalkStats stats_;
  int64_t lanes_ = 0, hits_ = 0;

 private:
  template <class Packet>
  static testing::Message Said(const Packet& packet, int lane, uint32_t id) {
    return testing::Message() << "lane " << lane << " of " << packet.count << ", "
                              << Printed{packet.trace_ray(lane)} << ", triangle " << id;
  }
};

SIGHTLINE_FOR_EACH_TARGET(OccludedPacketTest);

constexpr int64_t kScenes = 2500;
constexpr int kPacketsOfScene = 12;
// The sizes at which groups and halves of them begin and end.
constexpr int kCounts[] = {1, 2, 3, 7, 8, 9, 16, 17, 24, 40, 256};

TEST_P(OccludedPacketTest, NarrowPacketsLoseNothingToTheirRectangles) {
  TestRng rng;
  const auto packet = std::make_unique<RayPacket>();
  const auto parallel = std::make_unique<ParallelPacket>();
  for (int64_t i = ScaledCount(kScenes, 10); i > 0; --i) {
    const TinyScene scene = MakeTinyScene(rng);
    const uint64_t triangles = scene.indexed.geometry.triangles.size();
    Spots spots(scene, rng);
    const auto source = [&](double probability) {
      return rng.Chance(probability) ? static_cast<uint32_t>(rng.Below(triangles)) : kNoTriangle;
    };
    const auto first_leaf = [&] {
      return scene.leaves.empty() || rng.Chance(0.5) ? RayPacket::kNoLeaf
                                                     : scene.leaves[rng.Below(scene.leaves.size())];
    };
    for (int j = 0; j < kPacketsOfScene; ++j) {
      const int count = kCounts[rng.Below(std::size(kCounts))];
      // So many lanes in a row lead to one spot.
      const int run = 1 + static_cast<int>(rng.Below(static_cast<uint64_t>(count)));
      const uint64_t ulps = std::array{0, 1, 4}[rng.Below(3)];
      const bool to_spot = rng.Chance(0.5);  // Else some share of the way, or beyond.
      const float share = to_spot ? 1 : static_cast<float>(std::exp2(rng.Uniform(-3, 8)));
      spots.KeepToAnEdge(rng.Chance(0.6));
      Vec3f origin = Beside(spots.Next(), 3, rng);
      if (rng.Chance(0.8)) {
        const double away = scene.size * std::exp2(rng.Uniform(-12, 10));
        for (int k = 0; k < 3; ++k) origin[k] += static_cast<float>(rng.Uniform(-away, away));
      }

      packet->origin = origin;
      packet->segments = rng.Chance(0.6);
      packet->origin_source = source(0.15);
      packet->first_leaf = first_leaf();
      packet->count = count;
      Vec3f spot;
      for (int lane = 0; lane < count; ++lane) {
        if (lane % run == 0) spot = spots.Next();
        Vec3f along = (spot - origin) * share;
        if (rng.Chance(0.003)) along = -along;
        const Vec3f target = !packet->segments ? along : to_spot ? spot : origin + along;
        Set(packet.get(), lane, Beside(target, ulps, rng), source(0.1));
      }
      ASSERT_NO_FATAL_FAILURE(ExpectTruth(scene.indexed, packet.get()));

      Vec3f along = spots.Next() - origin;
      if (rng.Chance(0.25)) along[static_cast<int>(rng.Below(3))] = 0;
      if (MaxAbs(along) == 0) along = {0, 0, -1};
      parallel->direction = along;
      parallel->direction_source = source(0.15);
      parallel->first_leaf = first_leaf();
      parallel->count = count;
      for (int lane = 0; lane < count; ++lane) {
        if (lane % run == 0) spot = spots.Next();
        Set(parallel.get(), lane, Beside(spot - along * std::min(share, 2.0f), ulps, rng),
            source(0.1));
      }
      ASSERT_NO_FATAL_FAILURE(ExpectTruth(scene.indexed, parallel.get()));
    }
  }
  EXPECT_GT(hits_, lanes_ / 10);
  EXPECT_LT(hits_, lanes_ - lanes_ / 10);
  EXPECT_GT(stats_.doubt_double, 0u);
}

// A corner far aside of the frame has slopes that are known badly. An edge between two of them,
// along the frame's u, would take that error to rays through its middle.
TEST_P(OccludedPacketTest, CornersFarAsideOpenTheirRectangles) {
  constexpr int kOnEdge = 16;
  TestRng rng;
  const auto packet = std::make_unique<RayPacket>();
  packet->count = 2 * kOnEdge;
  for (int64_t i = ScaledCount(4000, 10); i > 0; --i) {
    const auto any = [&] {
      return Vec3d{rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)};
    };
    ShaftFrame frame;
    ASSERT_TRUE(MakeShaftFrame(any(), any(), &frame));
    const Vec3d u = ToDouble(frame.u), v = ToDouble(frame.v), w = ToDouble(frame.w);
    const Vec3d origin = rng.Chance(0.5) ? Vec3d{} : ToDouble(ToFloat(any()));
    // As far as a slope is still taken, or farther.
    const double far = rng.Chance(0.5) ? rng.Uniform(1, 4) : std::exp2(rng.Uniform(2, 13));
    const double y = rng.Uniform(-0.3, 0.3);
    const IndexedGeometry scene =
        Index({origin + w - u * far + v * y, origin + w + u * (far * rng.Uniform(0.5, 2)) + v * y,
               origin + w + v * (rng.Chance(0.5) ? y + 1 : y - 1)},
              {0, 1, 2}, {});
    const Vec3d a = ToDouble(scene.geometry.vertices[0]), b = ToDouble(scene.geometry.vertices[1]);
    const auto set = [&](int lane, Vec3d target, uint64_t ulps) {
      Set(packet.get(), lane,
          Beside(ToFloat(packet->segments ? target : target - origin), ulps, rng));
    };
    packet->origin = ToFloat(origin);
    packet->segments = rng.Chance(0.5);
    Vec3d sum;  // Of the directions, as the packet's frame is found from it.
    for (int lane = 0; lane < kOnEdge; ++lane) {
      // The first and the fourth lane tell where u is.
      const double x = lane == 0 ? -0.3 : lane == 3 ? 0.3 : rng.Uniform(-0.3, 0.3);
      const Vec3d target = a + (b - a) * (Dot(origin + u * x - a, u) / Dot(b - a, u));
      set(lane, target, lane % 3 == 0 ? 0 : 1);
      sum = sum + (target - origin) * (1 / MaxAbs(target - origin));
    }
    // The others lead where they bring the sum back to w.
    Vec3d d = w;
    for (int step = 0; step < 60; ++step) {
      const double share = MaxAbs(d) / kOnEdge;
      d = w - u * (Dot(u, sum) * share) - v * (Dot(v, sum) * share);
    }
    for (int lane = kOnEdge; lane < packet->count; ++lane) set(lane, origin + d, 1);
    packet->first_leaf = RayPacket::kNoLeaf;
    ASSERT_NO_FATAL_FAILURE(ExpectTruth(scene, packet.get()));
  }
  EXPECT_GT(hits_, lanes_ / 10);
}

// A ground of bumps below an eye at the origin.
IndexedGeometry MakeGround(TestRng& rng) {
  return IndexObjects({MakeGrid(24, 0.4, {-12, -10, -12}, rng)}, Vec3d{});
}
// A square of points below it, four by four of them at a time.
Vec3f BelowGround(int lane) {
  const int x = 4 * (lane / 16 % 4) + lane % 4, z = 4 * (lane / 64) + lane / 4 % 4;
  return {static_cast<float>(x) * 0.3f - 2, -11, static_cast<float>(z) * 0.3f - 2};
}

// It takes its own group the rectangle, not the packet its frame.
TEST_P(OccludedPacketTest, ALaneThatLeadsNowhereOrBackLeavesTheOthersTheirFrame) {
  TestRng rng;
  const IndexedGeometry scene = MakeGround(rng);
  const auto packet = std::make_unique<RayPacket>();
  const auto tests = [&](int count) {
    packet->count = count;
    packet->first_leaf = RayPacket::kNoLeaf;
    stats_ = {};
    ExpectTruth(scene, packet.get());
    return stats_.triangle_tests;
  };
  for (const bool segments : {true, false}) {
    packet->segments = segments;
    const auto fill = [&] {
      for (int i = 0; i < RayPacket::kMaxRays; ++i) Set(packet.get(), i, BelowGround(i));
    };
    fill();
    const uint64_t without = tests(RayPacket::kMaxRays);
    for (const Vec3f stray : {Vec3f{}, Vec3f{0x1p-149f, 0, 0}, Vec3f{0, -0x1p-149f, 0},
                              Vec3f{0x1p-140f, 0x1p-130f, -0x1p-135f}, Vec3f{0, 11, 0},
                              Vec3f{11, 0, 0}, Vec3f{-0x1p39f, 0x1p38f, 0}}) {
      Set(packet.get(), 0, stray);
      const uint64_t alone = tests(1);
      fill();  // A group's lanes out of use were copies of it.
      for (const int lane : {0, 3, 100, 255}) {
        SCOPED_TRACE(testing::Message() << "lane " << lane << ": " << Hex(stray));
        Set(packet.get(), lane, stray);
        const uint64_t with = tests(RayPacket::kMaxRays);
        if (HasFatalFailure()) return;
        EXPECT_LT(with, 3 * without + alone);
        Set(packet.get(), lane, BelowGround(lane));
      }
    }
    // And where no lane leads anywhere, or all lead apart, there is no frame.
    for (const int count : {1, 17, 256}) {
      for (const bool apart : {true, false}) {
        for (int lane = 0; lane < count; ++lane) {
          const Vec3f there = BelowGround(lane & ~1);
          Set(packet.get(), lane, !apart ? Vec3f{} : lane % 2 == 0 ? there : -there);
        }
        tests(count);
        if (HasFatalFailure()) return;
      }
    }
  }
}

// A frame lies across a direction of any length, but reciprocals of the shortest overflow.
TEST_P(OccludedPacketTest, DirectionsOfAnyLengthGiveTheSameAnswers) {
  TestRng rng;
  const IndexedGeometry scene = MakeGround(rng);
  const auto packet = std::make_unique<ParallelPacket>();
  packet->count = ParallelPacket::kMaxRays;
  for (int lane = 0; lane < packet->count; ++lane) Set(packet.get(), lane, BelowGround(lane));
  for (const Vec3f direction :
       {Vec3f{0, 0x1p-149f, 0}, Vec3f{0x1p-149f, 0x1p-147f, 0}, Vec3f{0x1p-130f, 0x1p-126f, 0},
        Vec3f{0, 0x1p-60f, 0}, Vec3f{0x1p38f, 0x1p39f, 0}, Vec3f{0, -1, 0}, Vec3f{1, 0, 0}}) {
    SCOPED_TRACE(Hex(direction));
    packet->direction = direction;
    packet->first_leaf = RayPacket::kNoLeaf;
    ASSERT_NO_FATAL_FAILURE(ExpectTruth(scene, packet.get()));
  }
}

TEST_P(OccludedPacketTest, NoRaysAreNothing) {
  TestRng rng;
  const IndexedGeometry scene = MakeGround(rng);
  const auto packet = std::make_unique<RayPacket>();
  const auto parallel = std::make_unique<ParallelPacket>();
  parallel->direction = {0, 1, 0};
  packet->triangle[0] = parallel->triangle[0] = 12345;
  EXPECT_TRUE(Walk(scene, packet.get()));
  EXPECT_TRUE(Walk(scene, parallel.get()));
  EXPECT_EQ(packet->triangle[0], 12345u);
  EXPECT_EQ(parallel->triangle[0], 12345u);
  EXPECT_EQ(stats_.nodes + stats_.leaves, 0u);
}

// Its deadline is put off until it falls amid a walk. One that asks its token at the start alone is
// never left off once it has begun, however often that is tried.
TEST_P(OccludedPacketTest, AWalkUnderWayAsksItsTokenToo) {
  TestRng rng;
  const IndexedGeometry scene = IndexObjects({MakeClosedSphere(60, 80, 1, {})}, Vec3d{});
  const auto packet = std::make_unique<RayPacket>();
  const auto parallel = std::make_unique<ParallelPacket>();
  packet->count = parallel->count = RayPacket::kMaxRays;
  parallel->direction = {0, 0, 1};
  for (int lane = 0; lane < packet->count; ++lane) {
    const Vec3d d = {rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)};
    Set(packet.get(), lane, ToFloat(d * (0.99 / Length(d))));  // As far as the sphere, nearly.
    Set(parallel.get(), lane, ToFloat(Vec3d{d.x, d.y, -4}));
  }
  const auto expect_stop = [&](auto* walked) {
    constexpr int kTries = 2000;
    for (int i = 0; i < kTries; ++i) {
      walked->first_leaf = RayPacket::kNoLeaf;
      std::fill_n(walked->triangle, walked->count, 12345u);
      stats_ = {};
      CancelToken cancel;
      cancel.set_deadline(CancelToken::Clock::now() + std::chrono::microseconds(i % 250));
      if (Walk(scene, walked, &cancel) || stats_.nodes == 0) continue;
      EXPECT_TRUE(cancel.cancelled());
      // What it has answered by then it has answered rightly.
      for (int lane = 0; lane < walked->count; ++lane) {
        if (walked->triangle[lane] == kNoTriangle) continue;
        EXPECT_TRUE(BlocksIt(scene.geometry, walked->trace_ray(lane), walked->triangle[lane]));
      }
      return;
    }
    FAIL() << "never left off amid a walk of " << stats_.nodes << " nodes";
  };
  expect_stop(packet.get());
  expect_stop(parallel.get());
}

}  // namespace
}  // namespace sightline::testing_support
