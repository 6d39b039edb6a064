// SPDX-License-Identifier: Apache-2.0
//
// Every ray of a packet of pixels lies where its grid says: slopes within kSlopeMargin of its
// block's corners, depths within what kDepthScale allows, components between the packet's corners'.
// Truth is in 113-bit arithmetic, of the stored rays in the stored frame.
#include "core/traverse/pixel_grid.h"

#include <algorithm>
#include <cmath>
#include <iostream>

#include "core/geometry/camera.h"
#include "core/shaft/margins.h"
#include "core/traverse/pixel_grid-inl.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::TestRng;
using Quad = __float128;

constexpr int kSide = PixelGrid::kMostSide;
constexpr int kBlocks = HWY_NAMESPACE::kShaftBlocks;
// Of what kDepthScale has room for beside the products and quotients that follow.
constexpr double kDepthRoom = 13.5 * 0x1p-24;

Quad DotQ(Vec3f a, Vec3f b) { return Quad{a.x} * b.x + Quad{a.y} * b.y + Quad{a.z} * b.z; }

// A camera as a client may send it: its basis off by what is allowed.
Camera RandomCamera(TestRng& rng, double widest) {
  const auto vector = [&rng](double size) {
    return Vec3d{rng.Uniform(-size, size), rng.Uniform(-size, size), rng.Uniform(-size, size)};
  };
  Camera camera;
  do {
    camera.width = static_cast<uint32_t>(rng.Uniform(64, 9000));
    camera.height = static_cast<uint32_t>(rng.Uniform(64, 9000));
    camera.tan_half_fov_y = std::exp2(rng.Uniform(-20, std::log2(widest)));
    const Vec3d forward = vector(1), side = vector(1);
    camera.forward = forward * (1 / Length(forward));
    const Vec3d right = Cross(camera.forward, side);
    camera.right = right * (1 / Length(right));
    camera.up = Cross(camera.right, camera.forward);
    if (rng.Chance(0.3))
      camera.forward = {1, 0, 0}, camera.right = {0, 1, 0}, camera.up = {0, 0, 1};
    const double skew = kBasisTolerance / 4;
    if (rng.Chance(0.5))
      camera.right = camera.right + vector(skew), camera.up = camera.up + vector(skew);
  } while (!ValidateCamera(camera).ok());
  return camera;
}

class PixelGridTest : public testing::Test {
 protected:
  // The pixels from a random one on. False: no frame holds them.
  bool Make(const Camera& camera) {
    const auto first = [&](uint32_t side) {
      return static_cast<uint32_t>(rng_.Uniform(0, side - kSide + 0.5));
    };
    const uint32_t x0 = first(camera.width), y0 = first(camera.height);
    for (uint32_t i = 0; i < kSide; ++i) {
      const Vec3d column = PixelColumn(camera, x0 + i), row = PixelRow(camera, y0 + i);
      for (int axis = 0; axis < 3; ++axis) {
        columns_[axis][i] = column[axis];
        rows_[axis][i] = row[axis];
      }
    }
    return MakePixelGrid({columns_[0], columns_[1], columns_[2]}, kSide,
                         {rows_[0], rows_[1], rows_[2]}, kSide, &grid_);
  }

  Vec3f Ray(int x, int y) const {
    Vec3f ray;
    for (int axis = 0; axis < 3; ++axis) {
      ray[axis] = static_cast<float>(columns_[axis][x] + rows_[axis][y]);
    }
    return ray;
  }

  TestRng rng_;
  double columns_[3][kSide], rows_[3][kSide];
  PixelGrid grid_;
};

TEST_F(PixelGridTest, BlocksHoldTheirRays) {
  alignas(64) float x0[kBlocks], x1[kBlocks], y0[kBlocks], y1[kBlocks], depth[kBlocks];
  double worst_slope = -1, worst_depth = -1;  // As shares of the margins.
  int made = 0;
  const int64_t cameras = testing_support::ScaledCount(3000);
  for (int64_t n = 0; n < cameras; ++n) {
    Camera camera = RandomCamera(rng_, 2);
    if (rng_.Chance(0.5)) {  // A picture that fills the grid: slopes as large as frames have them.
      camera.width = camera.height = kSide;
      camera.tan_half_fov_y = rng_.Uniform(0.3, 1.3);
    }
    if (!Make(camera)) continue;
    ++made;
    const int column = 16 * static_cast<int>(rng_.Uniform(0, 3.999));
    const int row = 16 * static_cast<int>(rng_.Uniform(0, 3.999));
    HWY_NAMESPACE::BoundBlocks(grid_, column, row, x0, x1, y0, y1, depth);
    for (int y = 0; y < 16; ++y) {
      for (int x = 0; x < 16; ++x) {
        const Vec3f ray = Ray(column + x, row + y);
        const int b = y / 4 * 4 + x / 4;
        const Quad z = DotQ(grid_.frame.w, ray);
        const Quad beyond[] = {
            x0[b] - DotQ(grid_.frame.u, ray) / z, DotQ(grid_.frame.u, ray) / z - x1[b],
            y0[b] - DotQ(grid_.frame.v, ray) / z, DotQ(grid_.frame.v, ray) / z - y1[b]};
        for (const Quad off : beyond) {
          worst_slope = std::max(worst_slope, static_cast<double>(off / kSlopeMargin));
        }
        worst_depth = std::max(worst_depth, static_cast<double>((z / depth[b] - 1) / kDepthRoom));
        ASSERT_LE(MaxAbs(ray), grid_.norm_inf);
      }
    }
    ASSERT_LE(worst_slope, 1) << "camera " << n;
    ASSERT_LE(worst_depth, 1) << "camera " << n;
  }
  std::cout << "kSlopeMargin: " << worst_slope << ", depths: " << worst_depth << "\n";
  EXPECT_GT(made, cameras / 2);
  EXPECT_GT(worst_slope, 1.0 / 64);  // As large a rounding as this was met.
  EXPECT_GT(worst_depth, 1.0 / 64);
}

// Where FinishHits looks for the rays' octant.
TEST_F(PixelGridTest, ComponentsLieBetweenTheCorners) {
  for (int64_t n = 0; n < testing_support::ScaledCount(100); ++n) {
    Make(RandomCamera(rng_, 100));
    Vec3f least, most;
    for (int k = 0; k < 3; ++k) {
      const float corners[] = {Ray(0, 0)[k], Ray(15, 0)[k], Ray(0, 15)[k], Ray(15, 15)[k]};
      least[k] = *std::min_element(corners, corners + 4);
      most[k] = *std::max_element(corners, corners + 4);
    }
    for (int y = 0; y < 16; ++y) {
      for (int x = 0; x < 16; ++x) {
        for (int k = 0; k < 3; ++k) {
          ASSERT_GE(Ray(x, y)[k], least[k]);
          ASSERT_LE(Ray(x, y)[k], most[k]);
        }
      }
    }
  }
}

TEST_F(PixelGridTest, RaysTooWideForAFrameHaveNone) {
  int refused = 0;
  for (int n = 0; n < 100; ++n) {
    Camera camera = RandomCamera(rng_, 2);
    camera.width = camera.height = kSide;  // All of the picture.
    camera.tan_half_fov_y = rng_.Uniform(2.4, kMaxTanHalfFov);
    refused += Make(camera) ? 0 : 1;
  }
  EXPECT_EQ(refused, 100);
}

}  // namespace
}  // namespace sightline
