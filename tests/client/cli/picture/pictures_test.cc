// SPDX-License-Identifier: Apache-2.0
#include "client/cli/picture/pictures.h"

#include <cmath>
#include <limits>

#include "client/cli/picture/color_map.h"
#include "gtest/gtest.h"

namespace sightline::cli {
namespace {

float Luminance(Rgb c) { return 0.2126f * c.r + 0.7152f * c.g + 0.0722f * c.b; }
bool Shown(Rgb c) {
  for (float v : {c.r, c.g, c.b}) {
    if (!(v >= 0 && v <= 1)) return false;
  }
  return true;
}

TEST(ColorMapTest, LightnessRisesAndColoursCanBeShown) {
  for (const ColorMap* map : {&ColorMap::Depth(), &ColorMap::Cost()}) {
    float last = -1;
    for (int i = 0; i <= 1000; ++i) {
      const Rgb color = (*map)(static_cast<float>(i) / 1000);
      EXPECT_TRUE(Shown(color)) << i;
      EXPECT_GE(Luminance(color), last) << i;
      last = Luminance(color);
    }
    EXPECT_EQ(Luminance((*map)(-5)), Luminance((*map)(0)));
    EXPECT_EQ(Luminance((*map)(7)), Luminance((*map)(1)));
    EXPECT_EQ(Luminance((*map)(std::nanf(""))), Luminance((*map)(0)));
  }
}

TEST(ColorMapTest, OklabWhiteBlackAndGrey) {
  const Rgb white = OklchToRgb(1, 0, 0);
  EXPECT_NEAR(white.r, 1, 1e-3);
  EXPECT_NEAR(white.g, 1, 1e-3);
  EXPECT_NEAR(white.b, 1, 1e-3);
  EXPECT_EQ(Luminance(OklchToRgb(0, 0, 0)), 0);
  EXPECT_TRUE(Shown(OklchToRgb(0.7f, 0.4f, 2.0f)));
}

TEST(ObjectColorTest, NeighboursDiffer) {
  for (uint32_t i = 0; i < 200; ++i) {
    const Rgb a = ObjectColor(i), b = ObjectColor(i + 1);
    EXPECT_TRUE(Shown(a));
    EXPECT_GT(std::abs(a.r - b.r) + std::abs(a.g - b.g) + std::abs(a.b - b.b), 0.05f) << i;
  }
}

// A camera at the origin that looks along -z, y up.
client::Camera LookingAhead(uint32_t width, uint32_t height) {
  return {.eye = {0, 0, 0},
          .right = {1, 0, 0},
          .up = {0, 1, 0},
          .forward = {0, 0, -1},
          .tan_half_fov_y = 1,
          .width = width,
          .height = height};
}

// The plane z = a x + b y - 10, seen whole by that camera.
client::TileImage Plane(uint32_t width, uint32_t height, double a, double b) {
  client::TileImage image;
  image.width = width;
  image.height = height;
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      const double dx = (2 * (x + 0.5) / width - 1) * width / height,
                   dy = 1 - 2 * (y + 0.5) / height;
      // t · (dx, dy, -1): -t = a t dx + b t dy - 10.
      image.depth.push_back(static_cast<float>(10 / (1 + a * dx + b * dy)));
      image.object.push_back(0);
      image.triangle.push_back(x % 3);  // Several triangles of one plane.
      image.hit.push_back(1);
    }
  }
  return image;
}

TEST(PixelNormalsTest, OfAPlaneAreThePlanes) {
  for (const auto& [a, b] : {std::pair(0.0, 0.0), {0.3, 0.0}, {0.0, -0.4}, {0.2, 0.25}}) {
    const client::TileImage image = Plane(40, 30, a, b);
    const Vec3d expected = Vec3d{-a, -b, 1} * (1 / std::sqrt(a * a + b * b + 1));
    for (const Vec3d& n : PixelNormals(image, LookingAhead(40, 30))) {
      EXPECT_NEAR(n.x, expected.x, 1e-3);
      EXPECT_NEAR(n.y, expected.y, 1e-3);
      EXPECT_NEAR(n.z, expected.z, 1e-3);
    }
  }
}

TEST(PixelNormalsTest, MissesHaveNoneAndLonePixelsFaceTheEye) {
  client::TileImage image = Plane(3, 3, 0, 0);
  for (size_t i = 0; i < 9; ++i) {
    if (i == 4) continue;
    image.object[i] = image.triangle[i] = client::kNone;
    image.depth[i] = std::numeric_limits<float>::infinity();
  }
  const std::vector<Vec3d> normals = PixelNormals(image, LookingAhead(3, 3));
  EXPECT_EQ(normals[0], (Vec3d{}));
  EXPECT_NEAR(normals[4].z, 1, 1e-6);
}

