// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/embree_peer.h"

#include <algorithm>
#include <bit>
#include <set>
#include <string>

#include "core/mesh/builtin/builtin.h"
#include "core/mesh/rebase.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline::bench {
namespace {

uint32_t Bits(float x) { return std::bit_cast<uint32_t>(x); }

// The rays made the fast way are those of the engine, to the bit, at even and odd sizes.
TEST(CameraRaysTest, DirectionsAreThoseOfPixelDirection) {
  testing_support::TestRng rng;
  for (int round = 0; round < 40; ++round) {
    const auto coordinate = [&] { return rng.Uniform(-100, 100); };
    const Vec3d eye{coordinate(), coordinate(), coordinate()};
    const uint32_t width = 1 + static_cast<uint32_t>(rng.Below(70));
    const uint32_t height = 1 + static_cast<uint32_t>(rng.Below(70));
    const auto camera = LookAt(eye, {coordinate(), coordinate(), coordinate()}, {0.1, 0.2, 0.97},
                               rng.Uniform(1, 150), width, height);
    ASSERT_TRUE(camera.ok()) << camera.status();
    const Vec3d origin{coordinate(), coordinate(), coordinate()};
    const CameraRays rays(*camera, origin);
    Vec3f stored;
    ASSERT_TRUE(Rebase(eye, origin, &stored));
    EXPECT_EQ(rays.eye().x, stored.x);
    EXPECT_EQ(rays.eye().z, stored.z);
    for (uint32_t y = 0; y < height; y += 2) {
      for (uint32_t x = 0; x < width; x += 2) {
        float dx[4], dy[4], dz[4];
        rays.Directions(x, y, dx, dy, dz);
        for (uint32_t i = 0; i < 4; ++i) {
          // Those beyond an odd side repeat the last.
          const Vec3f d = PixelDirection(*camera, std::min(x + i % 2, width - 1),
                                         std::min(y + i / 2, height - 1));
          ASSERT_EQ(Bits(dx[i]), Bits(d.x)) << x << "," << y << " lane " << i;
          ASSERT_EQ(Bits(dy[i]), Bits(d.y)) << x << "," << y << " lane " << i;
          ASSERT_EQ(Bits(dz[i]), Bits(d.z)) << x << "," << y << " lane " << i;
        }
      }
    }
  }
}

TEST(PeerModeTest, AllModesAreDifferentAndNamed) {
  const std::vector<PeerMode::Start> starts = {PeerMode::Start::kLight, PeerMode::Start::kPoint};
  for (const bool sorted : {false, true}) {
    const std::vector<PeerMode> modes = AllModes(starts, sorted);
    std::set<std::string> names;
    for (const PeerMode& mode : modes) names.insert(mode.Name());
    EXPECT_EQ(modes.size(), sorted ? 40u : 20u);
    EXPECT_EQ(names.size(), modes.size());
  }
  EXPECT_EQ((PeerMode{PeerMode::Entry::kPacket16, true, PeerMode::Start::kLight, true}).Name(),
            "packet16 coherent from light, sorted");
}

// Objects as they were read become the very buffers that a compiled scene has.
TEST(PeerMeshTest, OfObjectsIsThatOfTheCompiledScene) {
  auto hall = MakeBuiltin({.name = "hall", .target_triangles = 30'000});
  ASSERT_TRUE(hall.ok()) << hall.status();
  const auto geometry = CompileScene(hall->objects, std::nullopt, MeshLimits{});
  ASSERT_TRUE(geometry.ok()) << geometry.status();
  ThreadPool pool(2);
  const PeerMesh compiled(*geometry), read(hall->objects, geometry->origin, pool);
  ASSERT_EQ(read.vertex_count(), compiled.vertex_count());
  ASSERT_EQ(read.triangle_count(), compiled.triangle_count());
  EXPECT_EQ(read.triangles(), compiled.triangles());
  for (size_t i = 0; i < read.vertex_count(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      ASSERT_EQ(Bits(read.vertices()[i][axis]), Bits(compiled.vertices()[i][axis])) << i;
    }
  }
}

}  // namespace
}  // namespace sightline::bench
