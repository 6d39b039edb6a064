// SPDX-License-Identifier: Apache-2.0
#include "server/net/accept_loop.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "core/base/check.h"
#include "server/base/log.h"

namespace sightline {
namespace {

// Between two tries while nothing can be taken: often enough for people, rare enough to cost
// nothing.
constexpr int kPauseMilliseconds = 50;
// So that a flood of connections does not keep the loop from hearing that it shall stop.
constexpr int kMostRefusedAtOnce = 1024;
// What gRPC, the pools, the log, scene files and the probes may need beside connections.
constexpr size_t kSpareDescriptors = 64;
// A peer that does not acknowledge what it was sent for so long is gone.
constexpr unsigned int kUserTimeoutMilliseconds = 20'000;

int OpenReserve() { return open("/dev/null", O_RDONLY | O_CLOEXEC); }

// As gRPC sets its own: small messages at once, and no peer that is gone kept for ever.
void Tune(int fd) {
  const int on = 1;
  setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  setsockopt(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, &kUserTimeoutMilliseconds,
             sizeof(kUserTimeoutMilliseconds));
}

}  // namespace

AcceptLoop::AcceptLoop(std::vector<ListenSocket> sockets, const ConnectionLimits& limits,
                       HandOver hand_over)
    : sockets_(std::move(sockets)),
      limits_(limits),
      hand_over_(std::move(hand_over)),
      wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      reserve_(OpenReserve()) {}

AcceptLoop::~AcceptLoop() {
  Stop();
  if (reserve_ >= 0) close(reserve_);
  if (wake_ >= 0) close(wake_);
}

void AcceptLoop::Start() {
  SIGHTLINE_CHECK(wake_ >= 0) << "no descriptor left to begin with";
  thread_ = std::thread([this] { Run(); });
}

void AcceptLoop::Stop() {
  if (thread_.joinable()) {
    const uint64_t one = 1;
    (void)!write(wake_, &one, sizeof(one));
    thread_.join();
  }
  for (ListenSocket& socket : sockets_) socket.Close();
}

void AcceptLoop::Run() {
  while (Wait(/*sockets=*/!paused_, paused_ ? kPauseMilliseconds : -1)) {
    paused_ = false;
    // Whoever else opened something while it was given up has it now: the next that is free is it.
    if (reserve_ < 0) reserve_ = OpenReserve();
    for (const ListenSocket& socket : sockets_) {
      while (TakeOne(socket)) {
      }
    }
  }
}

bool AcceptLoop::Wait(bool sockets, int milliseconds) {
  std::vector<pollfd> waiting = {{.fd = wake_, .events = POLLIN, .revents = 0}};
  for (size_t i = 0; sockets && i < sockets_.size(); ++i) {
    waiting.push_back({.fd = sockets_[i].fd(), .events = POLLIN, .revents = 0});
  }
  // An interruption is as good as an event: the sockets do not block.
  (void)poll(waiting.data(), waiting.size(), milliseconds);
  return (waiting[0].revents & POLLIN) == 0;
}

bool AcceptLoop::TakeOne(const ListenSocket& socket) {
  SocketAddress peer;
  peer.length = sizeof(peer.storage);
  TakenConnection taken{.listener_fd = socket.fd(), .is_unix = socket.is_unix()};
  taken.fd = accept4(socket.fd(), peer.get(), &peer.length, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (taken.fd < 0) {
    switch (errno) {
      case EINTR:
      case ECONNABORTED:  // It went away while it waited.
        return true;
      case EAGAIN:
        return false;
      case EMFILE:
      case ENFILE:
        TakeAndClose(socket);
        return false;
      default:
        Log(LogLevel::kError, "accept_failed",
            {{"address", socket.address().ToString()}, {"error", std::strerror(errno)}});
        paused_ = true;
        return false;
    }
  }
  if (std::exchange(exhausted_, false)) Log(LogLevel::kInfo, "descriptors_again");
  taken.is_ours = IsExpected(peer);
  const std::string host = taken.is_unix ? "" : peer.Host();
  if (!taken.is_ours && IsOneTooMany(host)) {
    ++refused_;
    close(taken.fd);
    return true;
  }
  if (!taken.is_unix) Tune(taken.fd);
  ++accepted_;
  if (!taken.is_ours) connections_.Add(taken.fd, host);
  hand_over_(taken);
  return true;
}

void AcceptLoop::TakeAndClose(const ListenSocket& socket) {
  // Once, not for every connection or pause.
  if (!std::exchange(exhausted_, true)) {
    Log(LogLevel::kError, "out_of_descriptors", {{"address", socket.address().ToString()}});
  }
  if (reserve_ >= 0) close(std::exchange(reserve_, -1));
  for (int i = 0; i < kMostRefusedAtOnce; ++i) {
    const int fd = accept4(socket.fd(), nullptr, nullptr, SOCK_CLOEXEC);
    if (fd < 0) break;
    ++refused_;
    close(fd);
  }
  reserve_ = OpenReserve();
  // Whoever frees descriptors gets them before more connections do.
  paused_ = true;
}

bool AcceptLoop::IsOneTooMany(const std::string& host) {
  if (connections_.AtLeast(limits_.all)) return true;
  return !host.empty() && connections_.AtLeastOf(host, limits_.per_address);
}

bool AcceptLoop::IsExpected(const SocketAddress& peer) {
  MutexLock lock(mutex_);
  return !expected_.empty() && expected_.erase(peer.ToString()) > 0;
}

void AcceptLoop::Expect(const std::string& peer) {
  MutexLock lock(mutex_);
  expected_.insert(peer);
}

void AcceptLoop::Forget(const std::string& peer) {
  MutexLock lock(mutex_);
  expected_.erase(peer);
}

AcceptLoop::Counts AcceptLoop::counts() {
  return {.open = connections_.CountOpen(), .accepted = accepted_, .refused = refused_};
}

size_t ConnectionsWithinDescriptors() {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return SIZE_MAX;
  const size_t descriptors = limit.rlim_cur;
  return descriptors > 2 * kSpareDescriptors ? descriptors - kSpareDescriptors
                                             : std::max<size_t>(1, descriptors / 2);
}

}  // namespace sightline
