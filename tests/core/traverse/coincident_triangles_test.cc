// SPDX-License-Identifier: Apache-2.0
//
// Triangles that lie on each other, which no plane parts and no box tells apart: each ray is put to
// all of them, and kd-trees and binary BVHs have them in one leaf. However many they are, a walk
// comes to look at its token after so many tests.
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/accel/binary_bvh_builder.h"
#include "core/accel/kd_builder.h"
#include "core/base/cancel.h"
#include "core/traverse/culled_kernels.h"
#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"

namespace sightline::testing_support {
namespace {

class CoincidentTrianglesTest : public KernelsFixture {
 protected:
  static constexpr uint32_t kTriangles = 20'000;
  // Of a packet: sixteen triangles put to all its rays, so many times between two looks.
  static constexpr uint64_t kMostPacketTests = 64 * 16 * RayPacket::kMaxRays;
  // Of rays one by one: sixteen each.
  static constexpr uint64_t kMostRayTests = 4096 * 16;

  void SetUp() override {
    ObjectInput object{.vertices = {{-1, -1, 1}, {1, -1, 1.1}, {0, 1, 1.2}}};
    for (uint32_t i = 0; i < kTriangles; ++i) {
      object.indices.insert(object.indices.end(), {0, 1, 2});
    }
    scene_ = IndexObjects({object}, Vec3d{});
    ThreadPool pool(1);
    auto kd = BuildKdTree(scene_.geometry, {}, pool);
    ASSERT_TRUE(kd.ok()) << kd.status();
    scene_.kd_tree = *std::move(kd);
    auto binary = BuildBinaryBvh(scene_.geometry, {}, pool);
    ASSERT_TRUE(binary.ok()) << binary.status();
    scene_.binary_bvh = *std::move(binary);
  }

  // Toward the middle of the triangles; or past them, but through their box.
  void Aim(bool past, int count) {
    packet_->segments = false;
    packet_->sourceless = true;
    packet_->count = count;
    for (int i = 0; i < count; ++i) {
      const float shift = past ? 0.8f : 0.0f;
      const int column = i % 16, row = i / 16;
      packet_->target_x[i] = shift + 0.001f * static_cast<float>(column);
      packet_->target_y[i] = shift + 0.001f * static_cast<float>(row);
      packet_->target_z[i] = 1.1f;
    }
    rays_.clear();
    for (int i = 0; i < count; ++i) rays_.push_back(packet_->trace_ray(i));
    hits_.resize(rays_.size());
  }

  using Walk = std::function<bool(const CancelToken* cancel, WalkStats* stats)>;
  // It leaves off at the look that finds none left, which comes soon after the last.
  void ExpectLooks(const std::string& name, uint64_t most_tests, const Walk& walk) const {
    for (const uint32_t looks : {0u, 1u, 2u, 3u, 5u}) {
      CancelToken cancel;
      cancel.set_looks_left(looks);
      WalkStats stats;
      EXPECT_FALSE(walk(&cancel, &stats)) << name << " after " << looks << " looks";
      EXPECT_LE(stats.triangle_tests, (looks + 1) * most_tests)
          << name << " after " << looks << " looks";
    }
  }

  const CulledKernels& culled() const { return CulledKernelsFor(GetParam()); }

  IndexedGeometry scene_;
  const std::unique_ptr<RayPacket> packet_ = std::make_unique<RayPacket>();
  std::vector<TraceRay> rays_;
  std::vector<Hit> hits_;
};
SIGHTLINE_FOR_EACH_TARGET(CoincidentTrianglesTest);

TEST_P(CoincidentTrianglesTest, RaysByThemselvesLook) {
  const Kernels& k = kernels();
  for (const bool past : {false, true}) {
    Aim(past, 64);
    // Where any hit will do, those that hit are answered at once.
    const auto single = past ? k.occluded_single : k.closest_single;
    const auto kd_single = past ? k.occluded_kd_single : k.closest_kd_single;
    const auto culled_single = past ? culled().occluded_single : culled().closest_single;
    ExpectLooks("single", kMostRayTests, [&](const CancelToken* cancel, WalkStats* stats) {
      return single(scene_, rays_, hits_, cancel, stats);
    });
    ExpectLooks("kd single", kMostRayTests, [&](const CancelToken* cancel, WalkStats* stats) {
      return kd_single(scene_, rays_, hits_, cancel, stats);
    });
    for (const CulledTree tree : {CulledTree::kBinaryBvh, CulledTree::kKdTree, CulledTree::kBvh}) {
      LeafCulling culling = LeafCulling::None();
      culling.tree = tree;
      ExpectLooks("culled single", kMostRayTests, [&](const CancelToken* cancel, WalkStats* stats) {
        return culled_single(scene_, culling, rays_, hits_, cancel, stats);
      });
    }
  }
}

TEST_P(CoincidentTrianglesTest, PacketsLook) {
  const Kernels& k = kernels();
  for (const bool past : {false, true}) {
    for (const int count : {RayPacket::kMaxRays, 64}) {  // All together; vector by vector.
      Aim(past, count);
      const auto packet = past ? k.occluded_kd_packet : k.closest_kd_packet;
      const auto rtt = past ? k.occluded_rtt : k.closest_rtt;
      const auto culled_packet = past ? culled().occluded_packet : culled().closest_packet;
      ExpectLooks("kd packet", kMostPacketTests, [&](const CancelToken* cancel, WalkStats* stats) {
        return packet(scene_, *packet_, cancel, stats);
      });
      for (const int tile_rays : {RttTileRays(1), RttTileRays(2), RttTileRays(5)}) {
        const RttOptions options = {.tile_rays = tile_rays};
        ExpectLooks("rtt", kMostPacketTests, [&](const CancelToken* cancel, WalkStats* stats) {
          return rtt(scene_, {packet_.get(), 1}, options, cancel, stats);
        });
      }
      for (const CulledTree tree :
           {CulledTree::kBinaryBvh, CulledTree::kKdTree, CulledTree::kBvh}) {
        LeafCulling culling = LeafCulling::None();
        culling.tree = tree;
        ExpectLooks("culled packet", kMostPacketTests,
                    [&](const CancelToken* cancel, WalkStats* stats) {
                      return culled_packet(scene_, culling, *packet_, cancel, stats);
                    });
      }
    }
  }
}

}  // namespace
}  // namespace sightline::testing_support
