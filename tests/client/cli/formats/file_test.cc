// SPDX-License-Identifier: Apache-2.0
#include "client/cli/formats/file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <string>
#include <thread>

#include "absl/synchronization/notification.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/temp_dir.h"

namespace sightline::cli {
namespace {

using ::testing::HasSubstr;
using testing_support::TempDir;

TEST(FileTest, ReadsWhatItWritesAndLeavesNothingBeside) {
  TempDir dir;
  const std::string path = dir.File("a.bin");
  const std::string bytes("a\0b", 3);
  ASSERT_TRUE(WriteFile(path, "something longer, first").ok());
  ASSERT_TRUE(WriteFile(path, bytes).ok());
  EXPECT_EQ(ReadFile(path).value(), bytes);
  const absl::string_view parts[] = {"head", "", bytes};
  ASSERT_TRUE(WriteFile(path, parts).ok());
  EXPECT_EQ(ReadFile(path).value(), "head" + bytes);
  int files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(dir.path()))
    ++files;
  EXPECT_EQ(files, 1);
}

TEST(FileTest, LinksStayLinks) {
  TempDir dir;
  ASSERT_TRUE(WriteFile(dir.File("target"), "old").ok());
  ASSERT_EQ(::symlink("target", dir.File("link").c_str()), 0);
  ASSERT_TRUE(WriteFile(dir.File("link"), "new").ok());
  EXPECT_TRUE(std::filesystem::is_symlink(dir.File("link")));
  EXPECT_EQ(ReadFile(dir.File("target")).value(), "new");
}

// Neither more than its owner gave nor less, whatever the umask.
TEST(FileTest, WhatIsReplacedKeepsItsPermissions) {
  TempDir dir;
  const auto mode = [&](const std::string& name) {
    struct stat info;
    EXPECT_EQ(::stat(dir.File(name).c_str(), &info), 0);
    return info.st_mode & 07777;
  };
  const mode_t before = ::umask(022);
  for (const mode_t given : {0600u, 0640u, 0644u, 0666u, 0755u}) {
    ASSERT_TRUE(WriteFile(dir.File("a"), "old").ok());
    ASSERT_EQ(::chmod(dir.File("a").c_str(), given), 0);
    ASSERT_TRUE(WriteFile(dir.File("a"), "new").ok());
    EXPECT_EQ(ReadFile(dir.File("a")).value(), "new");
    EXPECT_EQ(mode("a"), given);
  }
  ASSERT_EQ(::chmod(dir.File("a").c_str(), 0600), 0);
  ASSERT_EQ(::symlink("a", dir.File("link").c_str()), 0);
  ASSERT_TRUE(WriteFile(dir.File("link"), "newer").ok());
  EXPECT_EQ(mode("a"), 0600u);
  ASSERT_TRUE(WriteFile(dir.File("b"), "first").ok());
  EXPECT_EQ(mode("b"), 0644u);
  ::umask(before);
}

TEST(FileTest, DevicesAreWrittenToNotReplaced) {
  ASSERT_TRUE(CheckWritable("/dev/null").ok());
  ASSERT_TRUE(WriteFile("/dev/null", "bytes").ok());
  struct stat info;
  ASSERT_EQ(::stat("/dev/null", &info), 0);
  EXPECT_TRUE(S_ISCHR(info.st_mode));
}

TEST(FileTest, PipesAreReadUntilTheirWriterIsGone) {
  TempDir dir;
  const std::string path = dir.File("pipe");
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  const std::string bytes(300'000, 'x');  // More than a pipe holds.
  std::thread writer([&] { EXPECT_TRUE(WriteFile(path, bytes).ok()); });
  const CancelToken cancel;
  EXPECT_EQ(ReadFile(path, &cancel).value_or("error"), bytes);
  writer.join();
}

// One that has no writer, and one whose writer writes nothing.
TEST(FileTest, PipesAreNotWaitedForOnceNobodyWantsThem) {
  TempDir dir;
  const std::string path = dir.File("pipe");
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  CancelToken cancel;
  absl::Notification given_up;
  std::thread writer([&] {
    // Opens once a reader has.
    const int silent = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
    EXPECT_GE(silent, 0);
    cancel.Cancel();
    given_up.WaitForNotification();
    ::close(silent);
  });
  EXPECT_EQ(ReadFile(path, &cancel).status().code(), absl::StatusCode::kCancelled);
  given_up.Notify();
  writer.join();
  EXPECT_EQ(ReadFile(path, &cancel).status().code(), absl::StatusCode::kCancelled);
}

TEST(FileTest, ErrorsNameThePath) {
  TempDir dir;
  EXPECT_EQ(ReadFile(dir.File("none")).status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(ReadFile(dir.File("none")).status().message()),
              HasSubstr(dir.File("none")));
  EXPECT_THAT(std::string(ReadFile(dir.path()).status().message()), HasSubstr("folder"));
  EXPECT_FALSE(WriteFile(dir.File("no/such/folder"), "x").ok());
  EXPECT_FALSE(CheckWritable(dir.File("no/such/folder")).ok());
  EXPECT_FALSE(CheckWritable(dir.path()).ok());
  EXPECT_FALSE(CheckWritable("").ok());
  EXPECT_TRUE(CheckWritable(dir.File("new")).ok());
}

}  // namespace
}  // namespace sightline::cli
