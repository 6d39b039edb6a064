// SPDX-License-Identifier: Apache-2.0
//
// Where a server listens: HOST:PORT, resolved to what the kernel takes, or the path of a Unix
// socket.
//
// Invariant: a ListenAddress has a path or at least one address, never both.
//
// Thread safety: plain values.
//
//   SL_ASSIGN_OR_RETURN(const ListenAddress address, ParseListenAddress("127.0.0.1:7070"));
//   bind(fd, address.addresses[0].get(), address.addresses[0].length);
#ifndef SIGHTLINE_SERVER_NET_SOCKET_ADDRESS_H_
#define SIGHTLINE_SERVER_NET_SOCKET_ADDRESS_H_

#include <sys/socket.h>

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace sightline {

struct SocketAddress {
  sockaddr_storage storage{};
  socklen_t length = 0;

  sockaddr* get() { return reinterpret_cast<sockaddr*>(&storage); }
  const sockaddr* get() const { return reinterpret_cast<const sockaddr*>(&storage); }
  int family() const { return storage.ss_family; }
  // 0 for Unix sockets.
  int port() const;
  void set_port(int port);
  // Only this machine reaches it; every Unix socket is so.
  bool IsLoopback() const;
  // The address by which this machine reaches it: loopback in the place of "every interface".
  SocketAddress Reachable() const;
  // "127.0.0.1:7070", "[::1]:7070", "unix:PATH", "unix-abstract:NAME" (a socket without a file).
  std::string ToString() const;
  // "127.0.0.1", "::1", and nothing for a Unix socket.
  std::string Host() const;
};

struct ListenAddress {
  std::string unix_path;                 // Empty for HOST:PORT.
  std::vector<SocketAddress> addresses;  // Of HOST; a name may have several.

  bool IsLoopback() const;
};

// "HOST:PORT", "[IPV6]:PORT" or "unix:PATH"; a host may be a name. InvalidArgument naming the text
// and the form, Unavailable (the name cannot be resolved).
absl::StatusOr<ListenAddress> ParseListenAddress(absl::string_view text);

// InvalidArgument: longer than the kernel takes (107 bytes).
absl::StatusOr<SocketAddress> UnixAddress(const std::string& path);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_NET_SOCKET_ADDRESS_H_
