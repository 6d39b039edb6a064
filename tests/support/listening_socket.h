// SPDX-License-Identifier: Apache-2.0
//
// The TCP ports that this process listens on, and the descriptors by which it does: for tests that
// look for a port before anybody says which it is, or let the listener die behind a server's back.
//
// Thread safety: functions only. What they return is as good as the calling test's knowledge of who
// opens and closes sockets meanwhile.
//
//   EXPECT_EQ(ListeningSockets().count(server->port()), 1u);
#ifndef SIGHTLINE_TESTS_SUPPORT_LISTENING_SOCKET_H_
#define SIGHTLINE_TESTS_SUPPORT_LISTENING_SOCKET_H_

#include <map>

namespace sightline::testing_support {

// Descriptors by port, of IPv4.
std::map<int, int> ListeningSockets();

// A listener of this process that lives no more, but only looks so: its port still says LISTEN and
// the kernel still makes connections to it, which nobody takes. Where the process held its
// descriptor there is another socket as long as this object lives.
//
// This is how gRPC's own listener dies when descriptors run out (CVE-2023-4785).
class DeadListener {
 public:
  // REQUIRES: the process listens on `port`.
  explicit DeadListener(int port);
  // The listener is back, and takes what has come meanwhile.
  ~DeadListener();
  DeadListener(const DeadListener&) = delete;
  DeadListener& operator=(const DeadListener&) = delete;

 private:
  const int descriptor_;  // The process's own.
  const int kept_;        // The listener.
  const int idle_;        // What stands in for it.
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_SUPPORT_LISTENING_SOCKET_H_
