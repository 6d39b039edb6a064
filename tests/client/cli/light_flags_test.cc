// SPDX-License-Identifier: Apache-2.0
#include "client/cli/light_flags.h"

#include <cmath>
#include <string>
#include <vector>

#include "client/cli/exit_code.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline::cli {
namespace {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class LightFlagsTest : public testing::Test {
 protected:
  LightFlagsTest() : flags_("test [flags]", "A test.") { lights_.Register(&flags_); }

  std::vector<client::Light> Lights(const std::vector<std::string>& args, Vec3d up = {0, 0, 1}) {
    const auto words = flags_.Parse(args);
    EXPECT_TRUE(words.ok()) << words.status();
    const absl::StatusOr<std::vector<client::Light>> lights = lights_.Lights(up);
    EXPECT_TRUE(lights.ok()) << lights.status();
    return lights.value_or(std::vector<client::Light>());
  }
  std::string Error(const std::vector<std::string>& args) {
    const absl::Status status = flags_.Parse(args).status();
    EXPECT_EQ(ToExitCode(status), kExitUsage) << status;
    return std::string(status.message());
  }

  FlagSet flags_;
  LightFlags lights_;
};

TEST_F(LightFlagsTest, NoneAtFirst) {
  EXPECT_FALSE(lights_.given());
  EXPECT_TRUE(Lights({}).empty());
  EXPECT_FALSE(lights_.given());
}

TEST_F(LightFlagsTest, EveryKindInOrder) {
  const std::vector<client::Light> lights =
      Lights({"--sky=145", "--sun-at", "2026-03-20T12:08Z,45,0", "--sun", "0,0,2", "--light=1,2,3",
              "--light", "4,5,6"});
  EXPECT_TRUE(lights_.given());
  ASSERT_EQ(lights.size(), 2u + 1 + 1 + 145);
  EXPECT_EQ(lights[0].kind, client::Light::Kind::kPoint);
  EXPECT_THAT(lights[1].position, ElementsAre(4, 5, 6));
  EXPECT_THAT(lights[2].direction, ElementsAre(0, 0, 2));
  // At the equinox at noon the sun stands 45° high in the south: -y.
  EXPECT_EQ(lights[3].kind, client::Light::Kind::kDirectional);
  const double half = std::sqrt(0.5);
  EXPECT_THAT(lights[3].direction,
              ElementsAre(DoubleNear(0, 0.01), DoubleNear(-half, 0.01), DoubleNear(half, 0.01)));
  EXPECT_THAT(lights.back().direction,
              ElementsAre(DoubleNear(0, 1e-12), DoubleNear(0, 1e-12), DoubleNear(1, 1e-12)));
  double on_level_ground = 0;
  for (size_t k = 4; k < lights.size(); ++k) {
    EXPECT_GT(lights[k].direction[2], 0);
    on_level_ground += lights[k].weight * lights[k].direction[2];
  }
  EXPECT_NEAR(on_level_ground, 1, 0.01);
}

TEST_F(LightFlagsTest, EverySkyHasItsPatches) {
  for (const char* patches : {"145", "577", "2305"}) {
    EXPECT_EQ(Lights({"--sky", patches}).size(), std::stoul(patches));
  }
}

TEST_F(LightFlagsTest, NorthIsWhereItIsSaid) {
  // The sun of a morning in the east, with y up: north is -z, east +x.
  const std::vector<std::string> morning = {"--sun-at", "2026-03-20T08:08Z,0,0"};
  EXPECT_GT(Lights(morning, {0, 1, 0})[0].direction[0], 0.8);
  // With north along +x, east is +z.
  EXPECT_GT(Lights({"--north", "1,0,0"}, {0, 1, 0})[0].direction[2], 0.8);
}

TEST_F(LightFlagsTest, TimesWithAnOffsetAndSeconds) {
  const SunPosition noon = ParseTimedSun("2026-06-21T12:00Z,52.5,13.4")->position;
  for (const char* same : {"2026-06-21T14:00+02:00,52.5,13.4", "2026-06-21T12:00:00.0Z,52.5,13.4",
                           "2026-06-21T06:30:00-05:30,52.5,13.4"}) {
    const absl::StatusOr<TimedSun> sun = ParseTimedSun(same);
    ASSERT_TRUE(sun.ok()) << same << sun.status();
    EXPECT_EQ(sun->position.azimuth_degrees, noon.azimuth_degrees) << same;
  }
}

TEST_F(LightFlagsTest, MistakesAreNamed) {
  for (const char* bad :
       {"", "2026-06-21T12:00Z", "2026-06-21T12:00Z,1", "2026-06-21T12:00Z,1,2,3",
        "2026-06-21T12:00,1,2", "2026-06-21 12:00Z,1,2", "2026-02-30T12:00Z,1,2", "12:00Z,1,2",
        "infinite-future,1,2", "2026-06-21T12:00Z,north,2", "2026-06-21T12:00Z,,2"}) {
    EXPECT_THAT(Error({"--sun-at", bad}), HasSubstr("TIME,LATITUDE,LONGITUDE")) << bad;
  }
  EXPECT_THAT(Error({"--sun-at", "2026-06-21T12:00Z,95,13.4"}), HasSubstr("latitude = 95"));
  EXPECT_THAT(Error({"--sun-at", "1600-06-21T12:00Z,52,13.4"}), HasSubstr("1800 .. 2200"));
  EXPECT_THAT(Error({"--sun-at", "2026-06-21T00:00Z,52,13.4"}),
              HasSubstr("degrees below the horizon; give a time between sunrise and sunset"));
  EXPECT_THAT(Error({"--sky", "146"}), HasSubstr("none, 145, 577, 2305"));
  EXPECT_THAT(Error({"--sky", "145", "--north", "0,0"}), HasSubstr("--north"));
}

TEST_F(LightFlagsTest, NorthWithoutADirectionIsAMistake) {
  ASSERT_TRUE(flags_.Parse(std::vector<std::string>{"--sky=145", "--north=0,0,1"}).ok());
  const absl::Status status = lights_.Lights({0, 0, 1}).status();
  EXPECT_EQ(ToExitCode(status), kExitUsage);
  EXPECT_THAT(std::string(status.message()), HasSubstr("north = (0, 0, 1) points up or down"));
  EXPECT_EQ(ToExitCode(lights_.Lights({0, 0, 0}).status()), kExitUsage);
}

}  // namespace
}  // namespace sightline::cli
