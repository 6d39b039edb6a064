// SPDX-License-Identifier: Apache-2.0
//
// What a path of the HTTP port hears of a request, and what it answers.
//
// Thread safety: plain values.
//
//   HttpReply Answer(const HttpRequest& request) { return {.body = "alive\n"}; }
#ifndef SIGHTLINE_SERVER_METRICS_HTTP_REQUEST_H_
#define SIGHTLINE_SERVER_METRICS_HTTP_REQUEST_H_

#include <string>

namespace sightline {

struct HttpRequest {
  std::string authorization;  // The header; empty without.
};

struct HttpReply {
  int code = 200;
  std::string body;
  std::string content_type = "text/plain; charset=utf-8";
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_METRICS_HTTP_REQUEST_H_
