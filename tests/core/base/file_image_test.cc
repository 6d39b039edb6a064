// SPDX-License-Identifier: Apache-2.0
#include "core/base/file_image.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <fstream>
#include <string>

#include "core/base/folder.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/faulty_file_calls.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::FaultyFileCalls;
using testing_support::TempDir;

absl::Status AnyRoom(uint64_t) { return absl::OkStatus(); }

class FileImageTest : public ::testing::Test {
 protected:
  FileImageTest() : folder_(*Folder::Open(dir_.path(), calls_)) {}
  void Write(const std::string& name, const std::string& text) {
    std::ofstream(dir_.File(name), std::ios::binary) << text;
  }
  absl::StatusOr<std::shared_ptr<const FileImage>> Read(const std::string& name,
                                                        const CancelToken* cancel = nullptr) {
    return folder_.Read(name, AnyRoom, cancel);
  }
  static std::string Text(const FileImage& file) {
    return {reinterpret_cast<const char*>(file.bytes().data()), file.bytes().size()};
  }

  TempDir dir_;
  FaultyFileCalls calls_;
  const Folder folder_;
};

TEST_F(FileImageTest, HoldsTheWholeFileAligned) {
  std::string text;
  for (int i = 0; i < 10'000; ++i) text += static_cast<char>('a' + i % 26);
  Write("a", text);
  calls_.short_read = 999;  // The system gives what it likes.
  calls_.interrupts = 3;
  const auto file = Read("a");
  ASSERT_TRUE(file.ok()) << file.status();
  EXPECT_EQ(Text(**file), text);
  EXPECT_EQ(reinterpret_cast<uintptr_t>((*file)->bytes().data()) % 64, 0u);
  // What becomes of the file is nothing to what was read.
  ASSERT_EQ(::truncate(dir_.File("a").c_str(), 0), 0);
  EXPECT_EQ(Text(**file), text);
  EXPECT_EQ((*Read("a"))->bytes().size(), 0u);
}

TEST_F(FileImageTest, AFaultOfTheDiskIsAnError) {
  Write("a", std::string(5000, 'x'));
  calls_.short_read = 1000;
  calls_.reads_before_fault = 2;
  calls_.read_error = EIO;
  const absl::Status failed = Read("a").status();
  EXPECT_EQ(failed.code(), absl::StatusCode::kDataLoss) << failed;
  EXPECT_THAT(std::string(failed.message()), HasSubstr(dir_.File("a")));
  calls_.read_error = 0;
  EXPECT_TRUE(Read("a").ok());
}

TEST_F(FileImageTest, OneThatIsCutShortMeanwhileIsAnError) {
  Write("a", std::string(5000, 'x'));
  const absl::Status cut = folder_
                               .Read(
                                   "a",
                                   [&](uint64_t) {
                                     EXPECT_EQ(::truncate(dir_.File("a").c_str(), 1234), 0);
                                     return absl::OkStatus();
                                   },
                                   nullptr)
                               .status();
  EXPECT_EQ(cut.code(), absl::StatusCode::kDataLoss) << cut;
  EXPECT_THAT(std::string(cut.message()), HasSubstr("1234 of 5000 bytes"));
}

TEST_F(FileImageTest, RoomIsAskedForFirst) {
  Write("a", std::string(5000, 'x'));
  calls_.read_error = EIO;  // Nothing is read.
  uint64_t asked = 0;
  const absl::Status refused = folder_
                                   .Read(
                                       "a",
                                       [&](uint64_t bytes) {
                                         asked = bytes;
                                         return absl::ResourceExhaustedError("no room");
                                       },
                                       nullptr)
                                   .status();
  EXPECT_EQ(asked, 5000u);
  EXPECT_EQ(refused, absl::ResourceExhaustedError("no room"));
}

TEST_F(FileImageTest, WhatIsNoPlainFileIsRefused) {
  EXPECT_EQ(Read("none").status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(Read("../a").status().code(), absl::StatusCode::kInvalidArgument);
  ASSERT_EQ(::mkdir(dir_.File("folder").c_str(), 0700), 0);
  EXPECT_EQ(Read("folder").status().code(), absl::StatusCode::kFailedPrecondition);
  Write("a", "text");
  ASSERT_EQ(::symlink("a", dir_.File("link").c_str()), 0);
  EXPECT_EQ(Read("link").status().code(), absl::StatusCode::kFailedPrecondition);
  CancelToken cancel;
  cancel.Cancel();
  EXPECT_EQ(Read("a", &cancel).status().code(), absl::StatusCode::kCancelled);
}

TEST_F(FileImageTest, AStampTellsAFileFromTheOneInItsPlace) {
  Write("a", "text");
  const absl::StatusOr<FileStamp> first = folder_.Stamp("a");
  ASSERT_TRUE(first.ok()) << first.status();
  EXPECT_EQ(first->bytes, 4u);
  EXPECT_EQ(*folder_.Stamp("a"), *first);
  Write("b", "text");
  ASSERT_EQ(::rename(dir_.File("b").c_str(), dir_.File("a").c_str()), 0);
  EXPECT_NE(*folder_.Stamp("a"), *first);
  EXPECT_EQ(folder_.Stamp("b").status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace sightline
