// SPDX-License-Identifier: Apache-2.0
#include "server/net/socket_address.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/un.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <memory>

#include "absl/status/status.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

const sockaddr_in& V4(const SocketAddress& address) {
  return *reinterpret_cast<const sockaddr_in*>(&address.storage);
}
const sockaddr_in6& V6(const SocketAddress& address) {
  return *reinterpret_cast<const sockaddr_in6*>(&address.storage);
}

absl::Status Bad(absl::string_view text) {
  return absl::InvalidArgumentError(
      absl::StrCat("\"", text, "\": must be HOST:PORT, [IPV6]:PORT or unix:PATH"));
}

absl::StatusOr<std::vector<SocketAddress>> Resolve(const std::string& host, int port) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE;
  addrinfo* list = nullptr;
  const int error = getaddrinfo(host.c_str(), nullptr, &hints, &list);
  if (error != 0) {
    return absl::UnavailableError(
        absl::StrCat("cannot resolve the host \"", host, "\": ", gai_strerror(error)));
  }
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(list, &freeaddrinfo);
  std::vector<SocketAddress> addresses;
  for (const addrinfo* entry = list; entry != nullptr; entry = entry->ai_next) {
    if (entry->ai_family != AF_INET && entry->ai_family != AF_INET6) continue;
    SocketAddress address;
    std::memcpy(&address.storage, entry->ai_addr, entry->ai_addrlen);
    address.length = entry->ai_addrlen;
    address.set_port(port);
    // A hosts file may name one address twice.
    const bool known = std::any_of(addresses.begin(), addresses.end(), [&](const auto& other) {
      return other.ToString() == address.ToString();
    });
    if (!known) addresses.push_back(address);
  }
  if (addresses.empty()) {
    return absl::UnavailableError(absl::StrCat("the host \"", host, "\" has no IP address"));
  }
  return addresses;
}

}  // namespace

int SocketAddress::port() const {
  if (family() == AF_INET) return ntohs(V4(*this).sin_port);
  return family() == AF_INET6 ? ntohs(V6(*this).sin6_port) : 0;
}

void SocketAddress::set_port(int port) {
  const auto network = htons(static_cast<uint16_t>(port));
  if (family() == AF_INET) reinterpret_cast<sockaddr_in*>(&storage)->sin_port = network;
  if (family() == AF_INET6) reinterpret_cast<sockaddr_in6*>(&storage)->sin6_port = network;
}

bool SocketAddress::IsLoopback() const {
  if (family() == AF_INET) return ntohl(V4(*this).sin_addr.s_addr) >> 24 == 127;
  return family() != AF_INET6 || IN6_IS_ADDR_LOOPBACK(&V6(*this).sin6_addr) != 0;
}

SocketAddress SocketAddress::Reachable() const {
  SocketAddress reachable = *this;
  if (family() == AF_INET && V4(*this).sin_addr.s_addr == htonl(INADDR_ANY)) {
    reinterpret_cast<sockaddr_in*>(&reachable.storage)->sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  }
  if (family() == AF_INET6 && IN6_IS_ADDR_UNSPECIFIED(&V6(*this).sin6_addr) != 0) {
    reinterpret_cast<sockaddr_in6*>(&reachable.storage)->sin6_addr = in6addr_loopback;
  }
  return reachable;
}

std::string SocketAddress::Host() const {
  char host[INET6_ADDRSTRLEN] = "";
  if (family() == AF_INET) inet_ntop(AF_INET, &V4(*this).sin_addr, host, sizeof(host));
  if (family() == AF_INET6) {
    const in6_addr& address = V6(*this).sin6_addr;
    // What a socket for both families calls an IPv4 address: the same machine.
    if (IN6_IS_ADDR_V4MAPPED(&address)) {
      inet_ntop(AF_INET, &address.s6_addr[12], host, sizeof(host));
    } else {
      inet_ntop(AF_INET6, &address, host, sizeof(host));
    }
  }
  return host;
}

std::string SocketAddress::ToString() const {
  switch (family()) {
    case AF_INET:
      return absl::StrCat(Host(), ":", port());
    case AF_INET6:
      if (IN6_IS_ADDR_V4MAPPED(&V6(*this).sin6_addr)) return absl::StrCat(Host(), ":", port());
      return absl::StrCat("[", Host(), "]:", port());
    default:
      break;
  }
  const auto* const path = reinterpret_cast<const sockaddr_un*>(&storage)->sun_path;
  constexpr socklen_t kBefore = offsetof(sockaddr_un, sun_path);
  if (length > kBefore + 1 && path[0] == '\0') {
    return absl::StrCat("unix-abstract:", absl::string_view(path + 1, length - kBefore - 1));
  }
  return absl::StrCat("unix:", path);
}

bool ListenAddress::IsLoopback() const {
  return std::all_of(addresses.begin(), addresses.end(),
                     [](const SocketAddress& address) { return address.IsLoopback(); });
}

absl::StatusOr<ListenAddress> ParseListenAddress(absl::string_view text) {
  ListenAddress address;
  absl::string_view rest = text;
  if (absl::ConsumePrefix(&rest, "unix:")) {
    if (rest.empty()) return Bad(text);
    address.unix_path = std::string(rest);
    SL_RETURN_IF_ERROR(UnixAddress(address.unix_path).status());
    return address;
  }
  const size_t colon = rest.rfind(':');
  if (colon == absl::string_view::npos) return Bad(text);
  int port = 0;
  if (!absl::SimpleAtoi(rest.substr(colon + 1), &port) || port < 0 || port > 65535) {
    return Bad(text);
  }
  absl::string_view host = rest.substr(0, colon);
  const bool bracketed = absl::ConsumePrefix(&host, "[") && absl::ConsumeSuffix(&host, "]");
  if (host.empty() || (!bracketed && host.find_first_of("[]:") != absl::string_view::npos)) {
    return Bad(text);
  }
  SL_ASSIGN_OR_RETURN(address.addresses, Resolve(std::string(host), port));
  return address;
}

absl::StatusOr<SocketAddress> UnixAddress(const std::string& path) {
  SocketAddress address;
  auto* const un = reinterpret_cast<sockaddr_un*>(&address.storage);
  if (path.size() >= sizeof(un->sun_path) || path.find('\0') != std::string::npos) {
    return absl::InvalidArgumentError(absl::StrCat("\"unix:", path, "\": a socket's path may have ",
                                                   sizeof(un->sun_path) - 1, " bytes"));
  }
  un->sun_family = AF_UNIX;
  std::memcpy(un->sun_path, path.data(), path.size());
  address.length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + path.size() + 1);
  return address;
}

}  // namespace sightline
