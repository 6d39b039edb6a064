// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest-spi.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"
#include "tests/support/scenes.h"
#include "tests/support/temp_dir.h"

namespace sightline::testing_support {
namespace {

// Sets an environment variable for a scope.
class ScopedEnv {
 public:
  ScopedEnv(const char* name, const std::string& value) : name_(name) {
    if (const char* old = std::getenv(name)) old_ = old;
    setenv(name, value.c_str(), 1);
  }
  ~ScopedEnv() {
    if (old_) {
      setenv(name_, old_->c_str(), 1);
    } else {
      unsetenv(name_);
    }
  }

 private:
  const char* const name_;
  std::optional<std::string> old_;
};

TEST(TempDirTest, IsFreshAndGoesWithItsContents) {
  std::string path;
  {
    TempDir a, b;
    EXPECT_NE(a.path(), b.path());
    path = a.path();
    std::ofstream(a.File("x")) << "x";
    EXPECT_TRUE(std::filesystem::exists(path + "/x"));
  }
  EXPECT_FALSE(std::filesystem::exists(path));
}

TEST(ScenesTest, FindsFilesInTheNamedFolderOnly) {
  TempDir dir;
  std::ofstream(dir.File("here.obj")) << "v 0 0 0\n";
  ScopedEnv env("SIGHTLINE_SCENES", dir.path() + "/");
  EXPECT_EQ(SceneFile("here.obj"), dir.File("here.obj"));
  EXPECT_EQ(SceneFile("absent.obj"), "");
  EXPECT_EQ(SceneFile(""), "") << "a folder is no file";
}

TEST(ScenesTest, TheFolderBesideTheTreeIsTheDefault) {
  ScopedEnv env("SIGHTLINE_SCENES", "");
  EXPECT_EQ(std::filesystem::path(SceneFolder()).parent_path().parent_path(),
            std::filesystem::path(SIGHTLINE_SOURCE_DIR).parent_path());
}

TEST(TestRngTest, IsTheSameEverywhereForOneSeed) {
  TestRng a(7), b(7), c(8);
  std::set<uint64_t> seen;
  for (int i = 0; i < 1000; ++i) {
    const uint64_t x = a();
    EXPECT_EQ(x, b());
    seen.insert(x);
    seen.insert(c());
  }
  EXPECT_EQ(seen.size(), 2000u);
}

TEST(TestRngTest, StaysInItsRangesAndReachesTheirEnds) {
  TestRng rng;
  std::set<uint64_t> small;
  for (int i = 0; i < 1000; ++i) {
    small.insert(rng.Below(3));
    const double x = rng.Uniform(-2, 5);
    EXPECT_GE(x, -2);
    EXPECT_LT(x, 5);
    EXPECT_TRUE(std::isfinite(rng.AnyFloat()));
  }
  EXPECT_THAT(small, testing::ElementsAre(0, 1, 2));
}

TEST(TestRngTest, AFailureNamesTheSeed) {
  const std::string line = "SIGHTLINE_SEED=" + std::to_string(TestSeed()) + " stream 42";
  testing::TestPartResultArray results;
  {
    testing::ScopedFakeTestPartResultReporter reporter(&results);
    TestRng rng(42);
    ADD_FAILURE() << "planted";
  }
  ASSERT_EQ(results.size(), 1);
  EXPECT_THAT(results.GetTestPartResult(0).message(), testing::HasSubstr(line));
}

}  // namespace
}  // namespace sightline::testing_support
