// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/http_endpoint.h"

#include <microhttpd.h>
#include <strings.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "server/base/memory_guard.h"
#include "server/net/accept_loop.h"
#include "server/net/listen_socket.h"
#include "server/net/socket_address.h"

namespace sightline {
namespace {

// A bearer token fits many times over; the answer's head needs some, too.
constexpr size_t kConnectionMemory = 16 << 10;
// Of the library, so that a burst finds room while the oldest are being closed.
constexpr unsigned int kMostWithClosing = 1024;
// Malformed requests are refused.
constexpr int kStrict = 1;

}  // namespace

class HttpEndpoint::Impl {
 public:
  explicit Impl(const Handlers& handlers) {
    SIGHTLINE_CHECK_LT(handlers.size() * (HttpPath::kMostAtOnce + HttpPath::kThreads),
                       kMostConnections);
    for (const auto& [name, handler] : handlers) {
      paths_.push_back(std::make_unique<HttpPath>(name, handler));
    }
  }
  ~Impl() {
    accept_.reset();
    // The daemon's thread asks them until it has ended. It must not end while a connection sleeps,
    // and none does once all are answered.
    for (const auto& path : paths_) path->End();
    if (daemon_ != nullptr) MHD_stop_daemon(daemon_);
  }

  absl::Status Start(std::vector<ListenSocket> sockets, std::chrono::seconds patience) {
    daemon_ = MHD_start_daemon(
        MHD_USE_EPOLL_INTERNAL_THREAD | MHD_USE_NO_LISTEN_SOCKET | MHD_ALLOW_SUSPEND_RESUME, 0,
        nullptr, nullptr, &Impl::Hear, this, MHD_OPTION_NOTIFY_CONNECTION, &Impl::Count, this,
        MHD_OPTION_NOTIFY_COMPLETED, &Impl::Forget, this, MHD_OPTION_CONNECTION_LIMIT,
        kMostWithClosing, MHD_OPTION_CONNECTION_TIMEOUT,
        static_cast<unsigned int>(patience.count()), MHD_OPTION_CONNECTION_MEMORY_LIMIT,
        kConnectionMemory, MHD_OPTION_STRICT_FOR_CLIENT, kStrict, MHD_OPTION_END);
    if (daemon_ == nullptr) {
      return absl::UnavailableError(
          absl::StrCat(strerror(errno), ": may the process have more descriptors?"));
    }
    port_ = sockets.front().address().port();
    // The bound on connections is this object's: the newest come in, and not the oldest stay.
    accept_.emplace(std::move(sockets),
                    ConnectionLimits{.all = kMostWithClosing, .per_address = kMostWithClosing},
                    [this](const TakenConnection& taken) {
                      // Closes it where it fails.
                      MHD_add_connection(daemon_, taken.fd, nullptr, 0);
                    });
    accept_->Start();
    return absl::OkStatus();
  }

  int port() const { return port_; }

 private:
  struct Open {
    int fd = -1;
    bool answering = false, leaving = false;
  };
  using Connections = std::map<uint64_t, Open>;  // By number: the oldest first.

  struct Request {
    MHD_Connection* connection = nullptr;
    Open* open = nullptr;
    std::optional<HttpReply> reply;  // Under the endpoint's mutex.
  };

  // A connection opens or closes.
  static void Count(void* self, MHD_Connection* connection, void** number,
                    MHD_ConnectionNotificationCode what) {
    static_cast<Impl*>(self)->CountOne(connection, reinterpret_cast<uintptr_t*>(number), what);
  }
  void CountOne(MHD_Connection* connection, uintptr_t* number,
                MHD_ConnectionNotificationCode what) {
    if (what == MHD_CONNECTION_NOTIFY_CLOSED) {
      const auto it = connections_.find(*number);
      staying_ -= it->second.leaving ? 0 : 1;
      connections_.erase(it);
      return;
    }
    if (staying_ >= kMostConnections) MakeRoom();
    *number = next_number_++;
    const int fd =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
    connections_.emplace(*number, Open{.fd = fd});
    ++staying_;
  }
  // The oldest connection that is not being answered is to close: the library hears of its end.
  void MakeRoom() {
    const auto oldest = std::ranges::find_if(connections_, [](const auto& entry) {
      return !entry.second.answering && !entry.second.leaving;
    });
    if (oldest == connections_.end()) return;
    oldest->second.leaving = true;
    --staying_;
    shutdown(oldest->second.fd, SHUT_RDWR);
  }

