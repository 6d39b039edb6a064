// SPDX-License-Identifier: Apache-2.0
//
// Whatever fails at whatever step, the target is the old file whole or the new one whole, and
// nothing is left lying about.
#include "core/base/file_replacement.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>
#include <functional>
#include <iterator>
#include <memory>
#include <string>
#include <utility>
#include <vector>

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
  // A file that only its owner may read is not shown to others for want of knowing.
  ExpectOld(kDataLoss, [&] { calls_->stat_error = EIO; });
}

mode_t Mode(const std::string& path) {
  struct stat status = {};
  EXPECT_EQ(::stat(path.c_str(), &status), 0) << path;
  return status.st_mode & 07777;
}

// The old file's, more or fewer than the umask leaves a new one; without the bits that would give
// rights to what is new in it.
TEST_F(FileReplacementTest, KeepsTheOldFilesPermissions) {
  ASSERT_TRUE(Replace("old text").ok());
  const mode_t fresh = Mode(dir_.File("file"));
  EXPECT_EQ(fresh & ~mode_t{0644}, 0u);
  for (const mode_t mode : {0600, 0666, 0444, 0777, 04755}) {
    ASSERT_EQ(::chmod(dir_.File("file").c_str(), mode), 0);
    ASSERT_TRUE(Replace("text").ok());
    EXPECT_EQ(Mode(dir_.File("file")), mode & 0777) << std::oct << mode;
  }
  ASSERT_EQ(::chmod(dir_.File("file").c_str(), 0666), 0);
  ASSERT_TRUE(Replace("old text").ok());
  ExpectOld(absl::StatusCode::kPermissionDenied, [&] { calls_->mode_error = EPERM; });
  EXPECT_EQ(Mode(dir_.File("file")), mode_t{0666});
  // Nothing has to be changed: a file system that has no permissions is not asked to.
  ASSERT_EQ(::chmod(dir_.File("file").c_str(), fresh), 0);
  EXPECT_TRUE(Replace("new text").ok());
  // What is no plain file has none to give.
  ASSERT_EQ(::unlink(dir_.File("file").c_str()), 0);
  ASSERT_EQ(::symlink("elsewhere", dir_.File("file").c_str()), 0);
  EXPECT_TRUE(Replace("text").ok());
  EXPECT_EQ(Mode(dir_.File("file")), fresh);
}

// A container's service has the same pid at every start, and counts from the same number: what one
// that was killed has left stands where the next one writes.
TEST_F(FileReplacementTest, PassesOverWhatTheDeadHaveLeft) {
  ASSERT_TRUE(Replace("old text").ok());
  // The next numbers are found by taking them: those behind the one that is used now.
  std::string next;
  {
    const Folder folder = *Folder::Open(dir_.path());
    const absl::StatusOr<FileReplacement> file = folder.Replace("file");
    ASSERT_TRUE(file.ok()) << file.status();
    const std::vector<FolderEntry> entries = *folder.List();
    for (const FolderEntry& entry : entries) {
      if (IsTemporaryName(entry.name)) next = entry.name;
    }
  }
  const size_t dash = next.rfind('-');
  ASSERT_NE(dash, std::string::npos);
  const std::string before = next.substr(0, dash + 1);
  const int number = std::stoi(next.substr(dash + 1));
  constexpr int kLeft = 40;  // More than are tried where each is taken away.
  for (int k = 1; k <= kLeft; ++k) {
    std::ofstream(dir_.File(before + std::to_string(number + k) + ".tmp")) << "half";
  }
  const absl::Status status = Replace("new text");
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(Text(), "new text");
  EXPECT_EQ(Files(), 1u + kLeft);
}

class TakenForEver final : public FileCalls {
 public:
  int OpenAt(int folder, const char* name, int flags, mode_t mode) override {
    if ((flags & O_CREAT) != 0) return errno = EEXIST, -1;
    return FileCalls::OpenAt(folder, name, flags, mode);
  }
};

