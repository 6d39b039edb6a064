// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/http_endpoint.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <thread>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "server/net/listen_socket.h"
#include "server/net/socket_address.h"

namespace sightline {
namespace {

using Clock = std::chrono::steady_clock;

// Between two tries while nothing can be taken.
constexpr std::chrono::milliseconds kPause{50};
// For the client to take the end of its answer before the connection goes: a close while bytes come
// in would make a reset of it, and the answer may be lost.
constexpr std::chrono::seconds kFarewellTime{1};

const char* Reason(int code) {
  switch (code) {
    case 200:
      return "OK";
    case 400:
      return "Bad Request";
    case 401:
      return "Unauthorized";
    case 403:
      return "Forbidden";
    case 404:
      return "Not Found";
    case 405:
      return "Method Not Allowed";
    case 503:
      return "Service Unavailable";
    default:
      return "Unknown";
  }
}

std::string ReplyText(const HttpReply& reply, bool with_body) {
  return absl::StrCat("HTTP/1.1 ", reply.code, " ", Reason(reply.code),
                      "\r\nContent-Type: ", reply.content_type,
                      "\r\nContent-Length: ", reply.body.size(), "\r\nCache-Control: no-store\r\n",
                      reply.code == 401 ? "WWW-Authenticate: Bearer\r\n" : "",
                      reply.code == 405 ? "Allow: GET, HEAD\r\n" : "", "Connection: close\r\n\r\n",
                      with_body ? reply.body : "");
}

}  // namespace

class HttpEndpoint::Impl {
 public:
  // `wake`: an eventfd, the object's from now on.
  Impl(ListenSocket socket, int wake, Handlers handlers, std::chrono::milliseconds patience)
      : patience_(patience), socket_(std::move(socket)), wake_(wake) {
    SIGHTLINE_CHECK_LT(handlers.size() * (HttpPath::kMostAtOnce + HttpPath::kThreads),
                       kMostConnections);
    for (auto& [name, handler] : handlers) {
      paths_.push_back(std::make_unique<HttpPath>(name, std::move(handler)));
    }
    thread_ = std::thread([this] { Run(); });
  }
  ~Impl() {
    {
      MutexLock lock(mutex_);
      stop_ = true;
    }
    Wake();
    thread_.join();
    paths_.clear();  // They may still wake the thread that was.
    for (const auto& [id, connection] : connections_) close(connection.fd);
    close(wake_);
  }

  int port() const { return socket_.address().port(); }

 private:
  enum class Stage { kReading, kAnswering, kWriting, kClosing };
  struct Connection {
    int fd = -1;
    Stage stage = Stage::kReading;
    Clock::time_point deadline;  // Not while it is being answered.
    std::string bytes;           // Read so far; then to be written.
    size_t written = 0;
  };
  using Connections = std::map<uint64_t, Connection>;  // By number: the oldest first.

  void Run() {
    while (!Stopped()) {
      Wait();
      TakeReplies();
      for (auto next = connections_.begin(); next != connections_.end();) {
        const auto connection = next++;
        if (!Serve(connection->first, &connection->second)) Close(connection);
      }
      TakeConnections();
    }
  }
  bool Stopped() {
    MutexLock lock(mutex_);
    return stop_;
  }
  void Wake() const {
    const uint64_t one = 1;
    (void)!write(wake_, &one, sizeof(one));
  }

  // Until something may be done.
  void Wait() {
    std::vector<pollfd> waiting = {{.fd = wake_, .events = POLLIN, .revents = 0}};
    std::optional<Clock::time_point> first = pause_end_;
    if (!pause_end_.has_value()) {
      waiting.push_back({.fd = socket_.fd(), .events = POLLIN, .revents = 0});
    }
    for (const auto& [id, connection] : connections_) {
      if (connection.stage == Stage::kAnswering) continue;
      const bool writing = connection.stage == Stage::kWriting;
      waiting.push_back({.fd = connection.fd,
                         .events = static_cast<short>(writing ? POLLOUT : POLLIN),
                         .revents = 0});
      first = std::min(first.value_or(connection.deadline), connection.deadline);
    }
    int milliseconds = -1;
    if (first.has_value()) {
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(*first - Clock::now());
      milliseconds = static_cast<int>(std::max<int64_t>(0, left.count()));
    }
    // What happened is found out by trying: no socket blocks.
    (void)poll(waiting.data(), waiting.size(), milliseconds);
    uint64_t wakes = 0;
    (void)!read(wake_, &wakes, sizeof(wakes));
    if (pause_end_.has_value() && Clock::now() >= *pause_end_) pause_end_.reset();
  }

