// SPDX-License-Identifier: Apache-2.0
#include "server/config_file.h"

#include <sys/stat.h>

#include <fstream>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(ConfigFileTest, ReadsValuesAndLists) {
  const absl::StatusOr<std::vector<ConfigEntry>> entries = ParseConfig(
      "a.yaml",
      "# A comment.\nlisten: 127.0.0.1:70\nscene:\n  - a=builtin:hall\n  - 'builtin:room'\n"
      "threads: 8  # Another.\n");
  ASSERT_TRUE(entries.ok()) << entries.status();
  ASSERT_EQ(entries->size(), 3u);
  EXPECT_EQ((*entries)[0].key, "listen");
  EXPECT_THAT((*entries)[0].values, ElementsAre("127.0.0.1:70"));
  EXPECT_EQ((*entries)[0].line, 2);
  EXPECT_THAT((*entries)[1].values, ElementsAre("a=builtin:hall", "builtin:room"));
  EXPECT_THAT((*entries)[2].values, ElementsAre("8"));
  EXPECT_EQ((*entries)[2].line, 6);
}

TEST(ConfigFileTest, AFileOfCommentsIsEmpty) {
  for (const char* text : {"", "# Nothing.\n", "---\n", "---\n# Nothing.\n---\n"}) {
    const absl::StatusOr<std::vector<ConfigEntry>> entries = ParseConfig("a.yaml", text);
    ASSERT_TRUE(entries.ok()) << entries.status();
    EXPECT_TRUE(entries->empty());
  }
}

TEST(ConfigFileTest, ErrorsNameFileAndLine) {
  const std::pair<const char*, const char*> cases[] = {
      {"threads: 8\nthreads: 9\n", "a.yaml:2: \"threads\" stands in line 1 already"},
      {"threads:\n", "a.yaml:1: \"threads\" wants one value"},
      {"a: 1\nlimits:\n  max-scenes: 3\n", "a.yaml:2: \"limits\" wants one value"},
      {"scene: [a, [b]]\n", "a.yaml:1: \"scene\" wants one value"},
      {"scene: []\n", "a.yaml:1: \"scene\" wants one value"},
      {"- a\n", "a.yaml:1: must be lines of OPTION: VALUE"},
      {"just words\n", "a.yaml:1: must be lines"},
      {"[a, b]: c\n", "a.yaml:1: an option's name"},
      {"a: 1\nb: [open\n", "a.yaml:"},
      {"a: 1\n---\nb: 2\n", "a.yaml:3: is another document"},
  };
  for (const auto& [text, message] : cases) {
    const absl::Status status = ParseConfig("a.yaml", text).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << text;
    EXPECT_THAT(std::string(status.message()), HasSubstr(message)) << text;
  }
}

TEST(ConfigFileTest, FilesAreReadAndBounded) {
  const testing_support::TempDir dir;
  EXPECT_EQ(ReadConfigFile(dir.File("none")).status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(ReadConfigFile(dir.File("none")).status().message()),
              HasSubstr(dir.File("none")));
  std::ofstream(dir.File("good")) << "threads: 8\n";
  EXPECT_TRUE(ReadConfigFile(dir.File("good")).ok());
  std::ofstream(dir.File("long")) << "a: " << std::string((1 << 20) + 1, 'x');
  EXPECT_EQ(ReadConfigFile(dir.File("long")).status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(ReadConfigFile(dir.path()).status().message()),
              HasSubstr("is a folder, not a file"));
  // Nobody writes to it: whoever waits for that never ends.
  ASSERT_EQ(mkfifo(dir.File("pipe").c_str(), 0600), 0);
  EXPECT_THAT(std::string(ReadConfigFile(dir.File("pipe")).status().message()),
              HasSubstr("is a pipe, not a regular file"));
}

}  // namespace
}  // namespace sightline
