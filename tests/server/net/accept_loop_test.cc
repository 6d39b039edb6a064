// SPDX-License-Identifier: Apache-2.0
#include "server/net/accept_loop.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/mutex.h"
#include "gtest/gtest.h"
#include "server/base/log.h"
#include "tests/support/temp_dir.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

// A loop on a free port, and what it has taken. It greets each connection with a byte.
class Door {
 public:
  explicit Door(size_t most, size_t most_of_one = 500, const std::string& listen = "127.0.0.1:0")
      : loop_(*BindAll({listen}, 0600), {most, most_of_one}, [this](const TakenConnection& c) {
          MutexLock lock(mutex_);
          send(c.fd, "!", 1, MSG_NOSIGNAL);
          taken_.push_back(c);
          changed_.SignalAll();
        }) {
    SetLogLevel(LogLevel::kOff);
  }
  ~Door() {
    loop_.Stop();
    for (const TakenConnection& each : taken_) close(each.fd);
  }

  // A connection that waits to be taken; -1 with errno set.
  int Connect(SocketAddress* own = nullptr) {
    const SocketAddress& address = loop_.sockets().front().address();
    const int fd = socket(address.family(), SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0) return -1;
    if (own != nullptr) {
      *own = address;
      own->set_port(0);
      if (own->family() == AF_UNIX) own->length = sizeof(sa_family_t);  // Any abstract address.
      if (bind(fd, own->get(), own->length) != 0) return -1;
      own->length = sizeof(own->storage);
      getsockname(fd, own->get(), &own->length);
      loop_.Expect(own->ToString());
    }
    return connect(fd, address.get(), address.length) == 0 ? fd : -1;
  }
  // The same from another address of this machine's, 127.0.0.`last`.
  int ConnectFrom(unsigned char last) {
    const SocketAddress& address = loop_.sockets().front().address();
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0) return -1;
    sockaddr_in own{};
    own.sin_family = AF_INET;
    own.sin_addr.s_addr = htonl(INADDR_LOOPBACK - 1 + last);
    if (bind(fd, reinterpret_cast<const sockaddr*>(&own), sizeof(own)) != 0) return -1;
    return connect(fd, address.get(), address.length) == 0 ? fd : -1;
  }
  TakenConnection WaitFor(size_t count) {
    MutexLock lock(mutex_);
    while (taken_.size() < count) changed_.Wait(mutex_);
    return taken_[count - 1];
  }
  // Ends the n-th taken connection, as gRPC would.
  void Close(size_t n) {
    MutexLock lock(mutex_);
    close(taken_[n].fd);
    taken_[n].fd = -1;
  }
  AcceptLoop& loop() { return loop_; }

 private:
  Mutex mutex_;
  CondVar changed_;
  std::vector<TakenConnection> taken_ ABSL_GUARDED_BY(mutex_);
  AcceptLoop loop_;
};

// Whether the other side closes without a word: waits until it does that or greets.
bool IsClosed(int fd) {
  char byte;
  return recv(fd, &byte, 1, 0) <= 0;
}

TEST(AcceptLoopTest, BeyondTheBoundConnectionsAreClosedAtOnce) {
  Door door(2);
  door.loop().Start();
  const int first = door.Connect(), second = door.Connect();
  door.WaitFor(2);
  const int third = door.Connect();
  EXPECT_TRUE(IsClosed(third));
  AcceptLoop::Counts counts = door.loop().counts();
  EXPECT_EQ(counts.open, 2u);
  EXPECT_EQ(counts.accepted, 2u);
  EXPECT_EQ(counts.refused, 1u);
  // One that ends makes room for another, without anybody saying so.
  door.Close(0);
  EXPECT_EQ(door.loop().counts().open, 1u);
  const int fourth = door.Connect();
  door.WaitFor(3);
  EXPECT_EQ(door.loop().counts().open, 2u);
  for (const int fd : {first, second, third, fourth}) close(fd);
}

TEST(AcceptLoopTest, AnAddressHasItsShare) {
  Door door(/*most=*/4, /*most_of_one=*/2);
  door.loop().Start();
  const int first = door.ConnectFrom(1), second = door.ConnectFrom(1);
  door.WaitFor(2);
  const int third = door.ConnectFrom(1);
  EXPECT_TRUE(IsClosed(third));
  const int other = door.ConnectFrom(2);
  door.WaitFor(3);
  EXPECT_EQ(door.loop().counts().open, 3u);
  EXPECT_EQ(door.loop().counts().refused, 1u);
  // What is closed is the address's again.
  door.Close(1);
  const int fourth = door.ConnectFrom(1);
  door.WaitFor(4);
  const int fifth = door.ConnectFrom(1);
  EXPECT_TRUE(IsClosed(fifth));
  // All of them have theirs together, too.
  const int sixth = door.ConnectFrom(3);
  door.WaitFor(5);
  const int seventh = door.ConnectFrom(4);
  EXPECT_TRUE(IsClosed(seventh));
  for (const int fd : {first, second, third, other, fourth, fifth, sixth, seventh}) close(fd);
}

