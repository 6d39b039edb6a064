// SPDX-License-Identifier: Apache-2.0
#include "server/net/socket_address.h"

#include <sys/socket.h>
#include <sys/un.h>

#include <string>

#include "gtest/gtest.h"

namespace sightline {
namespace {

TEST(SocketAddressTest, ReadsWhatItWrites) {
  for (const char* text : {"127.0.0.1:7070", "0.0.0.0:0", "[::1]:65535", "[::]:1"}) {
    const absl::StatusOr<ListenAddress> address = ParseListenAddress(text);
    ASSERT_TRUE(address.ok()) << address.status();
    ASSERT_EQ(address->addresses.size(), 1u);
    EXPECT_EQ(address->addresses[0].ToString(), text);
    EXPECT_EQ(address->unix_path, "");
  }
  EXPECT_EQ(ParseListenAddress("unix:run/s.sock")->unix_path, "run/s.sock");
  EXPECT_EQ(UnixAddress("run/s.sock")->ToString(), "unix:run/s.sock");
}

// One has a file of that name, the other has none: they are not the same.
TEST(SocketAddressTest, AnAbstractSocketIsNoFile) {
  SocketAddress address = *UnixAddress("@run");
  EXPECT_EQ(address.ToString(), "unix:@run");
  auto* const un = reinterpret_cast<sockaddr_un*>(&address.storage);
  un->sun_path[0] = '\0';
  address.length -= 1;  // It has no null at its end.
  EXPECT_EQ(address.ToString(), "unix-abstract:run");
  // Of a client that has no address.
  address = SocketAddress();
  address.storage.ss_family = AF_UNIX;
  address.length = sizeof(sa_family_t);
  EXPECT_EQ(address.ToString(), "unix:");
}

TEST(SocketAddressTest, KnowsWhatStaysOnThisMachine) {
  const std::pair<const char*, bool> cases[] = {
      {"127.0.0.1:1", true}, {"127.9.9.9:1", true}, {"[::1]:1", true},
      {"unix:a", true},      {"localhost:1", true}, {"0.0.0.0:1", false},
      {"[::]:1", false},     {"10.0.0.1:1", false}, {"[2001:db8::1]:1", false}};
  for (const auto& [text, loopback] : cases) {
    const absl::StatusOr<ListenAddress> address = ParseListenAddress(text);
    ASSERT_TRUE(address.ok()) << address.status();
    EXPECT_EQ(address->IsLoopback(), loopback) << text;
  }
}

TEST(SocketAddressTest, EveryInterfaceIsReachedByLoopback) {
  EXPECT_EQ(ParseListenAddress("0.0.0.0:7")->addresses[0].Reachable().ToString(), "127.0.0.1:7");
  EXPECT_EQ(ParseListenAddress("[::]:7")->addresses[0].Reachable().ToString(), "[::1]:7");
  EXPECT_EQ(ParseListenAddress("10.0.0.1:7")->addresses[0].Reachable().ToString(), "10.0.0.1:7");
}

// As a listener for both families says it.
TEST(SocketAddressTest, AMappedAddressIsTheMachineThatItMaps) {
  const auto mapped = ParseListenAddress("[::ffff:192.0.2.1]:80");
  const auto plain = ParseListenAddress("192.0.2.1:80");
  ASSERT_TRUE(mapped.ok() && plain.ok());
  ASSERT_FALSE(mapped->addresses.empty() || plain->addresses.empty());
  EXPECT_EQ(mapped->addresses[0].Host(), "192.0.2.1");
  EXPECT_EQ(mapped->addresses[0].ToString(), plain->addresses[0].ToString());
}

TEST(SocketAddressTest, RefusesWhatIsNoAddress) {
  for (const char* text : {"", ":", "7070", ":7070", "host", "127.0.0.1:", "127.0.0.1:65536",
                           "127.0.0.1:-1", "127.0.0.1:http", "::1:70", "[::1]70", "unix:"}) {
    EXPECT_EQ(ParseListenAddress(text).status().code(), absl::StatusCode::kInvalidArgument) << text;
  }
  EXPECT_EQ(ParseListenAddress("unix:" + std::string(108, 'x')).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(ParseListenAddress("unix:" + std::string(107, 'x')).ok());
}

}  // namespace
}  // namespace sightline
