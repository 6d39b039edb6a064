// SPDX-License-Identifier: Apache-2.0
//
// Channels as the library makes them.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "client/lib/connection.h"
#include "client/lib/security.h"
#include "grpcpp/create_channel.h"
#include "grpcpp/security/credentials.h"
#include "gtest/gtest.h"

namespace sightline::client {
namespace {

// A socket that listens on a port of 127.0.0.1.
class Listener {
 public:
  Listener() : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    const bool listens = ::bind(socket_, reinterpret_cast<const sockaddr*>(&address), size) == 0 &&
                         ::listen(socket_, 4) == 0 &&
                         ::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size) == 0;
    if (listens) port_ = ntohs(address.sin_port);
  }
  ~Listener() { ::close(socket_); }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  int socket() const { return socket_; }
  int port() const { return port_; }  // 0: it does not listen.

 private:
  const int socket_;
  int port_ = 0;
};

// An environment variable that is set, or unset by null, and then is what it was.
class ScopedEnv {
 public:
  ScopedEnv(const char* name, const char* value) : name_(name) {
    if (const char* old = std::getenv(name)) old_ = old;
    Set(value);
  }
  ~ScopedEnv() { Set(old_.has_value() ? old_->c_str() : nullptr); }
  ScopedEnv(const ScopedEnv&) = delete;
  ScopedEnv& operator=(const ScopedEnv&) = delete;

 private:
  void Set(const char* value) {
    if (value == nullptr) {
      unsetenv(name_);
    } else {
      setenv(name_, value, 1);
    }
  }

  const char* const name_;
  std::optional<std::string> old_;
};

std::map<std::string, int> NumbersOf(const grpc::ChannelArguments& arguments) {
  const grpc_channel_args all = arguments.c_channel_args();
  std::map<std::string, int> numbers;
  for (size_t i = 0; i < all.num_args; ++i) {
    const grpc_arg& argument = all.args[i];
    if (argument.type == GRPC_ARG_INTEGER) numbers[argument.key] = argument.value.integer;
  }
  return numbers;
}

