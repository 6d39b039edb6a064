// SPDX-License-Identifier: Apache-2.0
#include "client/cli/flags.h"

#include "client/cli/exit_code.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline::cli {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

struct Values {
  bool stats = false;
  std::string out;
  std::vector<std::string> outs;
  double distance = 0.5;
  uint64_t tile = 64;
  std::optional<Vec3d> eye;
  std::vector<Vec3d> lights;
  std::string strategy = "AUTO";
};

class FlagsTest : public testing::Test {
 protected:
  FlagsTest() : flags_("test [flags]", "A test.") {
    flags_.Switch("stats", "print a table", &v_.stats);
    flags_.Text("out", "FILE", "a file", &v_.out);
    flags_.Texts("also", "FILE", "more files", &v_.outs);
    flags_.Number("distance", "METRES", "how far", &v_.distance);
    flags_.Count("tile", "PIXELS", "side of a tile", &v_.tile, 1, 4096);
    flags_.Heading("Camera");
    flags_.Point("eye", "where", &v_.eye);
    flags_.Points("light", "a light", &v_.lights);
    flags_.Choice("strategy", {"AUTO", "SINGLE"}, "how", &v_.strategy);
  }
  absl::StatusOr<std::vector<std::string>> Parse(const std::vector<std::string>& args) {
    return flags_.Parse(args);
  }
  std::string Error(const std::vector<std::string>& args) {
    const absl::Status status = Parse(args).status();
    EXPECT_EQ(ToExitCode(status), kExitUsage) << status;
    return std::string(status.message());
  }
  Values v_;
  FlagSet flags_;
};

TEST_F(FlagsTest, ReadsEveryKind) {
  const auto words = Parse(
      {"a",          "--stats",    "--out",     "x",     "--also=1",  "--also",        "2",
       "--distance", "-1.5",       "--tile=32", "--eye", "-1,2e3,.5", "--light=1,2,3", "--light",
       "4,5,6",      "--strategy", "single",    "b",     "--",        "--tile"});
  ASSERT_TRUE(words.ok()) << words.status();
  EXPECT_THAT(*words, ElementsAre("a", "b", "--tile"));
  EXPECT_TRUE(v_.stats);
  EXPECT_EQ(v_.out, "x");
  EXPECT_THAT(v_.outs, ElementsAre("1", "2"));
  EXPECT_EQ(v_.distance, -1.5);
  EXPECT_EQ(v_.tile, 32u);
  EXPECT_EQ(v_.eye, (Vec3d{-1, 2000, 0.5}));
  EXPECT_THAT(v_.lights, ElementsAre(Vec3d{1, 2, 3}, Vec3d{4, 5, 6}));
  EXPECT_EQ(v_.strategy, "SINGLE");
  EXPECT_TRUE(flags_.given("tile"));
}

TEST_F(FlagsTest, SwitchesCanBeCleared) {
  v_.stats = true;
  ASSERT_TRUE(Parse({"--no-stats"}).ok());
  EXPECT_FALSE(v_.stats);
  EXPECT_THAT(Error({"--no-tile"}), HasSubstr("--no-tile"));
}

TEST_F(FlagsTest, MistakesNameFlagValueAndRemedy) {
  EXPECT_THAT(Error({"--stat"}), AllOf(HasSubstr("--stat"), HasSubstr("did you mean --stats")));
  EXPECT_THAT(Error({"--strategi", "x"}), HasSubstr("did you mean --strategy"));
  EXPECT_THAT(Error({"--qqqqqq"}), testing::Not(HasSubstr("did you mean")));
  EXPECT_THAT(Error({"-x"}), HasSubstr("-x"));
  EXPECT_THAT(Error({"--out"}), HasSubstr("wants a value"));
  EXPECT_THAT(Error({"--out="}), HasSubstr("not empty"));
  EXPECT_THAT(Error({"--tile", "0"}), AllOf(HasSubstr("1 to 4096"), HasSubstr("'0'")));
  EXPECT_THAT(Error({"--tile", "many"}), HasSubstr("'many'"));
  EXPECT_THAT(Error({"--distance", "nan"}), HasSubstr("finite"));
  EXPECT_THAT(Error({"--eye", "1,2"}), AllOf(HasSubstr("--eye"), HasSubstr("X,Y,Z")));
  EXPECT_THAT(Error({"--eye", "1,2,inf"}), HasSubstr("finite"));
  EXPECT_THAT(Error({"--strategy", "FAST"}), HasSubstr("AUTO, SINGLE"));
}

TEST_F(FlagsTest, HelpListsEveryFlagWithValueAndDefault) {
  ASSERT_TRUE(Parse({"--unknown", "--help"}).ok());
  EXPECT_TRUE(flags_.help_requested());
  const std::string help = flags_.Help();
  for (const char* part :
       {"Usage: test [flags]", "A test.", "Camera:", "--stats", "--out FILE", "--also FILE",
        "--distance METRES", "(default: 0.5)", "--tile PIXELS", "(default: 64)", "--eye X,Y,Z",
        "--light X,Y,Z", "--strategy AUTO|SINGLE", "(default: AUTO)"}) {
    EXPECT_THAT(help, HasSubstr(part));
  }
}

TEST(ExitCodeTest, FollowsTheStatus) {
  EXPECT_EQ(ToExitCode(absl::OkStatus()), 0);
  EXPECT_EQ(ToExitCode(absl::InvalidArgumentError("")), 65);
  EXPECT_EQ(ToExitCode(absl::NotFoundError("")), 66);
  EXPECT_EQ(ToExitCode(absl::UnavailableError("")), 69);
  EXPECT_EQ(ToExitCode(absl::InternalError("")), 70);
  EXPECT_EQ(ToExitCode(absl::DeadlineExceededError("")), 75);
  EXPECT_EQ(ToExitCode(absl::ResourceExhaustedError("a limit")), 65);
  EXPECT_EQ(ToExitCode(UsageError("")), 64);
  EXPECT_EQ(ToExitCode(WithExitCode(absl::NotFoundError(""), kExitCannotCreate)), 73);
}

}  // namespace
}  // namespace sightline::cli
