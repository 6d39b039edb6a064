// SPDX-License-Identifier: Apache-2.0
#include "tests/support/listening_socket.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <string>

namespace sightline::testing_support {
namespace {

void Must(bool good) {
  if (!good) std::abort();
}

sockaddr_in AddressOf(int fd) {
  sockaddr_in address{};
  socklen_t length = sizeof(address);
  if (getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length) != 0) return {};
  return address;
}

// Of a free port, with room for a connection that nobody takes.
int ListenOnLoopback() {
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  Must(bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0);
  Must(listen(fd, 1) == 0);
  return fd;
}

}  // namespace

std::map<int, int> ListeningSockets() {
  std::map<int, int> found;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    const int fd = std::atoi(entry.path().filename().c_str());
    int listens = 0;
    socklen_t length = sizeof(listens);
    if (getsockopt(fd, SOL_SOCKET, SO_ACCEPTCONN, &listens, &length) != 0 || listens == 0) continue;
    const sockaddr_in address = AddressOf(fd);
    if (address.sin_family == AF_INET) found.emplace(ntohs(address.sin_port), fd);
  }
  return found;
}

DeadListener::DeadListener(int port)
    : descriptor_(ListeningSockets().at(port)),
      kept_(fcntl(descriptor_, F_DUPFD_CLOEXEC, 0)),
      idle_(ListenOnLoopback()) {
  Must(kept_ >= 0);
  // Whoever waits for a connection goes on waiting for the listener, finds with the next one that
  // there is nothing to take, and waits for the idle socket from then on.
  Must(dup3(idle_, descriptor_, O_CLOEXEC) == descriptor_);
}

DeadListener::~DeadListener() {
  Must(dup3(kept_, descriptor_, O_CLOEXEC) == descriptor_);
  // Ends the wait for the idle socket.
  const sockaddr_in idle = AddressOf(idle_);
  const int wake = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  Must(connect(wake, reinterpret_cast<const sockaddr*>(&idle), sizeof(idle)) == 0);
  close(wake);
  close(idle_);
  close(kept_);
}

}  // namespace sightline::testing_support