TEST(LitPictureTest, LitIsBrighterThanShadowAndMissesAreBackground) {
  client::TileImage image = Plane(8, 8, 0, 0);
  image.samples = 1;
  image.lit.assign(64, 0);
  image.lit[9] = 1;
  image.lit[63] = 255;
  image.object[63] = client::kNone;
  const std::vector<client::Light> lights = {client::Light::Point({0, 0, 0})};
  const Image picture = LitPicture(image, LookingAhead(8, 8), lights, {0, 1, 0});
  EXPECT_GT(Luminance(picture.pixels[9]), 2 * Luminance(picture.pixels[18]));
  EXPECT_GT(Luminance(picture.pixels[18]), 0.01f);
  const Image empty = LitPicture(image, LookingAhead(8, 8), {}, {0, 1, 0});
  EXPECT_EQ(Luminance(empty.pixels[63]), Luminance(picture.pixels[63]));
  // A light behind the surface gives nothing, whatever its bit says.
  const std::vector<client::Light> behind = {client::Light::Point({0, 0, -20})};
  const Image dark = LitPicture(image, LookingAhead(8, 8), behind, {0, 1, 0});
  EXPECT_NEAR(Luminance(dark.pixels[9]), Luminance(dark.pixels[18]), 0.02f);
}

// A hundred weak lights are as one: the patches of a sky do not drown a sun.
TEST(LitPictureTest, LightsCountByTheirWeight) {
  client::TileImage image = Plane(4, 4, 0, 0);
  const auto luminance = [&](size_t count, double weight) {
    image.samples = static_cast<uint32_t>(count);
    image.lit.assign(16 * count, 1);
    std::vector<client::Light> lights(count, client::Light::Point({0, 0, 0}));
    for (client::Light& light : lights) light.weight = weight;
    return Luminance(LitPicture(image, LookingAhead(4, 4), lights, {0, 1, 0}).pixels[5]);
  };
  EXPECT_NEAR(luminance(100, 0.01), luminance(1, 1), 0.05);
  EXPECT_LT(luminance(1, 0.01), luminance(1, 1) - 0.2);
  EXPECT_GT(luminance(100, 1), luminance(1, 1) + 0.1);
}

TEST(DepthPictureTest, NearIsLight) {
  client::TileImage image;
  image.width = 4;
  image.height = 1;
  image.depth = {1, 2, 4, std::numeric_limits<float>::infinity()};
  const Image picture = DepthPicture(image);
  EXPECT_GT(Luminance(picture.pixels[0]), Luminance(picture.pixels[1]));
  EXPECT_GT(Luminance(picture.pixels[1]), Luminance(picture.pixels[2]));
  EXPECT_TRUE(Shown(picture.pixels[3]));
}

TEST(StrategyPictureTest, EachWayHasItsHueAndNoRayIsDark) {
  const client::TileImage image = Plane(5, 1, 0, 0);
  const std::vector<uint8_t> answered_by = {0, 1, 2, 3, 4};
  const Image picture = StrategyPicture(image, LookingAhead(5, 1), answered_by);
  EXPECT_LT(Luminance(picture.pixels[0]), 0.06f);
  ASSERT_EQ(StrategyKey().size(), 4u);
  for (size_t k = 0; k < 4; ++k) {
    const Rgb c = picture.pixels[k + 1], key = StrategyKey()[k].light;
    EXPECT_TRUE(Shown(key)) << k;
    // The key's colour, a little darker: the plane is seen from straight ahead, but not everywhere.
    const float share = Luminance(c) / Luminance(key);
    EXPECT_GT(share, 0.5f) << k;
    EXPECT_LE(share, 1.0001f) << k;
    EXPECT_NEAR(c.r, key.r * share, 1e-3) << k;
    EXPECT_NEAR(c.g, key.g * share, 1e-3) << k;
    EXPECT_NEAR(c.b, key.b * share, 1e-3) << k;
  }
  // As their names say.
  const auto key = [](size_t k) { return StrategyKey()[k].light; };
  EXPECT_GT(key(0).b, std::max(key(0).r, key(0).g));
  EXPECT_GT(std::min(key(1).r, key(1).g), 2 * key(1).b);
  EXPECT_GT(key(2).g, std::max(key(2).r, key(2).b));
  EXPECT_GT(key(3).r, 2 * std::max(key(3).g, key(3).b));
}

TEST(CostPictureTest, TilesOfMoreWorkAreLighter) {
  client::TileImage image;
  image.width = 6;
  image.height = 2;
  image.costs.resize(3);
  for (uint32_t i = 0; i < 3; ++i) {
    image.costs[i].rect = {.x = 2 * i, .y = 0, .width = 2, .height = 2};
    image.costs[i].statistics.nodes = i == 0 ? 1 : i == 1 ? 50 : 1000;
  }
  const Image picture = CostPicture(image);
  EXPECT_LT(Luminance(picture.at(0, 0)), Luminance(picture.at(2, 1)));
  EXPECT_LT(Luminance(picture.at(3, 0)), Luminance(picture.at(5, 1)));
}

}  // namespace
}  // namespace sightline::cli
