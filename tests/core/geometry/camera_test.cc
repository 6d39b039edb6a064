// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/camera.h"

#include <cmath>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::TestRng;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

Camera MakeCamera() {
  absl::StatusOr<Camera> camera = LookAt({0, -5, 2}, {0, 0, 2}, {0, 0, 1}, 60.0, 640, 480);
  EXPECT_TRUE(camera.ok()) << camera.status();
  return *camera;
}

void ExpectInvalid(const absl::Status& status, const std::string& part) {
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr(part));
}

TEST(LookAtTest, LooksWhereItIsTold) {
  const Camera camera = MakeCamera();
  EXPECT_EQ(camera.eye, (Vec3d{0, -5, 2}));
  EXPECT_EQ(camera.forward, (Vec3d{0, 1, 0}));
  EXPECT_EQ(camera.right, (Vec3d{1, 0, 0}));
  EXPECT_EQ(camera.up, (Vec3d{0, 0, 1}));
  EXPECT_DOUBLE_EQ(camera.tan_half_fov_y, std::sqrt(3.0) / 3.0);
  EXPECT_EQ(camera.width, 640u);
  EXPECT_EQ(camera.height, 480u);
}

TEST(LookAtTest, RefusesWhatGivesNoPicture) {
  const Vec3d eye{1, 2, 3}, at{4, 5, 6}, up{0, 0, 1};
  ExpectInvalid(LookAt(eye, eye, up, 50, 8, 8).status(), "eye = at = (1, 2, 3)");
  ExpectInvalid(LookAt(eye, at, {0, 0, 0}, 50, 8, 8).status(), "up = (0, 0, 0)");
  ExpectInvalid(LookAt(eye, at, {-2, -2, -2}, 50, 8, 8).status(), "along the view direction");
  for (double fov : {0.0, -1.0, 180.0, 360.0, kNan, kInfinity}) {
    ExpectInvalid(LookAt(eye, at, up, fov, 8, 8).status(), "fov = ");
  }
  ExpectInvalid(LookAt(eye, at, up, 179.95, 8, 8).status(), "tan_half_fov_y");
  ExpectInvalid(LookAt(eye, at, up, 1e-5, 8, 8).status(), "tan_half_fov_y");
  ExpectInvalid(LookAt(eye, at, up, 50, 0, 8).status(), "width = 0");
  ExpectInvalid(LookAt(eye, at, up, 50, 8, 0).status(), "height = 0");
  ExpectInvalid(LookAt(eye, at, up, 50, kMaxImageSide + 1, 8).status(), "width = 65537");
  ExpectInvalid(LookAt({kNan, 0, 0}, at, up, 50, 8, 8).status(), "not finite");
  ExpectInvalid(LookAt(eye, {kInfinity, 0, 0}, up, 50, 8, 8).status(), "not finite");
  ExpectInvalid(LookAt(eye, at, {0, kNan, 0}, 50, 8, 8).status(), "not finite");
  EXPECT_TRUE(LookAt(eye, at, up, 179.8, kMaxImageSide, 1).ok());
}

TEST(ValidateCameraTest, NamesTheFieldAtFault) {
  EXPECT_TRUE(ValidateCamera(MakeCamera()).ok());
  struct Case {
    const char* part;
    void (*spoil)(Camera&);
  };
  const Case cases[] = {
      {"camera.width = 0", [](Camera& c) { c.width = 0; }},
      {"camera.height = 70000", [](Camera& c) { c.height = 70000; }},
      {"camera.eye", [](Camera& c) { c.eye.y = kNan; }},
      {"camera.right", [](Camera& c) { c.right = c.right * 2.0; }},
      {"camera.up",
       [](Camera& c) {
         c.up = {0, 0, 0};
       }},
      {"camera.forward", [](Camera& c) { c.forward.x = kInfinity; }},
      {"right and up", [](Camera& c) { c.right = c.up; }},
      {"right and forward", [](Camera& c) { c.right = c.forward; }},
      {"up and forward",
       [](Camera& c) {
         c.up = {0, 0.6, 0.8};
       }},
      {"camera.tan_half_fov_y", [](Camera& c) { c.tan_half_fov_y = 0; }},
      {"camera.tan_half_fov_y", [](Camera& c) { c.tan_half_fov_y = kNan; }},
      {"camera.tan_half_fov_y", [](Camera& c) { c.tan_half_fov_y = 1147; }},
  };
  for (const Case& test : cases) {
    Camera camera = MakeCamera();
    test.spoil(camera);
    ExpectInvalid(ValidateCamera(camera), test.part);
  }
}