  static MHD_Result Hear(void* self, MHD_Connection* connection, const char* path,
                         const char* method, const char*, const char*, size_t* upload,
                         void** request) {
    const absl::StatusOr<MHD_Result> result = GuardMemory([&]() -> absl::StatusOr<MHD_Result> {
      return static_cast<Impl*>(self)->HearOne(connection, path, method, upload,
                                               reinterpret_cast<Request**>(request));
    });
    return result.ok() ? *result : MHD_NO;
  }
  // Called when the head is there, for each piece of a body, when that has ended, and once more
  // when a path has answered.
  MHD_Result HearOne(MHD_Connection* connection, absl::string_view path, absl::string_view method,
                     size_t* upload, Request** request) {
    if (*request == nullptr) {
      void* const number =
          MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT)->socket_context;
      *request = new Request{.connection = connection,
                             .open = &connections_.at(reinterpret_cast<uintptr_t>(number))};
      return MHD_YES;
    }
    if (*upload > 0) {  // Read, so that the end is no reset, and of no interest.
      *upload = 0;
      return MHD_YES;
    }
    if ((*request)->open->answering) {
      (*request)->open->answering = false;
      MutexLock lock(mutex_);
      return Send(connection, *std::move((*request)->reply));
    }
    if (method != MHD_HTTP_METHOD_GET && method != MHD_HTTP_METHOD_HEAD) {
      return Send(connection, {.code = MHD_HTTP_METHOD_NOT_ALLOWED, .body = "GET or HEAD\n"});
    }
    const auto found =
        std::ranges::find_if(paths_, [&](const auto& entry) { return entry->name() == path; });
    if (found == paths_.end()) {
      return Send(connection, {.code = MHD_HTTP_NOT_FOUND, .body = "not found\n"});
    }
    std::vector<std::string> authorizations;
    MHD_get_connection_values(connection, MHD_HEADER_KIND, &Impl::Collect, &authorizations);
    if (authorizations.size() > 1) {
      return Send(connection, {.code = MHD_HTTP_BAD_REQUEST, .body = "two Authorizations\n"});
    }
    HttpRequest asked;
    if (!authorizations.empty()) asked.authorization = std::move(authorizations[0]);
    Ask(**found, std::move(asked), *request);
    return MHD_YES;
  }
  static MHD_Result Collect(void* authorizations, MHD_ValueKind, const char* name,
                            const char* value) {
    if (strcasecmp(name, MHD_HTTP_HEADER_AUTHORIZATION) == 0) {
      static_cast<std::vector<std::string>*>(authorizations)
          ->emplace_back(value == nullptr ? "" : value);
    }
    return MHD_YES;
  }
  // The connection sleeps until the path has answered.
  void Ask(HttpPath& path, HttpRequest asked, Request* request) {
    request->open->answering = true;
    MHD_suspend_connection(request->connection);
    const auto answer = [this, request](HttpReply reply) {
      MutexLock lock(mutex_);
      request->reply = std::move(reply);
      MHD_resume_connection(request->connection);
    };
    if (!path.Take(std::move(asked), answer)) {
      answer({.code = MHD_HTTP_SERVICE_UNAVAILABLE, .body = "too many at once\n"});
    }
  }
  static MHD_Result Send(MHD_Connection* connection, HttpReply reply) {
    auto* const body = new std::string(std::move(reply.body));
    MHD_Response* const response = MHD_create_response_from_buffer_with_free_callback_cls(
        body->size(), body->data(), [](void* text) { delete static_cast<std::string*>(text); },
        body);
    if (response == nullptr) {
      delete body;
      return MHD_NO;
    }
    const auto add = [response](const char* name, const char* value) {
      MHD_add_response_header(response, name, value);
    };
    add(MHD_HTTP_HEADER_CONTENT_TYPE, reply.content_type.c_str());
    add(MHD_HTTP_HEADER_CACHE_CONTROL, "no-store");
    add(MHD_HTTP_HEADER_CONNECTION, "close");
    if (reply.code == MHD_HTTP_UNAUTHORIZED) add(MHD_HTTP_HEADER_WWW_AUTHENTICATE, "Bearer");
    if (reply.code == MHD_HTTP_METHOD_NOT_ALLOWED) add(MHD_HTTP_HEADER_ALLOW, "GET, HEAD");
    const MHD_Result queued =
        MHD_queue_response(connection, static_cast<unsigned int>(reply.code), response);
    MHD_destroy_response(response);
    return queued;
  }
  static void Forget(void*, MHD_Connection*, void** request, MHD_RequestTerminationCode) {
    delete static_cast<Request*>(*request);
    *request = nullptr;
  }

  int port_ = 0;
  MHD_Daemon* daemon_ = nullptr;

  // Of the daemon's thread alone.
  Connections connections_;
  size_t staying_ = 0;
  uintptr_t next_number_ = 1;

  Mutex mutex_;  // Of the requests' replies: a path writes one, the daemon's thread reads it.
  std::vector<std::unique_ptr<HttpPath>> paths_;  // Constant while the daemon runs.
  std::optional<AcceptLoop> accept_;
};

HttpEndpoint::HttpEndpoint(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
HttpEndpoint::~HttpEndpoint() = default;
int HttpEndpoint::port() const { return impl_->port(); }

absl::StatusOr<std::unique_ptr<HttpEndpoint>> HttpEndpoint::Start(const std::string& listen,
                                                                  const Handlers& handlers,
                                                                  std::chrono::seconds patience) {
  SL_ASSIGN_OR_RETURN(const ListenAddress address, ParseListenAddress(listen));
  if (!address.unix_path.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", listen, "\": probes and metrics want HOST:PORT"));
  }
  absl::StatusOr<std::vector<ListenSocket>> sockets = BindHost(address.addresses);
  absl::Status started = sockets.status();
  auto impl = std::make_unique<Impl>(handlers);
  if (started.ok()) started = impl->Start(*std::move(sockets), patience);
  if (!started.ok()) {
    return absl::UnavailableError(
        absl::StrCat("cannot serve probes and metrics on ", listen, ": ", started.message()));
  }
  return std::unique_ptr<HttpEndpoint>(new HttpEndpoint(std::move(impl)));
}

}  // namespace sightline
