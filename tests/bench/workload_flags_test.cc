// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/workload_flags.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline::bench {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(ParseSizesTest, WidthsAndSides) {
  const auto sizes = ParseSizes("640x480,1920,3840,1,65x3");
  ASSERT_TRUE(sizes.ok()) << sizes.status();
  std::vector<uint32_t> sides;
  for (const ImageSize& size : *sizes) {
    sides.push_back(size.width);
    sides.push_back(size.height);
  }
  EXPECT_THAT(sides, ElementsAre(640, 480, 1920, 1080, 3840, 2160, 1, 1, 65, 3));
}

TEST(ParseSizesTest, WhatIsNoSizeIsRefused) {
  for (const char* text : {"", "0", "640x0", "x", "640x", "640x480x2", "wide", "640,", ",640", "-1",
                           "4294967296", "1000000x2"}) {
    const auto sizes = ParseSizes(text);
    EXPECT_FALSE(sizes.ok()) << text;
    EXPECT_THAT(std::string(sizes.status().message()), HasSubstr("WIDTHxHEIGHT")) << text;
  }
}

TEST(WorkloadFlagsTest, AllIsEveryWorkloadOnce) {
  WorkloadFlags flags;
  flags.scenes = {"builtin:hall"};
  flags.workloads = {"all"};
  flags.sweep = {{1920, 1080}, {3840, 2160}};
  ASSERT_TRUE(flags.Check().ok());
  EXPECT_THAT(flags.Workloads(),
              ElementsAre("primary", "shadow", "sun", "area", "points-sky", "points-lights",
                          "points-sky-shuffled", "points-lights-shuffled", "segments"));
  std::vector<std::string> names;
  for (const std::string& workload : flags.Workloads()) {
    for (const ImageSize& size : flags.Sizes(workload)) {
      const auto spec = flags.Spec(workload, size);
      ASSERT_TRUE(spec.ok()) << spec.status();
      names.push_back(Describe(*spec));
    }
  }
  // Those with pictures at every size.
  EXPECT_THAT(names, ElementsAre("primary", "primary", "shadow", "shadow", "sun", "sun", "area",
                                 "area", "points-sky", "points-lights", "points-sky-shuffled",
                                 "points-lights-shuffled", "segments"));
}

TEST(WorkloadFlagsTest, PointsGoByTheirFlagsUnlessNamed) {
  WorkloadFlags flags;
  flags.lights = "lights";
  flags.shuffled = true;
  EXPECT_EQ(Describe(*flags.Spec("points", {64, 64})), "points-lights-shuffled");
  EXPECT_EQ(Describe(*flags.Spec("points-sky", {64, 64})), "points-sky");
}

TEST(WorkloadFlagsTest, UnknownWorkloadsAreUsageErrors) {
  WorkloadFlags flags;
  flags.scenes = {"builtin:hall"};
  EXPECT_FALSE(flags.Check().ok());
  for (const char* name : {"points-moon", "everything", ""}) {
    flags.workloads = {name};
    EXPECT_THAT(std::string(flags.Check().message()), HasSubstr("--workload wants one of"));
  }
}

}  // namespace
}  // namespace sightline::bench
