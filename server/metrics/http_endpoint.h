// SPDX-License-Identifier: Apache-2.0
//
// The HTTP port for probes and metrics: a few paths, GET and HEAD alone, each answered by a
// function. It is apart from the gRPC port, so that it answers while that one is overloaded or
// dead. HTTP itself is libmicrohttpd's; connections are taken by the gRPC port's AcceptLoop.
//
// Invariants
//  1. One thread reads and writes all connections and waits for none of them; a connection takes a
//     thread of its path's once its request is there, whole. So silent and slow clients take none.
//  2. At most kMostConnections are open, beside those that are being closed. When another comes,
//     the oldest one that is not being answered makes room: whoever asks at once is answered,
//     however many others say nothing, or however slowly.
//  3. A connection on which nothing moves for the endpoint's patience is closed. One request each.
//  4. Anything but the paths is 404. More at once than a path takes (http_path.h) is 503, as is
//     what still waits, or comes by a connection that is open, while the endpoint ends.
//
// Thread safety: handlers are called from the paths' threads, several at once. Stop once.
//
//   auto http = HttpEndpoint::Start("127.0.0.1:9090", {{"/livez", [](auto&) { return ...; }}});
#ifndef SIGHTLINE_SERVER_METRICS_HTTP_ENDPOINT_H_
#define SIGHTLINE_SERVER_METRICS_HTTP_ENDPOINT_H_

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "server/metrics/http_path.h"
#include "server/metrics/http_request.h"

namespace sightline {

class HttpEndpoint {
 public:
  // More than all paths answer at once: some are always left that can make room.
  static constexpr size_t kMostConnections = 64;
  // How long a client may say nothing, or take nothing of its answer.
  static constexpr std::chrono::seconds kPatience{5};

  using Handlers = std::vector<std::pair<std::string, HttpPath::Handler>>;

  // Binds `listen` (HOST:PORT, every address of a name; port 0 takes a free one) and serves.
  // InvalidArgument, Unavailable.
  static absl::StatusOr<std::unique_ptr<HttpEndpoint>> Start(
      const std::string& listen, const Handlers& handlers,
      std::chrono::seconds patience = kPatience);
  // Waits for handlers that run; connections are closed.
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
