// SPDX-License-Identifier: Apache-2.0
#include "server/net/listen_socket.h"

#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <iterator>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "core/base/status_macros.h"
#include "server/base/log.h"

namespace sightline {
namespace {

constexpr int kBacklog = 1024;  // The kernel cuts it to net.core.somaxconn.
// A port that is free at one address may be taken at another: so many are tried.
constexpr int kMostPortsTried = 32;

absl::Status CannotListen(const SocketAddress& address, absl::string_view why) {
  return absl::UnavailableError(absl::StrCat("cannot listen on ", address.ToString(), ": ", why));
}

absl::Status CannotListen(const SocketAddress& address) {
  const int error = errno;
  absl::Status status = CannotListen(address, std::strerror(error));
  const bool not_here =
      address.family() != AF_UNIX && (error == EADDRNOTAVAIL || error == EAFNOSUPPORT);
  return not_here ? absl::NotFoundError(status.message()) : status;
}

// The path of a Unix socket's address; empty for others.
std::string PathOf(const SocketAddress& address) {
  const std::string text = address.ToString();
  absl::string_view path = text;
  return absl::ConsumePrefix(&path, "unix:") ? std::string(path) : "";
}

// Takes away the file that a server left which did not get to do so itself.
absl::Status RemoveStale(const SocketAddress& address, const std::string& path) {
  struct stat file {};
  if (lstat(path.c_str(), &file) != 0) {
    return errno == ENOENT ? absl::OkStatus() : CannotListen(address);
  }
  if (!S_ISSOCK(file.st_mode)) return CannotListen(address, "the file is there and is no socket");
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return CannotListen(address);
  const bool stale = connect(fd, address.get(), address.length) != 0 && errno == ECONNREFUSED;
  close(fd);
  if (!stale) return CannotListen(address, "another server listens there");
  return unlink(path.c_str()) == 0 ? absl::OkStatus() : CannotListen(address);
}

}  // namespace

ListenSocket& ListenSocket::operator=(ListenSocket&& other) noexcept {
  if (this == &other) return *this;
  Close();
  fd_ = std::exchange(other.fd_, -1);
  address_ = other.address_;
  path_ = std::move(other.path_);
  device_ = other.device_;
  inode_ = other.inode_;
  return *this;
}

void ListenSocket::Close() {
  if (fd_ < 0) return;
  struct stat file {};
  if (is_unix() && lstat(path_.c_str(), &file) == 0 && file.st_dev == device_ &&
      file.st_ino == inode_) {
    unlink(path_.c_str());
  }
  close(std::exchange(fd_, -1));
}

absl::StatusOr<ListenSocket> ListenSocket::Bind(const SocketAddress& address, mode_t mode) {
  ListenSocket made;
  made.address_ = address;
  const std::string path = PathOf(address);
  if (!path.empty()) SL_RETURN_IF_ERROR(RemoveStale(address, path));
  made.fd_ = socket(address.family(), SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (made.fd_ < 0) return CannotListen(address);
  const int on = 1, off = 0;
  if (path.empty()) {
    // So that a restart need not wait for connections of before to time out. Not SO_REUSEPORT:
    // two servers must not share a port in silence.
    setsockopt(made.fd_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  }
  if (address.family() == AF_INET6) {
    setsockopt(made.fd_, IPPROTO_IPV6, IPV6_V6ONLY, &off, sizeof(off));
  }
  if (bind(made.fd_, address.get(), address.length) != 0) return CannotListen(address);
  if (!path.empty()) {
    struct stat file {};
    if (lstat(path.c_str(), &file) != 0) return CannotListen(address);
    made.path_ = path;
    made.device_ = file.st_dev;
    made.inode_ = file.st_ino;
    // Nobody can connect before listen().
    if (chmod(path.c_str(), mode) != 0) return CannotListen(address);
  }
  if (listen(made.fd_, kBacklog) != 0) return CannotListen(address);
  made.address_.length = sizeof(made.address_.storage);
  if (getsockname(made.fd_, made.address_.get(), &made.address_.length) != 0) {
    return CannotListen(address);
  }
  return made;
}

absl::StatusOr<std::vector<ListenSocket>> BindHost(const std::vector<SocketAddress>& addresses) {
  std::vector<ListenSocket> sockets;
  std::vector<absl::Status> left_out;
  for (int tried = 1;; ++tried) {
    absl::Status failed;
    bool same_port = false;
    for (SocketAddress each : addresses) {
      same_port = each.port() == 0 && !sockets.empty();
      if (same_port) each.set_port(sockets.front().address().port());
      absl::StatusOr<ListenSocket> bound = ListenSocket::Bind(each, /*mode=*/0);
      if (bound.ok()) {
        sockets.push_back(*std::move(bound));
      } else if (absl::IsNotFound(bound.status())) {
        left_out.push_back(bound.status());  // Such as ::1 on a machine without IPv6.
      } else {
        failed = bound.status();
        break;
      }
    }
    if (failed.ok()) break;
    if (!same_port || tried == kMostPortsTried) return failed;
    sockets.clear();
    left_out.clear();
  }
  if (sockets.empty()) {
    return absl::UnavailableError(left_out.empty() ? "the host has no address"
                                                   : left_out.back().message());
  }
  for (const absl::Status& status : left_out) {
    Log(LogLevel::kWarning, "address_left_out", {{"status", status.ToString()}});
  }
  return sockets;
}

absl::StatusOr<std::vector<ListenSocket>> BindAll(const std::vector<std::string>& texts,
                                                  mode_t unix_mode) {
  std::vector<ListenSocket> sockets;
  for (const std::string& text : texts) {
    SL_ASSIGN_OR_RETURN(ListenAddress address, ParseListenAddress(text));
    if (!address.unix_path.empty()) {
      SL_ASSIGN_OR_RETURN(const SocketAddress unix_address, UnixAddress(address.unix_path));
      SL_ASSIGN_OR_RETURN(ListenSocket bound, ListenSocket::Bind(unix_address, unix_mode));
      sockets.push_back(std::move(bound));
      continue;
    }
    SL_ASSIGN_OR_RETURN(std::vector<ListenSocket> bound, BindHost(address.addresses));
    std::move(bound.begin(), bound.end(), std::back_inserter(sockets));
  }
  return sockets;
}

}  // namespace sightline