// Over a long way, with TLS or to a busy server, a connection takes longer to come about than the
// first back-off. A channel that hung up then would never connect.
TEST(GrpcConnectionTest, WaitsForAServerThatIsSlowToSpeak) {
  const Listener listener;
  ASSERT_NE(listener.port(), 0);
  const auto channel =
      grpc::CreateCustomChannel(absl::StrCat("127.0.0.1:", listener.port()),
                                grpc::InsecureChannelCredentials(), DefaultChannelArguments());
  channel->GetState(/*try_to_connect=*/true);
  const int connection = ::accept(listener.socket(), nullptr, nullptr);
  ASSERT_GE(connection, 0);
  // Nothing is said to it, and it must not hang up. How long that is to be waited for, another
  // tells that has no more time than the first back-off: it hangs up, tries again, and hangs up
  // again.
  const Listener other;
  ASSERT_NE(other.port(), 0);
  grpc::ChannelArguments hasty = DefaultChannelArguments();
  hasty.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS,
               NumbersOf(hasty).at(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS));
  const auto impatient = grpc::CreateCustomChannel(absl::StrCat("127.0.0.1:", other.port()),
                                                   grpc::InsecureChannelCredentials(), hasty);
  for (int attempt = 0; attempt < 2; ++attempt) {
    impatient->GetState(/*try_to_connect=*/true);
    const int given_up = ::accept(other.socket(), nullptr, nullptr);
    ASSERT_GE(given_up, 0);
    pollfd gone = {.fd = given_up, .events = POLLRDHUP, .revents = 0};
    EXPECT_EQ(::poll(&gone, 1, /*timeout=*/60'000), 1) << "attempt " << attempt;
    ::close(given_up);
  }
  pollfd hung_up = {.fd = connection, .events = POLLRDHUP, .revents = 0};
  EXPECT_EQ(::poll(&hung_up, 1, /*timeout=*/0), 0);
  ::close(connection);
}

// All of it; false once the peer has hung up.
bool Receive(int connection, void* bytes, size_t size) {
  return size == 0 || ::recv(connection, bytes, size, MSG_WAITALL) == static_cast<ssize_t>(size);
}

void Say(int connection, const std::string& bytes) {
  EXPECT_EQ(::send(connection, bytes.data(), bytes.size(), MSG_NOSIGNAL),
            static_cast<ssize_t>(bytes.size()));
}

// Speaks HTTP/2 as far as to open a connection and to answer so many pings; then it is silent until
// the other side hangs up.
void FallSilent(int connection, int pings) {
  constexpr unsigned char kSettings = 4, kPing = 6, kAck = 1;
  const auto frame = [](unsigned char type, unsigned char flags, const std::string& payload) {
    const char header[] = {0,
                           0,
                           static_cast<char>(payload.size()),
                           static_cast<char>(type),
                           static_cast<char>(flags),
                           0,
                           0,
                           0,
                           0};
    return std::string(header, sizeof(header)) + payload;
  };
  std::string payload(24, '\0');  // First of all, what every client begins with.
  if (!Receive(connection, payload.data(), payload.size())) return;
  Say(connection, frame(kSettings, 0, ""));
  std::array<unsigned char, 9> header;
  while (Receive(connection, header.data(), header.size())) {
    payload.resize(size_t{header[0]} << 16 | size_t{header[1]} << 8 | header[2]);
    if (!Receive(connection, payload.data(), payload.size())) return;
    if ((header[4] & kAck) != 0) continue;
    if (header[3] == kSettings) Say(connection, frame(kSettings, kAck, ""));
    if (header[3] == kPing && --pings >= 0) Say(connection, frame(kPing, kAck, payload));
  }
}

// With less time between pings than there is: a call that waits goes on to ask, however little is
// said, and ends when no answer comes, long before its own deadline.
TEST(GrpcConnectionTest, APeerThatFallsSilentIsNoticed) {
  const Listener listener;
  ASSERT_NE(listener.port(), 0);
  std::map<std::string, int> numbers = NumbersOf(DefaultChannelArguments());
  numbers[GRPC_ARG_KEEPALIVE_TIME_MS] = 100;
  numbers[GRPC_ARG_KEEPALIVE_TIMEOUT_MS] = 500;
  grpc::ChannelArguments arguments;
  for (const auto& [key, value] : numbers) arguments.SetInt(key, value);
  std::thread peer([&] {
    const int connection = ::accept(listener.socket(), nullptr, nullptr);
    EXPECT_GE(connection, 0);
    FallSilent(connection, /*pings=*/2);
    ::close(connection);
  });
  {
    const std::shared_ptr<Connection> connection = MakeGrpcConnection(
        {grpc::CreateCustomChannel(absl::StrCat("127.0.0.1:", listener.port()),
                                   grpc::InsecureChannelCredentials(), arguments)});
    const absl::Status status =
        connection->GetCapabilities({.deadline = absl::Now() + absl::Minutes(5)}).status();
    EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  }
  peer.join();
}

// Within a minute. Servers send away who asks more often than every ten seconds
// (kLeastPingIntervalMs).
TEST(GrpcConnectionTest, PeersAreAskedOftenEnoughAndNotTooOften) {
  std::map<std::string, int> numbers = NumbersOf(DefaultChannelArguments());
  EXPECT_GE(numbers[GRPC_ARG_KEEPALIVE_TIME_MS], 20'000);
  EXPECT_GE(numbers[GRPC_ARG_KEEPALIVE_TIMEOUT_MS], 10'000);
  EXPECT_LE(numbers[GRPC_ARG_KEEPALIVE_TIME_MS] + numbers[GRPC_ARG_KEEPALIVE_TIMEOUT_MS], 60'000);
  // Of a call that waits, every ping is one without data.
  ASSERT_TRUE(numbers.contains(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA));
  EXPECT_EQ(numbers[GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA], 0);
}

// A token may go to this machine in the clear, so what is sent there must not take the way of a
// proxy, which may be another machine.
TEST(GrpcConnectionTest, NoProxyIsAskedForAServerOnThisMachine) {
  const Listener server, proxy;
  ASSERT_NE(server.port(), 0);
  ASSERT_NE(proxy.port(), 0);
  const std::string address = absl::StrCat("http://127.0.0.1:", proxy.port());
  // Those that gRPC looks at first.
  const ScopedEnv to_proxy("grpc_proxy", address.c_str());
  const ScopedEnv no_exceptions("no_grpc_proxy", ""), none("no_proxy", "");
  const Security token = {.token = "secret"};
  // Which of the two is connected to.
  const auto asked = [&](const std::string& target) {
    auto channel = MakeChannel(target, token, DefaultChannelArguments());
    channel->GetState(/*try_to_connect=*/true);
    std::array<pollfd, 2> comes = {{{.fd = server.socket(), .events = POLLIN, .revents = 0},
                                    {.fd = proxy.socket(), .events = POLLIN, .revents = 0}}};
    EXPECT_GT(::poll(comes.data(), comes.size(), /*timeout=*/60'000), 0);
    channel.reset();  // Before it could come a second time.
    std::string who;
    for (const pollfd& listener : comes) {
      if (listener.revents == 0) continue;
      who += listener.fd == server.socket() ? "server" : "proxy";
      ::close(::accept(listener.fd, nullptr, nullptr));
    }
    return who;
  };
  EXPECT_EQ(asked(absl::StrCat("127.0.0.1:", server.port())), "server");
  // An address that nobody has: whatever comes of it comes by the proxy.
  EXPECT_EQ(asked(absl::StrCat("192.0.2.1:", server.port())), "proxy");
}

}  // namespace
}  // namespace sightline::client
