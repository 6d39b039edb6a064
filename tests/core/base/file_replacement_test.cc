// SPDX-License-Identifier: Apache-2.0
//
// Whatever fails at whatever step, the target is the old file whole or the new one whole, and
// nothing is left lying about.
#include "core/base/file_replacement.h"

#include <cerrno>
#include <fstream>
#include <functional>
#include <iterator>
#include <memory>
#include <string>

#include "core/base/folder.h"
#include "core/base/status_macros.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/faulty_file_calls.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::FaultyFileCalls;
using testing_support::TempDir;

class FileReplacementTest : public ::testing::Test {
 protected:
  absl::Status Replace(const std::string& text) {
    SL_ASSIGN_OR_RETURN(const Folder folder, Folder::Open(dir_.path(), *calls_));
    SL_ASSIGN_OR_RETURN(FileReplacement file, folder.Replace("file"));
    const auto bytes = std::as_bytes(std::span(text));
    SL_RETURN_IF_ERROR(file.Append(bytes.first(bytes.size() / 2)));
    SL_RETURN_IF_ERROR(file.Append(bytes.subspan(bytes.size() / 2)));
    return file.Commit();
  }
  std::string Text() {
    std::ifstream in(dir_.File("file"));
    return {std::istreambuf_iterator<char>(in), {}};
  }
  size_t Files() { return Folder::Open(dir_.path())->List()->size(); }

  // The old file must have stayed, and the fault must be told.
  void ExpectOld(absl::StatusCode code, const std::function<void()>& break_something) {
    calls_ = std::make_unique<FaultyFileCalls>();
    break_something();
    const absl::Status status = Replace("new text");
    EXPECT_EQ(status.code(), code) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(dir_.File("file")));
    EXPECT_EQ(Text(), "old text");
    EXPECT_EQ(Files(), 1u);
  }

  TempDir dir_;
  std::unique_ptr<FaultyFileCalls> calls_ = std::make_unique<FaultyFileCalls>();
};

TEST_F(FileReplacementTest, ReplacesWhole) {
  EXPECT_TRUE(Replace("old text").ok());
  EXPECT_EQ(Text(), "old text");
  EXPECT_TRUE(Replace("new").ok());
  EXPECT_EQ(Text(), "new");
  EXPECT_EQ(Files(), 1u);
}

TEST_F(FileReplacementTest, GoesOnAfterShortAndInterruptedWrites) {
  calls_->short_write = 3;
  calls_->interrupts = 2;
  EXPECT_TRUE(Replace("a longer text").ok());
  EXPECT_EQ(Text(), "a longer text");
}

TEST_F(FileReplacementTest, EveryFaultLeavesTheOldFile) {
  ASSERT_TRUE(Replace("old text").ok());
  using enum absl::StatusCode;
  ExpectOld(kResourceExhausted, [&] { calls_->write_error = ENOSPC; });
  ExpectOld(kResourceExhausted, [&] {
    calls_->write_error = ENOSPC;
    calls_->writes_before_fault = 1;
  });
  ExpectOld(kResourceExhausted, [&] {
    calls_->write_error = EDQUOT;
    calls_->short_write = 1;
    calls_->writes_before_fault = 5;
  });
  ExpectOld(kDataLoss, [&] { calls_->write_error = EIO; });
  ExpectOld(kDataLoss, [&] { calls_->sync_error = EIO; });
  ExpectOld(kResourceExhausted, [&] { calls_->rename_error = ENOSPC; });
  ExpectOld(kPermissionDenied, [&] { calls_->rename_error = EACCES; });
}

TEST_F(FileReplacementTest, AFolderThatCannotBeSyncedIsTold) {
  ASSERT_TRUE(Replace("old text").ok());
  calls_->sync_error = EIO;
  calls_->syncs_before_fault = 1;
  EXPECT_EQ(Replace("new text").code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(Text(), "new text");
}

TEST_F(FileReplacementTest, WhatIsNotCommittedLeavesNothing) {
  {
    const Folder folder = *Folder::Open(dir_.path());
    absl::StatusOr<FileReplacement> file = folder.Replace("file");
    ASSERT_TRUE(file.ok());
    EXPECT_EQ(Files(), 1u);
    const FileReplacement moved = *std::move(file);
  }
  EXPECT_EQ(Files(), 0u);
}

TEST(TemporaryNameTest, IsTold) {
  EXPECT_TRUE(IsTemporaryName(".hall.slscene.71-3.tmp"));
  EXPECT_FALSE(IsTemporaryName("hall.tmp"));
  EXPECT_FALSE(IsTemporaryName(".hall"));
}

}  // namespace
}  // namespace sightline