TEST(ValidateCameraTest, TakesABasisKeptInFloats) {
  TestRng rng;
  for (int i = 0; i < 1000; ++i) {
    const auto random = [&] {
      return Vec3d{rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)};
    };
    absl::StatusOr<Camera> camera = LookAt(random(), random(), random(), 40, 100, 50);
    ASSERT_TRUE(camera.ok()) << camera.status();
    camera->right = ToDouble(ToFloat(camera->right));
    camera->up = ToDouble(ToFloat(camera->up));
    camera->forward = ToDouble(ToFloat(camera->forward));
    EXPECT_TRUE(ValidateCamera(*camera).ok()) << ValidateCamera(*camera);
  }
}

// With axes along the world's, opposite pixels have exactly opposite directions: the image is not
// shifted.
TEST(PixelDirectionTest, IsSymmetricAboutTheCentre) {
  const Camera camera = MakeCamera();
  for (uint32_t y : {0u, 1u, 239u, 240u, 478u, 479u}) {
    for (uint32_t x : {0u, 3u, 319u, 320u, 639u}) {
      const Vec3f a = PixelDirection(camera, x, y);
      const Vec3f b = PixelDirection(camera, 639 - x, 479 - y);
      EXPECT_EQ(a.x, -b.x) << x << ", " << y;
      EXPECT_EQ(a.y, 1.0f);  // The depth along `forward` is the ray's parameter.
      EXPECT_EQ(a.z, -b.z) << x << ", " << y;
    }
  }
}

TEST(PixelDirectionTest, BeginsAtTheUpperLeftAndGoesThroughPixelCentres) {
  Camera camera = MakeCamera();
  camera.width = 4;
  camera.height = 2;
  camera.tan_half_fov_y = 1;  // So the image spans ±2 by ±1, pixels are squares of side 1.
  EXPECT_EQ(PixelDirection(camera, 0, 0), (Vec3f{-1.5f, 1, 0.5f}));
  EXPECT_EQ(PixelDirection(camera, 3, 0), (Vec3f{1.5f, 1, 0.5f}));
  EXPECT_EQ(PixelDirection(camera, 0, 1), (Vec3f{-1.5f, 1, -0.5f}));
  EXPECT_EQ(PixelDirection(camera, 2, 1), (Vec3f{0.5f, 1, -0.5f}));
}

TEST(PixelDirectionTest, IsTheStatedSequenceOfOperations) {
  TestRng rng;
  for (int i = 0; i < 2000; ++i) {
    const auto random = [&] {
      return Vec3d{rng.Uniform(-9, 9), rng.Uniform(-9, 9), rng.Uniform(-9, 9)};
    };
    absl::StatusOr<Camera> camera = LookAt(random(), random(), random(), rng.Uniform(1, 170),
                                           static_cast<uint32_t>(1 + rng.Below(4000)),
                                           static_cast<uint32_t>(1 + rng.Below(4000)));
    ASSERT_TRUE(camera.ok()) << camera.status();
    const uint32_t x = static_cast<uint32_t>(rng.Below(camera->width));
    const uint32_t y = static_cast<uint32_t>(rng.Below(camera->height));
    const double w = camera->width, h = camera->height;
    const volatile double aspect = w / h;
    const volatile double wide = camera->tan_half_fov_y * aspect;
    const volatile double u = 2.0 * (x + 0.5) / w - 1.0, v = 1.0 - 2.0 * (y + 0.5) / h;
    const volatile double sx = u * wide, sy = v * camera->tan_half_fov_y;
    for (int axis = 0; axis < 3; ++axis) {
      const volatile double right = camera->right[axis] * sx, up = camera->up[axis] * sy;
      const volatile double sum = camera->forward[axis] + right;
      EXPECT_EQ(PixelDirection(*camera, x, y)[axis], static_cast<float>(sum + up));
    }
  }
}

}  // namespace
}  // namespace sightline
