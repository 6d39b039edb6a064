// SPDX-License-Identifier: Apache-2.0
#include "tests/support/http_get.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>

namespace sightline::testing_support {

HttpAnswer HttpGet(int port, const std::string& path, const std::string& headers) {
  HttpAnswer answer;
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return answer;
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string text;
  if (connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0) {
    const std::string request =
        "GET " + path + " HTTP/1.1\r\nHost: localhost\r\n" + headers + "\r\n";
    char buffer[4096];
    if (send(fd, request.data(), request.size(), MSG_NOSIGNAL) ==
        static_cast<ssize_t>(request.size())) {
      for (ssize_t got; (got = recv(fd, buffer, sizeof(buffer), 0)) > 0;) {
        text.append(buffer, static_cast<size_t>(got));
      }
    }
  }
  close(fd);
  const size_t space = text.find(' ');
  const size_t end = text.find("\r\n\r\n");
  if (space == std::string::npos || end == std::string::npos) return answer;
  answer.code = std::atoi(text.c_str() + space + 1);
  answer.body = text.substr(end + 4);
  return answer;
}

double MetricOf(int port, const std::string& name, const std::string& headers) {
  const std::string page = "\n" + HttpGet(port, "/metrics", headers).body;
  const size_t at = page.find("\n" + name + " ");
  return at == std::string::npos ? -1 : std::atof(page.c_str() + at + name.size() + 2);
}

}  // namespace sightline::testing_support
