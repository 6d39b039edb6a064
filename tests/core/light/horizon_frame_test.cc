// SPDX-License-Identifier: Apache-2.0
#include "core/light/horizon_frame.h"

#include <cmath>
#include <limits>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;

void ExpectNear(Vec3d a, Vec3d b) {
  EXPECT_LE(MaxAbs(a - b), 1e-12) << a.x << " " << a.y << " " << a.z << " is not " << b.x << " "
                                  << b.y << " " << b.z;
}

TEST(HorizonFrameTest, TurnsByWayOfEast) {
  const HorizonFrame frame = *MakeHorizonFrame({0, 0, 2}, {0, 3, 0});
  ExpectNear(frame.Toward(0, 0), {0, 1, 0});
  ExpectNear(frame.Toward(0, 90), {1, 0, 0});
  ExpectNear(frame.Toward(0, 180), {0, -1, 0});
  ExpectNear(frame.Toward(90, 123), {0, 0, 1});
  ExpectNear(frame.Toward(-30, 270), {-std::sqrt(0.75), 0, -0.5});
}

TEST(HorizonFrameTest, ModellersNorth) {
  const HorizonFrame y_up = *MakeHorizonFrame({0, 1, 0}, DefaultNorth({0, 1, 0}));
  ExpectNear(y_up.north, {0, 0, -1});
  ExpectNear(y_up.east, {1, 0, 0});
  const HorizonFrame z_up = *MakeHorizonFrame({0, 0, 1}, DefaultNorth({0, 0, 1}));
  ExpectNear(z_up.north, {0, 1, 0});
  ExpectNear(z_up.east, {1, 0, 0});
}

TEST(HorizonFrameTest, IsOrthonormalWhateverItIsMadeFrom) {
  testing_support::TestRng rng;
  for (int i = 0; i < 1000; ++i) {
    const double size = std::ldexp(1.0, static_cast<int>(rng.Below(1800)) - 900);
    const Vec3d up = Vec3d{rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)} * size;
    for (const Vec3d north : {DefaultNorth(up), Vec3d{rng.Uniform(1, 2), rng.Uniform(-1, 1), 0}}) {
      const absl::StatusOr<HorizonFrame> frame = MakeHorizonFrame(up, north);
      if (!frame.ok()) {
        // A random north may stand upright; the modellers' may not.
        EXPECT_NE(north, DefaultNorth(up)) << frame.status();
        continue;
      }
      for (const Vec3d v : {frame->up, frame->north, frame->east}) {
        EXPECT_NEAR(Length(v), 1, 1e-12);
      }
      EXPECT_NEAR(Dot(frame->up, frame->north), 0, 1e-12);
      ExpectNear(Cross(frame->north, frame->up), frame->east);
      EXPECT_GT(Dot(frame->up, up * (1 / size)), 0);
      EXPECT_GT(Dot(frame->north, north), 0);
    }
  }
}

TEST(HorizonFrameTest, BadVectorsAreNamed) {
  const auto message = [](Vec3d up, Vec3d north) {
    const absl::Status s = MakeHorizonFrame(up, north).status();
    EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument);
    return std::string(s.message());
  };
  EXPECT_THAT(message({0, 0, 0}, {0, 1, 0}), HasSubstr("up = (0, 0, 0) has no direction"));
  EXPECT_THAT(message({0, 0, 1}, {0, 0, 0}), HasSubstr("north = (0, 0, 0) has no direction"));
  EXPECT_THAT(message({0, std::numeric_limits<double>::infinity(), 1}, {0, 1, 0}),
              HasSubstr("up = (0, inf, 1)"));
  EXPECT_THAT(message({0, 0, 1}, {0, 0, -7}), HasSubstr("north = (0, 0, -7) points up or down"));
  EXPECT_THAT(message({0, 0, 1}, {0x1p-11, 0, 1}), HasSubstr("points up or down"));
  EXPECT_TRUE(MakeHorizonFrame({0, 0, 1}, {0x1p-9, 0, 1}).ok());
}

}  // namespace
}  // namespace sightline