  void TakeConnections() {
    while (!pause_end_.has_value()) {
      const int fd = accept4(socket_.fd(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
      if (fd < 0) {
        if (errno == EINTR || errno == ECONNABORTED) continue;
        if (errno == EAGAIN) return;
        // Of descriptors those go first that are ours and say nothing.
        const bool exhausted = errno == EMFILE || errno == ENFILE;
        if (!exhausted || !MakeRoom()) pause_end_ = Clock::now() + kPause;
        continue;
      }
      if (connections_.size() >= kMostConnections) MakeRoom();
      const uint64_t id = next_id_++;
      const auto connection =
          connections_
              .emplace(id, Connection{.fd = fd, .deadline = Clock::now() + patience_, .bytes = {}})
              .first;
      // Whoever has asked already is not to make room for the next.
      if (!Serve(id, &connection->second)) Close(connection);
    }
  }
  // Closes the oldest connection that is not being answered; false if all are.
  bool MakeRoom() {
    const auto oldest =
        std::find_if(connections_.begin(), connections_.end(),
                     [](const auto& entry) { return entry.second.stage != Stage::kAnswering; });
    if (oldest == connections_.end()) return false;
    Close(oldest);
    return true;
  }
  void Close(Connections::iterator connection) {
    close(connection->second.fd);
    connections_.erase(connection);
  }

  // Does what can be done at once; false if the connection is done with.
  bool Serve(uint64_t id, Connection* connection) {
    if (connection->stage == Stage::kReading && !Read(id, connection)) return false;
    if (connection->stage == Stage::kWriting && !Write(connection)) return false;
    if (connection->stage == Stage::kClosing && !ReadRest(connection)) return false;
    return connection->stage == Stage::kAnswering || Clock::now() < connection->deadline;
  }
  bool Read(uint64_t id, Connection* connection) {
    char buffer[4096];
    while (connection->stage == Stage::kReading) {
      const ssize_t got = recv(connection->fd, buffer, sizeof(buffer), 0);
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return errno == EAGAIN;
      if (got == 0) return false;
      const absl::string_view more(buffer, static_cast<size_t>(got));
      connection->bytes.append(more.data(), more.size());
      const bool may_be_whole = absl::StrContains(more, '\n');
      if (may_be_whole || connection->bytes.size() > kMostHeadBytes) Hear(id, connection);
    }
    return true;
  }
  void Hear(uint64_t id, Connection* connection) {
    HttpHead head = ReadHttpHead(connection->bytes);
    if (head.state == HttpHead::State::kPartial) return;
    if (head.state == HttpHead::State::kBad) {
      return Reply(connection, ReplyText({.code = 400, .body = "not a request\n"}, true));
    }
    const bool get = head.method == "GET";
    if (!get && head.method != "HEAD") {
      return Reply(connection, ReplyText({.code = 405, .body = "GET or HEAD\n"}, true));
    }
    const auto path = std::find_if(paths_.begin(), paths_.end(),
                                   [&](const auto& each) { return each->name() == head.path; });
    if (path == paths_.end()) {
      return Reply(connection, ReplyText({.code = 404, .body = "no such path\n"}, get));
    }
    const bool taken =
        (*path)->Take(std::move(head.request), [this, id, get](const HttpReply& reply) {
          MutexLock lock(mutex_);
          replies_.emplace_back(id, ReplyText(reply, get));
          Wake();
        });
    if (!taken) {
      return Reply(connection, ReplyText({.code = 503, .body = "too many at once\n"}, get));
    }
    connection->stage = Stage::kAnswering;
  }
  void TakeReplies() {
    std::vector<std::pair<uint64_t, std::string>> replies;
    {
      MutexLock lock(mutex_);
      replies.swap(replies_);
    }
    for (auto& [id, text] : replies) Reply(&connections_.at(id), std::move(text));
  }
  void Reply(Connection* connection, std::string text) const {
    connection->bytes = std::move(text);
    connection->stage = Stage::kWriting;
    connection->deadline = Clock::now() + patience_;
  }
  static bool Write(Connection* connection) {
    while (connection->written < connection->bytes.size()) {
      const ssize_t sent = send(connection->fd, connection->bytes.data() + connection->written,
                                connection->bytes.size() - connection->written, MSG_NOSIGNAL);
      if (sent < 0 && errno == EINTR) continue;
      if (sent < 0) return errno == EAGAIN;
      connection->written += static_cast<size_t>(sent);
    }
    shutdown(connection->fd, SHUT_WR);
    connection->bytes = {};
    connection->stage = Stage::kClosing;
    connection->deadline = Clock::now() + kFarewellTime;
    return true;
  }
  static bool ReadRest(Connection* connection) {
    char buffer[4096];
    const ssize_t got = recv(connection->fd, buffer, sizeof(buffer), 0);
    return got > 0 || (got < 0 && (errno == EAGAIN || errno == EINTR));
  }

  const std::chrono::milliseconds patience_;

  // Of the thread alone.
  const ListenSocket socket_;
  Connections connections_;
  uint64_t next_id_ = 0;
  std::optional<Clock::time_point> pause_end_;  // Until then no connection can be taken.

  const int wake_;
  Mutex mutex_;
  std::vector<std::pair<uint64_t, std::string>> replies_ ABSL_GUARDED_BY(mutex_);
  bool stop_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::unique_ptr<HttpPath>> paths_;  // Constant while the thread runs.
  std::thread thread_;
};

HttpEndpoint::HttpEndpoint(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
HttpEndpoint::~HttpEndpoint() = default;
int HttpEndpoint::port() const { return impl_->port(); }

absl::StatusOr<std::unique_ptr<HttpEndpoint>> HttpEndpoint::Start(
    const std::string& listen, Handlers handlers, std::chrono::milliseconds patience) {
  SL_ASSIGN_OR_RETURN(const ListenAddress address, ParseListenAddress(listen));
  if (!address.unix_path.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", listen, "\": probes and metrics want HOST:PORT"));
  }
  // Of a name with several addresses the first: with port 0 they would get ports of their own.
  absl::StatusOr<ListenSocket> socket = ListenSocket::Bind(address.addresses[0], /*mode=*/0);
  if (!socket.ok()) {
    return absl::UnavailableError(absl::StrCat("cannot serve probes and metrics on ", listen, ": ",
                                               socket.status().message()));
  }
  const int wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  if (wake < 0) {
    return absl::UnavailableError(absl::StrCat("cannot serve probes and metrics on ", listen, ": ",
                                               strerror(errno),
                                               ": may the process have more descriptors?"));
  }
  return std::unique_ptr<HttpEndpoint>(new HttpEndpoint(
      std::make_unique<Impl>(*std::move(socket), wake, std::move(handlers), patience)));
}

}  // namespace sightline
