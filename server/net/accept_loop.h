// SPDX-License-Identifier: Apache-2.0
//
// Takes connections and hands them over. gRPC's own loop stops for good when descriptors run out
// (CVE-2023-4785) and takes connections without end; this one goes on, and is bounded.
//
// Invariants
//  1. Beyond the limits, in all and of one address, a connection is closed as soon as it is taken,
//     so that its client hears of it at once and tries elsewhere. Those through Unix sockets count
//     among all; clients there have no addresses.
//  2. Without a free descriptor the one held in reserve is given up for a moment: the connection is
//     taken and closed. Where even that fails, since somebody else was faster to use it, the loop
//     waits kPause and tries again, and the next free one becomes the reserve.
//  3. A connection whose peer was announced by Expect is handed over whatever the bound, and said
//     to be ours: it is how the server's own liveness probe gets in. Nobody else can have that
//     address while the probe's socket has it.
//
// Thread safety: every method from any thread; `hand_over` is called from the loop's own thread and
// owns the descriptor (non-blocking, close-on-exec).
//
//   AcceptLoop loop(std::move(sockets), {.all = 1000, .per_address = 500},
//                   [&](const TakenConnection& taken) { ... });
//   loop.Start();
#ifndef SIGHTLINE_SERVER_NET_ACCEPT_LOOP_H_
#define SIGHTLINE_SERVER_NET_ACCEPT_LOOP_H_

#include <atomic>
#include <cstdint>
#include <functional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "core/base/mutex.h"
#include "server/net/connection_table.h"
#include "server/net/listen_socket.h"

namespace sightline {

struct TakenConnection {
  int fd = -1;
  int listener_fd = -1;
  bool is_unix = false;  // Through a Unix socket.
  bool is_ours = false;  // Announced by Expect.
};

struct ConnectionLimits {
  size_t all = 1000, per_address = 500;
};

class AcceptLoop {
 public:
  using HandOver = std::function<void(const TakenConnection&)>;

  struct Counts {
    uint64_t open = 0, accepted = 0, refused = 0;
  };

  AcceptLoop(std::vector<ListenSocket> sockets, const ConnectionLimits& limits, HandOver hand_over);
  ~AcceptLoop();
  AcceptLoop(const AcceptLoop&) = delete;
  AcceptLoop& operator=(const AcceptLoop&) = delete;

  // REQUIRES: once.
  void Start();
  // Takes no more connections and closes the sockets. Again does no harm.
  void Stop();

  // The next connection from `peer` (an address's text) is ours; Forget takes it back.
  void Expect(const std::string& peer);
  void Forget(const std::string& peer);

  const std::vector<ListenSocket>& sockets() const { return sockets_; }
  Counts counts();

 private:
  void Run();
  // False when nothing waits any more, or nothing can be taken now.
  bool TakeOne(const ListenSocket& socket);
  void TakeAndClose(const ListenSocket& socket);
  bool IsExpected(const SocketAddress& peer);
  bool IsOneTooMany(const std::string& host);
  // Until something happens or `milliseconds` (-1: no end) are over; false to stop.
  bool Wait(bool sockets, int milliseconds);

  std::vector<ListenSocket> sockets_;
  const ConnectionLimits limits_;
  const HandOver hand_over_;
  ConnectionTable connections_;
  std::atomic<uint64_t> accepted_ = 0, refused_ = 0;
  int wake_ = -1;
  // Of the loop's thread alone.
  int reserve_ = -1;  // Held open to be given up; -1 where another thread was faster.
  bool paused_ = false, exhausted_ = false;
  std::thread thread_;
  Mutex mutex_;
  std::set<std::string> expected_ ABSL_GUARDED_BY(mutex_);
};

// The most connections that the process's limit on descriptors allows, leaving some for files and
// for everything else.
size_t ConnectionsWithinDescriptors();

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_NET_ACCEPT_LOOP_H_
