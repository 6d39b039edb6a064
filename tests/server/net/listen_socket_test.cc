// SPDX-License-Identifier: Apache-2.0
#include "server/net/listen_socket.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;

bool CanConnect(const SocketAddress& address) {
  const int fd = socket(address.family(), SOCK_STREAM | SOCK_CLOEXEC, 0);
  const bool connected = connect(fd, address.get(), address.length) == 0;
  close(fd);
  return connected;
}

bool Exists(const std::string& path) { return access(path.c_str(), F_OK) == 0; }

TEST(ListenSocketTest, APortIsTakenOnce) {
  const auto first = BindAll({"127.0.0.1:0"}, 0600);
  ASSERT_TRUE(first.ok()) << first.status();
  ASSERT_EQ(first->size(), 1u);
  const std::string taken = first->front().address().ToString();
  EXPECT_TRUE(CanConnect(first->front().address()));
  const absl::Status status = BindAll({taken}, 0600).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr(taken));
}

// The addresses of a name, such as 127.0.0.1 and ::1 of localhost; here two of this machine's that
// every Linux has.
class BindHostTest : public ::testing::Test {
 protected:
  static std::vector<SocketAddress> Host(const std::vector<std::string>& hosts, int port) {
    std::vector<SocketAddress> addresses;
    for (const std::string& host : hosts) {
      const absl::StatusOr<ListenAddress> parsed =
          ParseListenAddress(absl::StrCat(host, ":", port));
      EXPECT_TRUE(parsed.ok()) << parsed.status();
      addresses.push_back(parsed->addresses.front());
    }
    return addresses;
  }
  // For documentation alone (RFC 5737): no machine has it.
  static constexpr char kNotHere[] = "192.0.2.1";
};

TEST_F(BindHostTest, AllAddressesHaveOnePort) {
  const auto sockets = BindHost(Host({"127.0.0.1", "127.0.0.2"}, 0));
  ASSERT_TRUE(sockets.ok()) << sockets.status();
  ASSERT_EQ(sockets->size(), 2u);
  EXPECT_GT(sockets->front().address().port(), 0);
  EXPECT_EQ(sockets->front().address().port(), sockets->back().address().port());
  for (const ListenSocket& socket : *sockets) EXPECT_TRUE(CanConnect(socket.address()));
}

// Whoever comes to the address that is taken would meet another server.
TEST_F(BindHostTest, APortThatIsTakenAtOneAddressIsNotPassedOver) {
  const auto other = BindAll({"127.0.0.2:0"}, 0600);
  ASSERT_TRUE(other.ok()) << other.status();
  const SocketAddress taken = other->front().address();
  const absl::Status status = BindHost(Host({"127.0.0.1", "127.0.0.2"}, taken.port())).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr(taken.ToString()));
  EXPECT_THAT(std::string(status.message()), HasSubstr("in use"));
}

TEST_F(BindHostTest, WhatThisMachineHasNotIsLeftOut) {
  const auto sockets = BindHost(Host({kNotHere, "127.0.0.1"}, 0));
  ASSERT_TRUE(sockets.ok()) << sockets.status();
  ASSERT_EQ(sockets->size(), 1u);
  EXPECT_TRUE(CanConnect(sockets->front().address()));
  const absl::Status status = BindHost(Host({kNotHere}, 7)).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr("192.0.2.1:7"));
}

TEST(ListenSocketTest, AUnixSocketHasItsModeAndGoesAway) {
  const testing_support::TempDir dir;
  const std::string path = dir.File("s.sock");
  {
    const auto sockets = BindAll({"unix:" + path, "127.0.0.1:0"}, 0640);
    ASSERT_TRUE(sockets.ok()) << sockets.status();
    ASSERT_EQ(sockets->size(), 2u);
    struct stat file {};
    ASSERT_EQ(stat(path.c_str(), &file), 0);
    EXPECT_EQ(file.st_mode & 0777, 0640u);
    EXPECT_TRUE(CanConnect(sockets->front().address()));
    // Another server may not take it.
    EXPECT_THAT(std::string(BindAll({"unix:" + path}, 0600).status().message()),
                HasSubstr("another server listens there"));
    EXPECT_TRUE(Exists(path));
  }
  EXPECT_FALSE(Exists(path));
}

TEST(ListenSocketTest, AStaleSocketIsReplacedAndAFileIsNot) {
  const testing_support::TempDir dir;
  const std::string path = dir.File("s.sock");
  const SocketAddress address = *UnixAddress(path);
  const int left = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  ASSERT_EQ(bind(left, address.get(), address.length), 0);
  close(left);  // As a killed server leaves it.
  ASSERT_TRUE(Exists(path));
  {
    const auto sockets = BindAll({"unix:" + path}, 0600);
    ASSERT_TRUE(sockets.ok()) << sockets.status();
    EXPECT_TRUE(CanConnect(address));
  }
  std::ofstream(path) << "precious";
  EXPECT_THAT(std::string(BindAll({"unix:" + path}, 0600).status().message()),
              HasSubstr("is no socket"));
  EXPECT_TRUE(Exists(path));
}

// A socket that another server has put in its place by now stays.
TEST(ListenSocketTest, OnlyItsOwnFileGoes) {
  const testing_support::TempDir dir;
  const std::string path = dir.File("s.sock");
  auto first = BindAll({"unix:" + path}, 0600);
  ASSERT_TRUE(first.ok()) << first.status();
  ASSERT_EQ(unlink(path.c_str()), 0);
  const auto second = BindAll({"unix:" + path}, 0600);
  ASSERT_TRUE(second.ok()) << second.status();
  first->clear();
  EXPECT_TRUE(CanConnect(second->front().address()));
}

}  // namespace
}  // namespace sightline
