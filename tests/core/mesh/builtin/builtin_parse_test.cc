// SPDX-License-Identifier: Apache-2.0
#include <set>
#include <string>

#include "core/mesh/builtin/builtin.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(ParseBuiltin, ReadsNamesSizesAndSeeds) {
  const auto parse = [](std::string_view text) {
    const absl::StatusOr<BuiltinSpec> spec = ParseBuiltin(text);
    EXPECT_TRUE(spec.ok()) << text << ": " << spec.status();
    return spec.ok() ? *spec : BuiltinSpec{};
  };
  EXPECT_EQ(parse("hall"), (BuiltinSpec{"hall", 0, kDefaultBuiltinSeed}));
  EXPECT_EQ(parse("hall:1000000"), (BuiltinSpec{"hall", 1'000'000, kDefaultBuiltinSeed}));
  EXPECT_EQ(parse("forest:2M,seed=7"), (BuiltinSpec{"forest", 2'000'000, 7}));
  EXPECT_EQ(parse("forest:1.5M"), (BuiltinSpec{"forest", 1'500'000, kDefaultBuiltinSeed}));
  EXPECT_EQ(parse("room:250k"), (BuiltinSpec{"room", 250'000, kDefaultBuiltinSeed}));
  EXPECT_EQ(parse("sphere:10M"),
            (BuiltinSpec{"sphere", kMaxBuiltinTriangles, kDefaultBuiltinSeed}));
  EXPECT_EQ(parse("box:seed=18446744073709551615"), (BuiltinSpec{"box", 0, UINT64_MAX}));
  EXPECT_EQ(parse("box,seed=3"), (BuiltinSpec{"box", 0, 3}));
}

TEST(ParseBuiltin, SaysWhatIsWrong) {
  const auto error = [](std::string_view text) {
    const absl::StatusOr<BuiltinSpec> spec = ParseBuiltin(text);
    EXPECT_EQ(spec.status().code(), absl::StatusCode::kInvalidArgument) << text;
    return std::string(spec.status().message());
  };
  EXPECT_THAT(error("castle"), AllOf(HasSubstr("castle"), HasSubstr("hall"), HasSubstr("box"),
                                     HasSubstr("10000000")));
  EXPECT_THAT(error(""), HasSubstr("known are"));
  EXPECT_THAT(error("hall:20M"), AllOf(HasSubstr("20000000"), HasSubstr("10000000")));
  EXPECT_THAT(error("hall:5"), AllOf(HasSubstr("hall"), HasSubstr("5 triangles")));
  EXPECT_THAT(error("hall:0"), HasSubstr("0 triangles"));
  for (std::string_view count :
       {"hall:", "hall:-5", "hall:many", "hall:1.M", "hall:.5M", "hall:1.5", "hall:1e6",
        "hall:1.2345678M", "hall:M", "hall:99999999999999999999", "hall:9999999999999999999M"}) {
    EXPECT_THAT(error(count), HasSubstr("no number of triangles")) << count;
  }
  EXPECT_THAT(error("hall:1M,seed=x"), HasSubstr("no seed"));
  EXPECT_THAT(error("hall:1M,seed="), HasSubstr("no seed"));
  EXPECT_THAT(error("hall:1M,seed=18446744073709551616"), HasSubstr("no seed"));
  EXPECT_THAT(error("hall:1M,color=red"), HasSubstr("color=red"));
  EXPECT_THAT(error("hall,1M"), HasSubstr("1M"));
}

TEST(FormatBuiltin, WritesEveryPartOut) {
  const std::pair<std::string_view, std::string_view> cases[] = {
      {"hall", "hall:250000,seed=1"},
      {"city:1.5M", "city:1500000,seed=1"},
      {"box,seed=18446744073709551615", "box:10000,seed=18446744073709551615"},
  };
  for (const auto& [text, full] : cases) {
    const absl::StatusOr<BuiltinSpec> spec = ParseBuiltin(text);
    ASSERT_TRUE(spec.ok()) << spec.status();
    EXPECT_EQ(FormatBuiltin(*spec), full);
    const absl::StatusOr<BuiltinSpec> again = ParseBuiltin(full);
    ASSERT_TRUE(again.ok()) << again.status();
    EXPECT_EQ(FormatBuiltin(*again), full);
    EXPECT_EQ(again->seed, spec->seed);
  }
}

TEST(MakeBuiltin, RefusesWhatItCannotMake) {
  EXPECT_EQ(MakeBuiltin({"castle", 0, 1}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(MakeBuiltin({"hall", 1, 1}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(MakeBuiltin({"hall", kMaxBuiltinTriangles + 1, 1}).status().code(),
            absl::StatusCode::kInvalidArgument);
}

TEST(BuiltinScenes, AreListed) {
  std::set<std::string_view> names;
  for (const BuiltinInfo& info : BuiltinScenes()) {
    names.insert(info.name);
    EXPECT_FALSE(info.description.empty());
    EXPECT_LE(info.min_triangles, info.default_triangles);
    EXPECT_LE(info.default_triangles, kMaxBuiltinTriangles);
  }
  EXPECT_EQ(names, (std::set<std::string_view>{"hall", "room", "office", "plants", "city", "forest",
                                               "sphere", "terrain", "box"}));
}

}  // namespace
}  // namespace sightline
