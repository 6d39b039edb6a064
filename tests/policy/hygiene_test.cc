// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/policy/hygiene_rules.h"
#include "tests/policy/source_tree.h"

namespace sightline::policy {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

using Rule = std::vector<std::string> (*)(const SourceFile&);

void ExpectTreeKeeps(Rule rule) {
  for (const SourceFile& file : ReadSourceTree()) {
    for (const std::string& finding : rule(file)) ADD_FAILURE() << finding;
  }
}

TEST(HygieneTest, TheTreeIsLicensed) { ExpectTreeKeeps(&CheckLicenceLine); }
TEST(HygieneTest, TheTreeNamesNoMachine) { ExpectTreeKeeps(&CheckNoMachinePaths); }
TEST(HygieneTest, TheTreeHasNoLeftovers) { ExpectTreeKeeps(&CheckNoLeftovers); }
TEST(HygieneTest, TheTreeHasShortFiles) { ExpectTreeKeeps(&CheckLength); }
TEST(HygieneTest, TheTreeHasCleanLines) { ExpectTreeKeeps(&CheckLineForm); }
TEST(HygieneTest, TheTreeHasGuardedAndCommentedHeaders) { ExpectTreeKeeps(&CheckHeaderForm); }
TEST(HygieneTest, TheTreesTestsNeverSleep) { ExpectTreeKeeps(&CheckNoSleepInTests); }

TEST(HygieneTest, TheTreesHeadersAreIncludedFirst) {
  const std::vector<SourceFile> files = ReadSourceTree();
  std::vector<std::string> headers;
  for (const SourceFile& file : files) {
    if (file.HasExtension(".h")) headers.push_back(file.path);
  }
  std::ranges::sort(headers);
  ASSERT_THAT(headers, testing::Contains("core/base/check.h"));
  for (const SourceFile& file : files) {
    for (const std::string& finding : CheckOwnHeaderFirst(file, headers)) ADD_FAILURE() << finding;
  }
}

TEST(HygieneTest, PlantedLicenceLines) {
  constexpr std::string_view kLine = "// SPDX-License-Identifier: Apache-2.0\n";
  EXPECT_THAT(CheckLicenceLine(MakeFile("a.cc", kLine)), IsEmpty());
  EXPECT_THAT(
      CheckLicenceLine(MakeFile("a.sh", "#!/bin/sh\n# SPDX-License-Identifier: Apache-2.0\n")),
      IsEmpty());
  EXPECT_THAT(CheckLicenceLine(MakeFile("a.cc", "\n" + std::string(kLine))), SizeIs(1));
  EXPECT_THAT(CheckLicenceLine(MakeFile("a.proto", "")), SizeIs(1));
  EXPECT_THAT(CheckLicenceLine(MakeFile("a.md", "")), IsEmpty());
}

TEST(HygieneTest, PlantedMachinePaths) {
  // Put together here, so that this file holds no such path itself.
  const auto planted = [](std::string_view before, std::string_view folder) {
    return std::string(before) + "/" + std::string(folder) + "/a";
  };
  for (const std::string& text :
       {planted("cd ", "work"), planted("\"", "home"), planted("p=", "root"), planted("(", "tmp"),
        planted("", "Users")}) {
    EXPECT_THAT(CheckNoMachinePaths(MakeFile("core/a.cc", text)), SizeIs(1)) << text;
  }
  for (const std::string& text : {planted("tests", "work"), planted("net", "home"),
                                  std::string("framework/"), planted("${dir}", "work")}) {
    EXPECT_THAT(CheckNoMachinePaths(MakeFile("core/a.cc", text)), IsEmpty()) << text;
  }
}

TEST(HygieneTest, PlantedLeftovers) {
  EXPECT_THAT(CheckNoLeftovers(MakeFile("core/a.cc", "x\n// TODO: y\n")),
              ElementsAre(HasSubstr("core/a.cc:2: TODO")));
  EXPECT_THAT(CheckNoLeftovers(MakeFile("a.md", "FIXME")), SizeIs(1));
  EXPECT_THAT(CheckNoLeftovers(MakeFile("core/a.cc", "kTODOs XXXXXX-name_XXX")), IsEmpty());
  EXPECT_THAT(CheckNoLeftovers(MakeFile("tests/a.cc", "for (word : {\"TODO\", \"XXX\"})")),
              IsEmpty());
}

TEST(HygieneTest, PlantedLength) {
  std::string text(600, '\n');
  EXPECT_THAT(CheckLength(MakeFile("core/a.cc", text)), IsEmpty());
  EXPECT_THAT(CheckLength(MakeFile("core/a.cc", text + "x")), ElementsAre(HasSubstr("601 lines")));
  EXPECT_THAT(CheckLength(MakeFile("core/a.md", "\n")), ElementsAre(HasSubstr("holds nothing")));
  EXPECT_THAT(CheckLength(MakeFile("core/a.md", "# A\n")), IsEmpty());
}

TEST(HygieneTest, PlantedLines) {
  EXPECT_THAT(CheckLineForm(MakeFile("a.h", std::string(100, 'x'))), IsEmpty());
  EXPECT_THAT(CheckLineForm(MakeFile("a.h", std::string(101, 'x'))), SizeIs(1));
  std::string umlauts;
  for (int i = 0; i < 100; ++i) umlauts += "ü";
  EXPECT_THAT(CheckLineForm(MakeFile("a.h", umlauts)), IsEmpty());
  EXPECT_THAT(CheckLineForm(MakeFile("a.h", "\tx\nx \n")), SizeIs(2));
}

TEST(HygieneTest, PlantedHeaders) {
  EXPECT_THAT(CheckHeaderForm(MakeFile("core/a-b.h",
                                       "// Thread safety: none.\n"
                                       "#ifndef SIGHTLINE_CORE_A_B_H_\n")),
              IsEmpty());
  EXPECT_THAT(
      CheckHeaderForm(MakeFile("core/a.h", "#pragma once\n#include <x>\n// Thread safety\n")),
      SizeIs(2));
  EXPECT_THAT(CheckHeaderForm(MakeFile("core/a-inl.h",
                                       "// Thread safety: none.\n"
                                       "#if defined(SIGHTLINE_CORE_A_INL_H_) == "
                                       "defined(HWY_TARGET_TOGGLE)\n")),
              IsEmpty());
}

TEST(HygieneTest, PlantedFirstIncludes) {
  const std::vector<std::string> headers = {"core/a.h"};
  const std::string good = "#include \"core/a.h\"\n#include <x>\n", bad = "#include <x>\n" + good;
  for (const char* path : {"core/a.cc", "tests/core/a_test.cc"}) {
    EXPECT_THAT(CheckOwnHeaderFirst(MakeFile(path, good), headers), IsEmpty());
    EXPECT_THAT(CheckOwnHeaderFirst(MakeFile(path, bad), headers), SizeIs(1));
    EXPECT_THAT(CheckOwnHeaderFirst(MakeFile(path, ""), headers), SizeIs(1));
  }
  EXPECT_THAT(CheckOwnHeaderFirst(MakeFile("core/b.cc", bad), headers), IsEmpty());
}

TEST(HygieneTest, PlantedSleeps) {
  EXPECT_THAT(CheckNoSleepInTests(MakeFile("tests/a.cc", "std::this_thread::sleep_for(1s);")),
              SizeIs(1));
  EXPECT_THAT(CheckNoSleepInTests(MakeFile("tests/a.cc", "absl::SleepFor(x); usleep(3);")),
              SizeIs(1));
  EXPECT_THAT(CheckNoSleepInTests(MakeFile("core/a.cc", "usleep(3);")), IsEmpty());
  EXPECT_THAT(CheckNoSleepInTests(MakeFile("tests/a.cc", "// Never sleeps.")), IsEmpty());
}

}  // namespace
}  // namespace sightline::policy
