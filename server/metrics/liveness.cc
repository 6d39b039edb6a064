// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/liveness.h"

#include <fcntl.h>
#include <grpcpp/create_channel_posix.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"

namespace sightline {
namespace {

// Connects within the time; the descriptor, or -1 with errno set.
int Connect(const SocketAddress& server, absl::Duration timeout) {
  const int fd = socket(server.family(), SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd < 0) return -1;
  if (connect(fd, server.get(), server.length) == 0) return fd;
  int error = errno;
  if (error == EINPROGRESS) {
    pollfd waiting{.fd = fd, .events = POLLOUT, .revents = 0};
    socklen_t length = sizeof(error);
    if (poll(&waiting, 1, static_cast<int>(absl::ToInt64Milliseconds(timeout))) != 1) {
      error = ETIMEDOUT;
    } else if (getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &length) == 0 && error == 0) {
      return fd;
    }
  }
  close(fd);
  errno = error;
  return -1;
}

}  // namespace

absl::Status CheckAlive(const SocketAddress& server, absl::Duration timeout) {
  const absl::Time deadline = absl::Now() + timeout;
  const SocketAddress target = server.Reachable();
  const int fd = Connect(target, timeout);
  if (fd < 0) return absl::ErrnoToStatus(errno, absl::StrCat("connecting to ", target.ToString()));
  // The channel owns the descriptor, and with it the one connection that it ever has.
  grpc::GenericStub stub(grpc::CreateInsecureChannelFromFd("liveness", fd));
  grpc::ClientContext context;
  context.set_deadline(absl::ToChronoTime(deadline));
  grpc::CompletionQueue queue;
  // An empty request asks for the server as a whole. Debian ships no generated class for it.
  const std::unique_ptr<grpc::GenericClientAsyncResponseReader> call = stub.PrepareUnaryCall(
      &context, "/grpc.health.v1.Health/Check", grpc::ByteBuffer(nullptr, 0), &queue);
  call->StartCall();
  grpc::ByteBuffer reply;
  grpc::Status status;
  call->Finish(&reply, &status, nullptr);
  void* tag = nullptr;
  bool ok = false;
  queue.Next(&tag, &ok);
  if (status.ok()) return absl::OkStatus();
  return absl::Status(static_cast<absl::StatusCode>(status.error_code()),
                      absl::StrCat("calling ", target.ToString(), ": ", status.error_message()));
}

}  // namespace sightline
