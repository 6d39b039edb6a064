// SPDX-License-Identifier: Apache-2.0
#include "core/base/regular_file.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;

class RegularFileTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& text) const {
    std::ofstream(dir_.File(name)) << text;
    return dir_.File(name);
  }
  static absl::Status OpenError(const std::string& path) {
    return RegularFile::Open(path).status();
  }
  static void ExpectOpenError(const std::string& path, absl::StatusCode code,
                              const std::string& message) {
    const absl::Status status = OpenError(path);
    EXPECT_EQ(status.code(), code) << path;
    EXPECT_THAT(std::string(status.message()), HasSubstr(message)) << path;
  }

  const testing_support::TempDir dir_;
};

TEST_F(RegularFileTest, WhatIsInAFileIsReadAsOftenAsOneLikes) {
  const absl::StatusOr<RegularFile> file = RegularFile::Open(Write("a", "text"));
  ASSERT_TRUE(file.ok()) << file.status();
  EXPECT_EQ(file->size(), 4u);
  for (int i = 0; i < 2; ++i) EXPECT_EQ(*file->Read(100), "text");
  EXPECT_EQ(*RegularFile::Open(Write("empty", ""))->Read(100), "");
  std::filesystem::create_symlink("a", dir_.File("link"));
  EXPECT_EQ(*RegularFile::Open(dir_.File("link"))->Read(100), "text");
}

TEST_F(RegularFileTest, NoMoreIsReadThanMayBe) {
  const absl::StatusOr<RegularFile> file = RegularFile::Open(Write("a", "text"));
  EXPECT_EQ(*file->Read(4), "text");
  const absl::Status status = file->Read(3).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(status.message()), HasSubstr("longer than 3 bytes"));
}

// A file of the kernel's says that it is empty, and is not.
TEST_F(RegularFileTest, WhatGrewIsReadToItsEndAndWhatShrankIsAnError) {
  const absl::StatusOr<RegularFile> kernels = RegularFile::Open("/proc/self/limits");
  ASSERT_TRUE(kernels.ok()) << kernels.status();
  EXPECT_EQ(kernels->size(), 0u);
  EXPECT_THAT(*kernels->Read(1 << 20), HasSubstr("Max open files"));
  const std::string path = Write("a", "text");
  const absl::StatusOr<RegularFile> file = RegularFile::Open(path);
  std::filesystem::resize_file(path, 2);
  const absl::Status status = file->Read(100).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(status.message()), HasSubstr("read 2 of 4 bytes: it became shorter"));
}

TEST_F(RegularFileTest, IsReadNoFurtherOnceNobodyWantsIt) {
  const absl::StatusOr<RegularFile> file = RegularFile::Open(Write("a", "text"));
  CancelToken cancel;
  EXPECT_EQ(file->Read(100, &cancel).value(), "text");
  cancel.Cancel();
  EXPECT_EQ(file->Read(100, &cancel).status().code(), absl::StatusCode::kCancelled);
}

// Of the pipes one has no writer: whoever waits for it never ends.
TEST_F(RegularFileTest, WhatIsNoRegularFileIsAnErrorAtOnce) {
  ExpectOpenError(dir_.File("none"), absl::StatusCode::kNotFound, "no such file");
  ExpectOpenError(Write("a", "text") + "/b", absl::StatusCode::kNotFound, "no such file");
  ExpectOpenError(dir_.path(), absl::StatusCode::kInvalidArgument, "is a folder, not a file");
  ExpectOpenError("/dev/null", absl::StatusCode::kInvalidArgument, "is not a regular file");
  ASSERT_EQ(mkfifo(dir_.File("pipe").c_str(), 0600), 0);
  ExpectOpenError(dir_.File("pipe"), absl::StatusCode::kInvalidArgument,
                  "is a pipe, not a regular file");
  sockaddr_un address{.sun_family = AF_UNIX, .sun_path = {}};
  const std::string path = dir_.File("socket");
  ASSERT_LT(path.size(), sizeof(address.sun_path));
  std::memcpy(address.sun_path, path.data(), path.size());
  const int socket_file = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  ASSERT_EQ(bind(socket_file, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  ExpectOpenError(path, absl::StatusCode::kInvalidArgument, "is not a regular file");
  close(socket_file);
  std::filesystem::create_symlink("loop", dir_.File("loop"));
  ExpectOpenError(dir_.File("loop"), absl::StatusCode::kPermissionDenied, "cannot be opened: ");
}

TEST_F(RegularFileTest, AnErrorIsToldOfItsFile) {
  const absl::Status status = OfFile("a.pem", OpenError(dir_.File("none")));
  EXPECT_EQ(status, absl::NotFoundError("a.pem: no such file"));
}

}  // namespace
}  // namespace sightline
