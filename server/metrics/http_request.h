// SPDX-License-Identifier: Apache-2.0
//
// What a probe or a scraper says over HTTP/1, as far as this server listens: the first line, and
// who sends it.
//
// Invariant: a prefix of a head that is good so far is never bad, so that bytes may come one by
// one.
//
// Thread safety: functions and plain values.
//
//   const HttpHead head = ReadHttpHead("GET /livez HTTP/1.1\r\nHost: x\r\n\r\n");
//   if (head.state == HttpHead::State::kWhole) Answer(head.path, head.request);
#ifndef SIGHTLINE_SERVER_METRICS_HTTP_REQUEST_H_
#define SIGHTLINE_SERVER_METRICS_HTTP_REQUEST_H_

#include <cstddef>
#include <string>

#include "absl/strings/string_view.h"

namespace sightline {

struct HttpRequest {
  std::string authorization;  // The header; empty without.
};

struct HttpHead {
  enum class State {
    kPartial,  // More is to come.
    kWhole,
    kBad,  // No HTTP/1, longer than kMostHeadBytes, or with two Authorizations.
  };
  State state = State::kPartial;
  // Of a whole one.
  std::string method;
  std::string path;  // Without a query, or whatever stands before the path in an absolute URL.
  HttpRequest request;
};

// A bearer token fits many times over.
inline constexpr size_t kMostHeadBytes = 8 << 10;

// Of a connection's bytes so far; what follows the head is not looked at.
HttpHead ReadHttpHead(absl::string_view bytes);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_METRICS_HTTP_REQUEST_H_
