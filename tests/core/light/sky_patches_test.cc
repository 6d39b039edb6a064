// SPDX-License-Identifier: Apache-2.0
#include "core/light/sky_patches.h"

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;

double Radians(double degrees) { return degrees * std::numbers::pi / 180; }

TEST(SkyPatchesTest, TregenzaAsPublished) {
  const std::vector<SkyPatch> sky = *SkyPatches(1);
  ASSERT_EQ(sky.size(), 145u);
  // Row by row: patches, altitude, solid angle.
  const struct {
    size_t count;
    double altitude, solid_angle;
  } rows[] = {{30, 6, 0.0435449227},  {30, 18, 0.0416418006}, {24, 30, 0.0473984151},
              {24, 42, 0.0406730411}, {18, 54, 0.0428934136}, {12, 66, 0.0445221864},
              {6, 78, 0.0455168385},  {1, 90, 0.0344199465}};
  size_t k = 0;
  for (uint32_t row = 0; row < 8; ++row) {
    for (size_t i = 0; i < rows[row].count; ++i, ++k) {
      EXPECT_EQ(sky[k].row, row) << k;
      EXPECT_NEAR(sky[k].altitude_degrees, rows[row].altitude, 1e-12) << k;
      EXPECT_NEAR(sky[k].azimuth_degrees,
                  360.0 / static_cast<double>(rows[row].count) * static_cast<double>(i), 1e-9)
          << k;
      EXPECT_NEAR(sky[k].solid_angle, rows[row].solid_angle, 1e-9) << k;
    }
  }
}

TEST(SkyPatchesTest, ReinhartsCounts) {
  EXPECT_EQ(SkyPatches(2)->size(), 577u);
  EXPECT_EQ(SkyPatches(4)->size(), 2305u);
  for (uint32_t m = 1; m <= kMaxSkySubdivision; ++m) {
    EXPECT_EQ(SkyPatches(m)->size(), SkyPatchCount(m)) << m;
    EXPECT_EQ(SkyPatches(m)->back().row, 7 * m) << m;
    EXPECT_EQ(SkyPatches(m)->back().altitude_degrees, 90) << m;
  }
}

TEST(SkyPatchesTest, TheWholeSkyOnce) {
  for (uint32_t m = 1; m <= kMaxSkySubdivision; ++m) {
    const std::vector<SkyPatch> sky = *SkyPatches(m);
    const double half_height = Radians(45 / (7.0 * m + 0.5));
    double sum = 0, level = 0;
    for (const SkyPatch& patch : sky) {
      EXPECT_GT(patch.solid_angle, 0);
      sum += patch.solid_angle;
      // The mean sine over a row is that of its middle times cos(height / 2); over a cap of half
      // a row it is 1 - (1 - cos(height / 2)) / 2.
      const double shrink = std::cos(half_height);
      level += patch.solid_angle * (patch.row == 7 * m
                                        ? (1 + shrink) / 2
                                        : shrink * std::sin(Radians(patch.altitude_degrees)));
    }
    EXPECT_NEAR(sum, 2 * std::numbers::pi, 1e-11) << m;
    EXPECT_NEAR(level, std::numbers::pi, 1e-11) << m;  // What an even sky gives level ground.
  }
}

// Every direction lies in one patch, within half its height and width of the centre.
TEST(SkyPatchesTest, CentresStandInTheirPatches) {
  testing_support::TestRng rng;
  for (const uint32_t m : {1u, 2u, 3u, 4u}) {
    const std::vector<SkyPatch> sky = *SkyPatches(m);
    const double height = 90 / (7 * m + 0.5);
    std::vector<size_t> in_row(7 * m + 1);
    for (const SkyPatch& patch : sky) ++in_row[patch.row];
    for (int i = 0; i < 2000; ++i) {
      const double altitude = std::asin(rng.Uniform(0, 1)) * 180 / std::numbers::pi;
      const double azimuth = rng.Uniform(0, 360);
      int holders = 0;
      for (const SkyPatch& patch : sky) {
        const double width = 360.0 / static_cast<double>(in_row[patch.row]);
        const double up = altitude - patch.altitude_degrees;
        const double around = std::remainder(azimuth - patch.azimuth_degrees, 360);
        holders += std::abs(up) <= height / 2 && std::abs(around) <= width / 2 ? 1 : 0;
      }
      EXPECT_EQ(holders, 1) << "subdivision " << m << ", altitude " << altitude << ", azimuth "
                            << azimuth;
    }
  }
}

TEST(SkyPatchesTest, BadSubdivisionsAreNamed) {
  for (const uint32_t bad : {0u, kMaxSkySubdivision + 1}) {
    const absl::Status s = SkyPatches(bad).status();
    EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(s.message()),
                HasSubstr("sky subdivision = " + std::to_string(bad) + " is outside 1 .. 16"));
  }
}

}  // namespace
}  // namespace sightline