TEST_F(FileReplacementTest, GivesUpWhereEveryNameIsTaken) {
  TakenForEver calls;
  const Folder folder = *Folder::Open(dir_.path(), calls);
  const absl::Status status = folder.Replace("file").status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr(dir_.File("file")));
  EXPECT_THAT(std::string(status.message()), HasSubstr("\".file.\""));
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

// Another process takes away what the dead have left while this one is at some step.
class CleanedMeanwhile final : public FileCalls {
 public:
  // How many more files are cleaned away right after they are made.
  int after_open = 0;
  bool before_rename = false, after_rename = false;
  // The name that is to go while it is being cleaned away, as its owner has renamed it.
  std::string renamed_meanwhile;

  explicit CleanedMeanwhile(std::string path) : path_(std::move(path)) {}

  int OpenAt(int folder, const char* name, int flags, mode_t mode) override {
    const int file = FileCalls::OpenAt(folder, name, flags, mode);
    if ((flags & O_CREAT) != 0 && after_open > 0) {
      --after_open;
      Clean();
    }
    return file;
  }
  int RenameAt(int folder, const char* from, const char* to) override {
    if (before_rename) Clean();
    const int result = FileCalls::RenameAt(folder, from, to);
    if (after_rename) Clean();
    return result;
  }
  int UnlinkAt(int folder, const char* name) override {
    if (name == renamed_meanwhile) FileCalls::RenameAt(folder, name, "target");
    return FileCalls::UnlinkAt(folder, name);
  }

 private:
  void Clean() const { EXPECT_TRUE(Folder::Open(path_)->RemoveTemporaries().ok()); }

  const std::string path_;
};

TEST_F(FileReplacementTest, WhoCleansUpMeanwhileTakesNothingAway) {
  CleanedMeanwhile calls(dir_.path());
  const Folder folder = *Folder::Open(dir_.path(), calls);
  const auto replace = [&](const std::string& text) -> absl::Status {
    SL_ASSIGN_OR_RETURN(FileReplacement file, folder.Replace("file"));
    SL_RETURN_IF_ERROR(file.Append(std::as_bytes(std::span(text))));
    return file.Commit();
  };
  const auto expect_replaced = [&](const std::string& text) {
    const absl::Status status = replace(text);
    EXPECT_TRUE(status.ok()) << status;
    EXPECT_EQ(Text(), text);
    EXPECT_EQ(Files(), 1u);
  };
  calls.after_open = 2;  // Before it could be locked.
  expect_replaced("made again");
  calls.before_rename = true;  // Written and synced.
  expect_replaced("locked until it is renamed");
  calls.before_rename = false;
  calls.after_rename = true;
  expect_replaced("renamed");
  // Somebody who takes every file away is told, and not fought for ever.
  calls.after_open = 1'000'000;
  const absl::Status status = replace("none");
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr(dir_.File("file")));
  EXPECT_EQ(Text(), "renamed");
  EXPECT_EQ(Files(), 1u);
}

TEST_F(FileReplacementTest, WhatIsCommittedMeanwhileHoldsNoCleaningUp) {
  CleanedMeanwhile calls(dir_.path());
  const Folder folder = *Folder::Open(dir_.path(), calls);
  for (const char* name : {".a.1-0.tmp", ".b.1-0.tmp", ".c.1-0.tmp"}) {
    std::ofstream(dir_.File(name)) << "half";
  }
  calls.renamed_meanwhile = ".a.1-0.tmp";
  const absl::StatusOr<size_t> removed = folder.RemoveTemporaries();
  ASSERT_TRUE(removed.ok()) << removed.status();
  EXPECT_EQ(*removed, 2u);
  EXPECT_EQ(Files(), 1u);
}

TEST(TemporaryNameTest, IsTold) {
  EXPECT_TRUE(IsTemporaryName(".hall.slscene.71-3.tmp"));
  EXPECT_FALSE(IsTemporaryName("hall.tmp"));
  EXPECT_FALSE(IsTemporaryName(".hall"));
}

}  // namespace
}  // namespace sightline