TEST(AcceptLoopTest, TheProbeGetsInWhateverTheBound) {
  const testing_support::TempDir dir;
  for (const std::string& listen :
       {std::string("127.0.0.1:0"), absl::StrCat("unix:", dir.File("s.sock"))}) {
    SCOPED_TRACE(listen);
    Door door(1, /*most_of_one=*/500, listen);
    door.loop().Start();
    const int client = door.Connect();
    EXPECT_FALSE(door.WaitFor(1).is_ours);
    SocketAddress own;
    const int probe = door.Connect(&own);
    // Whoever is refused hears of it, so that the wait for the probe would have an end.
    char byte = 0;
    ASSERT_EQ(recv(probe, &byte, 1, 0), 1);
    EXPECT_TRUE(door.WaitFor(2).is_ours);
    // Only the connection that was announced, and only once.
    const int other = door.Connect();
    EXPECT_TRUE(IsClosed(other));
    EXPECT_EQ(door.loop().counts().open, 1u);
    for (const int fd : {client, probe, other}) close(fd);
  }
}

TEST(AcceptLoopTest, StopEndsAWaitingLoop) {
  Door door(10);
  door.loop().Start();
  door.loop().Stop();
  EXPECT_EQ(door.Connect(), -1);
  door.loop().Stop();  // Again does no harm.
}

// The rest in processes of their own, whose limits on descriptors do not matter to others.
void Must(bool good, const char* what) {
  if (good) return;
  std::fprintf(stderr, "failed: %s\n", what);
  std::_Exit(1);
}
// All descriptors but those that are open, copies of `some`.
std::vector<int> FillTheTable(int some) {
  rlimit limit{};
  Must(getrlimit(RLIMIT_NOFILE, &limit) == 0, "getrlimit");
  limit.rlim_cur = 64;
  Must(setrlimit(RLIMIT_NOFILE, &limit) == 0, "setrlimit");
  std::vector<int> fill;
  for (int fd; (fd = dup(some)) >= 0;) fill.push_back(fd);
  Must(fill.size() > 3, "filling the table");
  return fill;
}

void RunOutOfDescriptors() {
  Door door(1000);
  std::vector<int> waiting;
  for (int i = 0; i < 5; ++i) waiting.push_back(door.Connect());
  Must(waiting.back() >= 0, "connecting");
  const int spare = dup(waiting[0]);  // The loop's thread needs none; a client will.
  const std::vector<int> fill = FillTheTable(spare);
  door.loop().Start();
  // Those that wait hear at once that there is no room...
  for (const int fd : waiting) Must(IsClosed(fd), "closing what cannot be kept");
  Must(door.loop().counts().refused >= 5, "counting the refused");
  // ... and as soon as there is, the loop goes on.
  for (const int fd : fill) close(fd);
  // It may just be closing whatever comes: then the next one is taken.
  int later = door.Connect();
  while (later >= 0 && IsClosed(later)) later = door.Connect();
  Must(later >= 0, "connecting again");
  Must(door.WaitFor(1).fd >= 0, "taking again");
  std::fprintf(stderr, "recovered\n");
  std::_Exit(0);
}

// Another thread has what the reserve was: the next descriptor that is free becomes the reserve, so
// that who comes hears that there is no room, and is not left waiting in the kernel's queue.
void LoseTheReserve() {
  const int client = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  Must(client >= 0, "a socket");
  std::vector<int> fill = FillTheTable(client);
  const auto free_one = [&fill] {
    close(fill.back());
    fill.pop_back();
  };
  free_one();
  free_one();
  Door door(1000);  // A socket to listen at, and what wakes the loop: none is left for a reserve.
  Must(dup(client) < 0, "none is left");
  door.loop().Start();
  free_one();
  const SocketAddress& address = door.loop().sockets().front().address();
  Must(connect(client, address.get(), address.length) == 0, "connecting");
  Must(IsClosed(client), "closing what cannot be kept");
  std::fprintf(stderr, "refused\n");
  std::_Exit(0);
}

TEST(AcceptLoopTest, AReserveThatWasLostIsHadAgain) {
  if (testing_support::kSanitizerBuild) {
    GTEST_SKIP()
        << "sanitizers open pipes to look at pointers, and report those they cannot look at";
  }
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(LoseTheReserve(), ::testing::ExitedWithCode(0), "refused");
}

TEST(AcceptLoopTest, ItRecoversFromALackOfDescriptors) {
  if (testing_support::kSanitizerBuild) {
    GTEST_SKIP()
        << "sanitizers open pipes to look at pointers, and report those they cannot look at";
  }
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(RunOutOfDescriptors(), ::testing::ExitedWithCode(0), "recovered");
}

}  // namespace
}  // namespace sightline
