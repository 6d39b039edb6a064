// SPDX-License-Identifier: Apache-2.0
//
// Channels as the library makes them.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "absl/strings/str_cat.h"
#include "client/lib/connection.h"
#include "grpcpp/create_channel.h"
#include "grpcpp/security/credentials.h"
#include "gtest/gtest.h"

namespace sightline::client {
namespace {

// Over a long way, with TLS or to a busy server, a connection takes longer to come about than the
// first back-off. A channel that hung up then would never connect.
TEST(GrpcConnectionTest, WaitsForAServerThatIsSlowToSpeak) {
  const int listener = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  ASSERT_GE(listener, 0);
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof(address);
  ASSERT_EQ(::bind(listener, reinterpret_cast<const sockaddr*>(&address), size), 0);
  ASSERT_EQ(::listen(listener, 4), 0);
  ASSERT_EQ(::getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size), 0);

  const auto channel =
      grpc::CreateCustomChannel(absl::StrCat("127.0.0.1:", ntohs(address.sin_port)),
                                grpc::InsecureChannelCredentials(), DefaultChannelArguments());
  channel->GetState(/*try_to_connect=*/true);
  const int connection = ::accept(listener, nullptr, nullptr);
  ASSERT_GE(connection, 0);
  // Nothing is said to it, and it must not hang up.
  pollfd hung_up = {.fd = connection, .events = POLLRDHUP, .revents = 0};
  EXPECT_EQ(::poll(&hung_up, 1, /*timeout=*/1000), 0);
  ::close(connection);
  ::close(listener);
}

}  // namespace
}  // namespace sightline::client
