// SPDX-License-Identifier: Apache-2.0
#include "core/base/folder.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/faulty_file_calls.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing_support::FaultyFileCalls;
using testing_support::TempDir;

class FolderTest : public ::testing::Test {
 protected:
  Folder Open() {
    absl::StatusOr<Folder> folder = Folder::Open(dir_.path(), calls_);
    EXPECT_TRUE(folder.ok()) << folder.status();
    return *std::move(folder);
  }
  void Write(const std::string& name, const std::string& text) {
    std::ofstream(dir_.File(name)) << text;
  }
  static std::string Text(const MappedFile& file) {
    return {reinterpret_cast<const char*>(file.bytes().data()), file.bytes().size()};
  }
  static std::vector<std::string> Names(const Folder& folder) {
    std::vector<std::string> names;
    const absl::StatusOr<std::vector<FolderEntry>> entries = folder.List();
    EXPECT_TRUE(entries.ok()) << entries.status();
    if (entries.ok()) {
      for (const FolderEntry& entry : *entries) names.push_back(entry.name);
    }
    return names;
  }

  TempDir dir_;
  FaultyFileCalls calls_;
};

TEST_F(FolderTest, MapsAndListsPlainFiles) {
  Write("b", "text");
  Write("a", "");
  ASSERT_EQ(::mkdir(dir_.File("folder").c_str(), 0700), 0);
  const Folder folder = Open();
  EXPECT_THAT(Names(folder), ElementsAre("a", "b"));
  EXPECT_EQ((*folder.List())[1].bytes, 4u);
  EXPECT_GT((*folder.List())[1].modified_ns, 0);
  const auto file = folder.Map("b");
  ASSERT_TRUE(file.ok()) << file.status();
  EXPECT_EQ(Text(**file), "text");
  const auto empty = folder.Map("a");
  ASSERT_TRUE(empty.ok()) << empty.status();
  EXPECT_TRUE((*empty)->bytes().empty());
}

TEST_F(FolderTest, TellsWhetherItCanBeWritten) {
  const Folder folder = Open();
  EXPECT_TRUE(folder.CheckWritable().ok());
  calls_.access_error = EROFS;
  const absl::Status status = folder.CheckWritable();
  EXPECT_EQ(status.code(), absl::StatusCode::kPermissionDenied) << status;
  EXPECT_THAT(status.message(), HasSubstr("cannot write to the folder " + dir_.path()));
}

TEST_F(FolderTest, NothingOutsideCanBeNamed) {
  TempDir other;
  std::ofstream(other.File("secret")) << "secret";
  const Folder folder = Open();
  const std::string up = "../" + other.path().substr(other.path().rfind('/') + 1) + "/secret";
  for (const std::string& name :
       {up, other.File("secret"), std::string(".."), std::string("."), std::string(),
        std::string("a/b"), std::string("a\0b", 3), std::string("a\nb"), std::string(256, 'a')}) {
    EXPECT_EQ(folder.Map(name).status().code(), absl::StatusCode::kInvalidArgument) << name;
    EXPECT_EQ(folder.Replace(name).status().code(), absl::StatusCode::kInvalidArgument) << name;
    EXPECT_EQ(folder.Remove(name).code(), absl::StatusCode::kInvalidArgument) << name;
  }
  ASSERT_EQ(::symlink(other.File("secret").c_str(), dir_.File("link").c_str()), 0);
  const absl::Status link = folder.Map("link").status();
  EXPECT_EQ(link.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(link.message()), HasSubstr("links are not followed"));
  EXPECT_THAT(Names(folder), ElementsAre());
}

