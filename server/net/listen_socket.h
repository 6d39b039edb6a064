// SPDX-License-Identifier: Apache-2.0
//
// A socket that listens, bound by ourselves and not by gRPC: never shared with another process
// (SO_REUSEPORT is off), and for Unix sockets with the file's permissions set before the first
// connection can come.
//
// Invariant: the file of a Unix socket goes with the object, unless another has taken its place.
//
// Thread safety: constant after construction, but for Close.
//
//   SL_ASSIGN_OR_RETURN(ListenSocket socket, ListenSocket::Bind(address, 0600));
//   const int fd = accept4(socket.fd(), nullptr, nullptr, SOCK_CLOEXEC);
#ifndef SIGHTLINE_SERVER_NET_LISTEN_SOCKET_H_
#define SIGHTLINE_SERVER_NET_LISTEN_SOCKET_H_

#include <sys/types.h>

#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "server/net/socket_address.h"

namespace sightline {

class ListenSocket {
 public:
  // Unavailable naming the address and the reason, NotFound if this machine does not have the
  // address or its family. A socket file that nobody listens behind any more is taken away; one
  // that somebody does, or a file that is no socket, is an error.
  // `mode`: permissions of a Unix socket's file.
  static absl::StatusOr<ListenSocket> Bind(const SocketAddress& address, mode_t mode);

  ListenSocket(ListenSocket&& other) noexcept { *this = std::move(other); }
  ListenSocket& operator=(ListenSocket&& other) noexcept;
  ~ListenSocket() { Close(); }

  void Close();

  int fd() const { return fd_; }
  // With the port that was bound.
  const SocketAddress& address() const { return address_; }
  bool is_unix() const { return !path_.empty(); }

 private:
  ListenSocket() = default;

  int fd_ = -1;
  SocketAddress address_;
  std::string path_;  // Of a Unix socket.
  dev_t device_ = 0;
  ino_t inode_ = 0;
};

// Binds the addresses of one name: all that this machine has, with one port. Those that it has not
// are left out and logged; any other error is one of the whole, such as a port that is taken, or
// clients would come to another server. Unavailable.
absl::StatusOr<std::vector<ListenSocket>> BindHost(const std::vector<SocketAddress>& addresses);

// Binds every address of every text ("HOST:PORT", "unix:PATH"). InvalidArgument, Unavailable.
absl::StatusOr<std::vector<ListenSocket>> BindAll(const std::vector<std::string>& texts,
                                                  mode_t unix_mode);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_NET_LISTEN_SOCKET_H_
