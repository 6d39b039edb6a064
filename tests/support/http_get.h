// SPDX-License-Identifier: Apache-2.0
//
// One HTTP GET to a port of this machine, as a probe or a scraper makes it.
//
// Thread safety: functions only.
//
//   const HttpAnswer answer = HttpGet(server.metrics_port(), "/livez");
#ifndef SIGHTLINE_TESTS_SUPPORT_HTTP_GET_H_
#define SIGHTLINE_TESTS_SUPPORT_HTTP_GET_H_

#include <string>

namespace sightline::testing_support {

struct HttpAnswer {
  int code = 0;  // 0: no answer.
  std::string body;
};

// `headers`: whole lines, each with its "\r\n".
HttpAnswer HttpGet(int port, const std::string& path, const std::string& headers = "");

// The value of the sample `name`, with its labels as they are written, of the page /metrics; -1
// where there is none.
double MetricOf(int port, const std::string& name, const std::string& headers = "");

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_SUPPORT_HTTP_GET_H_