TEST_F(FolderTest, WhatIsNoPlainFileIsAnErrorAndHoldsNobodyUp) {
  ASSERT_EQ(::mkdir(dir_.File("folder").c_str(), 0700), 0);
  ASSERT_EQ(::mkfifo(dir_.File("pipe").c_str(), 0600), 0);
  const Folder folder = Open();
  EXPECT_EQ(folder.Map("folder").status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(folder.Map("pipe").status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(folder.Map("none").status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(Folder::Open(dir_.File("none")).status().code(), absl::StatusCode::kNotFound);
  Write("file", "");
  EXPECT_EQ(Folder::Open(dir_.File("file")).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(FolderTest, ErrorsSayWhatAndWhere) {
  Write("a", "text");
  const Folder folder = Open();
  calls_.map_error = ENOMEM;
  EXPECT_EQ(folder.Map("a").status().code(), absl::StatusCode::kResourceExhausted);
  calls_.map_error = 0;
  calls_.open_error = EMFILE;
  const absl::Status starved = folder.Map("a").status();
  EXPECT_EQ(starved.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(starved.message()), HasSubstr(dir_.File("a")));
  EXPECT_THAT(std::string(starved.message()), HasSubstr("ulimit"));
  EXPECT_FALSE(folder.List().ok());
  calls_.open_error = EACCES;
  EXPECT_EQ(folder.Map("a").status().code(), absl::StatusCode::kPermissionDenied);
  calls_.open_error = 0;
  calls_.unlink_error = EROFS;
  EXPECT_EQ(folder.Remove("a").code(), absl::StatusCode::kPermissionDenied);
  calls_.unlink_error = 0;
  calls_.sync_error = EIO;
  EXPECT_EQ(folder.Remove("a").code(), absl::StatusCode::kDataLoss);
}

TEST_F(FolderTest, TemporariesOfTheDeadAreTakenAwayAndThoseOfTheLivingAreNot) {
  Write("scene", "");
  Write(".scene.17-0.tmp", "half");
  const Folder folder = Open();
  absl::StatusOr<FileReplacement> living = folder.Replace("scene");
  ASSERT_TRUE(living.ok()) << living.status();
  const absl::StatusOr<size_t> removed = folder.RemoveTemporaries();
  ASSERT_TRUE(removed.ok()) << removed.status();
  EXPECT_EQ(*removed, 1u);
  EXPECT_TRUE(living->Commit().ok());
  EXPECT_THAT(Names(folder), ElementsAre("scene"));
}

// As over NFS, an exclusive lock wants a descriptor for writing; and as where rights are few, some
// files are to be had for reading alone.
class OpensOnlySomeForWriting final : public FileCalls {
 public:
  int error = 0;  // Of opening for writing; 0: none.
  int for_reading = 0, for_writing = 0;

  int OpenAt(int folder, const char* name, int flags, mode_t mode) override {
    if (IsTemporaryName(name)) {
      const bool writes = (flags & O_ACCMODE) != O_RDONLY;
      ++(writes ? for_writing : for_reading);
      if (writes && error != 0) return errno = error, -1;
    }
    return FileCalls::OpenAt(folder, name, flags, mode);
  }
};

TEST_F(FolderTest, TemporariesAreLockedForWritingWhereTheyMayBeWritten) {
  OpensOnlySomeForWriting calls;
  const absl::StatusOr<Folder> folder = Folder::Open(dir_.path(), calls);
  ASSERT_TRUE(folder.ok()) << folder.status();
  const auto removed = [&](int error) {
    Write(".scene.17-0.tmp", "half");
    calls.error = error, calls.for_reading = calls.for_writing = 0;
    const absl::StatusOr<size_t> count = folder->RemoveTemporaries();
    EXPECT_TRUE(count.ok()) << count.status();
    return count.value_or(0);
  };
  EXPECT_EQ(removed(0), 1u);
  EXPECT_EQ(calls.for_writing, 1);
  EXPECT_EQ(calls.for_reading, 0);
  for (const int error : {EACCES, EROFS}) {
    EXPECT_EQ(removed(error), 1u);
    EXPECT_EQ(calls.for_writing, 1);
    EXPECT_EQ(calls.for_reading, 1);
  }
  EXPECT_EQ(removed(EMFILE), 0u);  // Not known: left alone.
  EXPECT_EQ(calls.for_reading, 0);
}

}  // namespace
}  // namespace sightline
