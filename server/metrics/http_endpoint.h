// SPDX-License-Identifier: Apache-2.0
//
// The HTTP port for probes and metrics: a few paths, GET alone, each answered by a function. It is
// apart from the gRPC port, so that it answers while that one is overloaded or dead.
//
// Bounds: four requests at once, each read within five seconds; anything but the paths is 404.
//
// Thread safety: handlers are called from the endpoint's own threads, several at once. Stop once.
//
//   auto http = HttpEndpoint::Start("127.0.0.1:9090", {{"/livez", [](auto&) { return ...; }}});
#ifndef SIGHTLINE_SERVER_METRICS_HTTP_ENDPOINT_H_
#define SIGHTLINE_SERVER_METRICS_HTTP_ENDPOINT_H_

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"

namespace sightline {

struct HttpRequest {
  std::string authorization;  // The header; empty without.
};

struct HttpReply {
  int code = 200;
  std::string body;
  std::string content_type = "text/plain; charset=utf-8";
};

class HttpEndpoint {
 public:
  using Handler = std::function<HttpReply(const HttpRequest&)>;
  using Handlers = std::vector<std::pair<std::string, Handler>>;

  // Binds `listen` (HOST:PORT; port 0 takes a free one) and serves. InvalidArgument, Unavailable.
  static absl::StatusOr<std::unique_ptr<HttpEndpoint>> Start(const std::string& listen,
                                                             Handlers handlers);
  // Waits for requests under way.
  ~HttpEndpoint();
  HttpEndpoint(const HttpEndpoint&) = delete;
  HttpEndpoint& operator=(const HttpEndpoint&) = delete;

  int port() const;

 private:
  class Impl;
  explicit HttpEndpoint(std::unique_ptr<Impl> impl);
  const std::unique_ptr<Impl> impl_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_METRICS_HTTP_ENDPOINT_H_
