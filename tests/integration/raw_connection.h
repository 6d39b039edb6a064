// SPDX-License-Identifier: Apache-2.0
//
// A plain TCP connection to a server, and gRPC calls as bytes on it: for clients that no library
// would be, such as those that read nothing, or vanish without taking their leave.
//
// Thread safety: one thread.
//
//   const RawConnection connection(server.port());
//   connection.Send(CallBytes("/sightline.v1.SceneService/ListScenes", {""}, {.whole = true}));
//   const std::string bytes = connection.ReadUntil("grpc-status");
#ifndef SIGHTLINE_TESTS_INTEGRATION_RAW_CONNECTION_H_
#define SIGHTLINE_TESTS_INTEGRATION_RAW_CONNECTION_H_

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

namespace sightline {

class RawConnection {
 public:
  explicit RawConnection(int port) : socket_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0;
  }
  ~RawConnection() { close(socket_); }
  RawConnection(const RawConnection&) = delete;
  RawConnection& operator=(const RawConnection&) = delete;

  bool connected() const { return connected_; }
  // The server may hang up at any byte.
  void Send(const std::string& bytes) const {
    (void)send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  }
  // HTTP/2 begins with the server's settings: a byte of them says that the connection was taken, an
  // end without one that it was refused; kIgnored if nothing comes in that time.
  enum class Fate { kTaken, kRefused, kIgnored };
  Fate FateWithin(absl::Duration time) const {
    ReceiveWithin(time);
    char byte;
    const ssize_t received = recv(socket_, &byte, 1, 0);
    if (received == 1) return Fate::kTaken;
    return received == 0 || errno == ECONNRESET ? Fate::kRefused : Fate::kIgnored;
  }
  // What comes until `text` is in it, or until the server hangs up.
  std::string ReadUntil(const std::string& text) const {
    std::string all;
    char bytes[4096];
    while (!absl::StrContains(all, text)) {
      const ssize_t received = recv(socket_, bytes, sizeof(bytes), 0);
      if (received <= 0) break;
      all.append(bytes, static_cast<size_t>(received));
    }
    return all;
  }
  // What has come, or comes next; nothing once the server has hung up.
  std::string ReadSome() const {
    char bytes[4096];
    const ssize_t received = recv(socket_, bytes, sizeof(bytes), 0);
    return {bytes, received > 0 ? static_cast<size_t>(received) : 0};
  }
  // Whether the server hangs up in that time.
  bool EndsWithin(absl::Duration time) const {
    ReceiveWithin(time);
    char bytes[256];
    ssize_t received = 0;
    while ((received = recv(socket_, bytes, sizeof(bytes), 0)) > 0) {
    }
    return received == 0 || errno == ECONNRESET;
  }
  // Whether the server has not hung up so far, nor said anything.
  bool IsOpen() const {
    char byte;
    return recv(socket_, &byte, 1, MSG_DONTWAIT | MSG_PEEK) < 0 && errno == EAGAIN;
  }
  // Closes with a reset instead of an orderly end.
  void Abort() const {
    const linger at_once{1, 0};
    setsockopt(socket_, SOL_SOCKET, SO_LINGER, &at_once, sizeof(at_once));
  }

 private:
  void ReceiveWithin(absl::Duration time) const {
    const timeval wait = absl::ToTimeval(time);
    setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &wait, sizeof(wait));
  }

  const int socket_;
  bool connected_ = false;
};

// ---- HTTP/2 by hand (RFC 9113).

inline std::string BigEndian(uint64_t value, size_t bytes) {
  std::string text;
  while (bytes-- > 0) text += static_cast<char>(value >> (8 * bytes) & 0xff);
  return text;
}
// An HPACK literal that enters no table.
inline std::string HeaderField(const std::string& name, const std::string& value) {
  return absl::StrCat(std::string(1, '\0'), BigEndian(name.size(), 1), name,
                      BigEndian(value.size(), 1), value);
}
inline std::string Frame(int type, int flags, uint32_t stream, const std::string& payload) {
  return absl::StrCat(BigEndian(payload.size(), 3), BigEndian(static_cast<uint64_t>(type), 1),
                      BigEndian(static_cast<uint64_t>(flags), 1), BigEndian(stream, 4), payload);
}

// What a connection begins with.
inline std::string ConnectionBytes(const std::string& settings = "") {
  constexpr int kSettings = 4;
  return absl::StrCat("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", Frame(kSettings, 0, 0, settings));
}
// Says that the server's settings have come. Not before they have.
inline std::string SettingsTaken() {
  constexpr int kSettings = 4, kAck = 1;
  return Frame(kSettings, kAck, 0, "");
}
// Asks whether what came before has been read: the eight bytes come back when it has.
inline std::string PingBytes(const std::string& eight_bytes) {
  constexpr int kPing = 6;
  return Frame(kPing, 0, 0, eight_bytes);
}
// Opens a call of `path` on `stream`, an odd number; `fields` are more of the header's.
inline std::string OpenCall(uint32_t stream, const std::string& path,
                            const std::string& fields = "") {
  constexpr int kHeaders = 1, kEndHeaders = 4;
  return Frame(kHeaders, kEndHeaders, stream,
               absl::StrCat(HeaderField(":method", "POST"), HeaderField(":scheme", "http"),
                            HeaderField(":path", path), HeaderField(":authority", "localhost"),
                            HeaderField("te", "trailers"),
                            HeaderField("content-type", "application/grpc"), fields));
}

// A message of a call.
inline std::string CallData(uint32_t stream, const std::string& message, bool last) {
  constexpr int kData = 0, kEndStream = 1;
  return Frame(kData, last ? kEndStream : 0, stream,
               absl::StrCat(BigEndian(message.size(), 5), message));
}

struct CallBytesOptions {
  bool whole = false;                      // Half-closed behind the last message.
  std::optional<uint32_t> initial_window;  // What the server may send of a stream; 65,535 else.
  std::string timeout;                     // What the call may take, "50m": 50 ms; empty: any time.
};
// A new connection's first call, on stream 1: of `path` with `messages`, and no more. Keep them
// below the first window, 64 KiB.
inline std::string CallBytes(const std::string& path, const std::vector<std::string>& messages,
                             const CallBytesOptions& options = {}) {
  constexpr int kInitialWindowSize = 4;
  std::string settings;
  if (options.initial_window.has_value()) {
    settings =
        absl::StrCat(BigEndian(kInitialWindowSize, 2), BigEndian(*options.initial_window, 4));
  }
  const std::string timeout =
      options.timeout.empty() ? "" : HeaderField("grpc-timeout", options.timeout);
  std::string bytes = absl::StrCat(ConnectionBytes(settings), OpenCall(1, path, timeout));
  for (const std::string& message : messages) {
    bytes += CallData(1, message, options.whole && &message == &messages.back());
  }
  return bytes;
}
// Lets the server send so many bytes more of stream 1.
inline std::string WindowUpdate(uint32_t bytes) {
  constexpr int kWindowUpdate = 8;
  return Frame(kWindowUpdate, 0, 1, BigEndian(bytes, 4));
}

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_INTEGRATION_RAW_CONNECTION_H_
