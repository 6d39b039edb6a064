// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/http_endpoint.h"

#include <CivetServer.h>

#include <exception>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/base/hand_over.h"
#include "core/base/status_macros.h"
#include "server/net/socket_address.h"

namespace sightline {
namespace {

class PathHandler final : public CivetHandler {
 public:
  explicit PathHandler(HttpEndpoint::Handler handler) : handler_(std::move(handler)) {
    made_.Release();
  }

  // CivetWeb finds the handler under the lock under which it was added.
  bool handleGet(CivetServer*, mg_connection* connection) override {
    made_.Acquire();
    const char* const authorization = mg_get_header(connection, "Authorization");
    const HttpReply reply =
        handler_(HttpRequest{.authorization = authorization == nullptr ? "" : authorization});
    const char* const reason = mg_get_response_code_text(connection, reply.code);
    mg_printf(connection,
              "HTTP/1.1 %d %s\r\nContent-Type: %s\r\nContent-Length: %zu\r\n"
              "Cache-Control: no-store\r\n%sConnection: close\r\n\r\n",
              reply.code, reason, reply.content_type.c_str(), reply.body.size(),
              reply.code == 401 ? "WWW-Authenticate: Bearer\r\n" : "");
    mg_write(connection, reply.body.data(), reply.body.size());
    return true;
  }

 private:
  const HttpEndpoint::Handler handler_;
  HandOver made_;
};

}  // namespace

class HttpEndpoint::Impl {
 public:
  Impl(const std::vector<std::string>& options, Handlers handlers) : server_(options) {
    for (auto& entry : handlers) {
      paths_.push_back(std::make_unique<PathHandler>(std::move(entry.second)));
      server_.addHandler(entry.first, paths_.back().get());
    }
  }

  int port() { return server_.getListeningPorts().at(0); }

 private:
  std::vector<std::unique_ptr<PathHandler>> paths_;  // Outlive the server.
  CivetServer server_;
};

HttpEndpoint::HttpEndpoint(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
HttpEndpoint::~HttpEndpoint() = default;
int HttpEndpoint::port() const { return impl_->port(); }

absl::StatusOr<std::unique_ptr<HttpEndpoint>> HttpEndpoint::Start(const std::string& listen,
                                                                  Handlers handlers) {
  SL_ASSIGN_OR_RETURN(const ListenAddress address, ParseListenAddress(listen));
  if (!address.unix_path.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("\"", listen, "\": probes and metrics want HOST:PORT"));
  }
  // Of a name with several addresses the first: with port 0 they would get ports of their own.
  const std::vector<std::string> options = {
      "listening_ports",    address.addresses[0].ToString(),
      "num_threads",        "4",
      "request_timeout_ms", "5000",
      "enable_keep_alive",  "no",
  };
  // Civetweb says by an exception that it cannot listen.
  try {
    return std::unique_ptr<HttpEndpoint>(
        new HttpEndpoint(std::make_unique<Impl>(options, std::move(handlers))));
  } catch (const std::exception& error) {
    return absl::UnavailableError(absl::StrCat("cannot serve probes and metrics on ", listen,
                                               ": is the address in use, or not ours? (",
                                               error.what(), ")"));
  }
}

}  // namespace sightline
