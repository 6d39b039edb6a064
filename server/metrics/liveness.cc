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

// A socket with an address of its own, which is written to *local; -1 with errno set.
int OpenProbe(const SocketAddress& server, std::string* local) {
  const int fd = socket(server.family(), SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd < 0) return fd;
  SocketAddress own;
  if (server.family() == AF_UNIX) {
    // A family alone: the kernel makes up a name that no other socket has.
    own.storage.ss_family = AF_UNIX;
    own.length = sizeof(sa_family_t);
  } else {
    // This machine's own address reaches it from that same address.
    own = server;
    own.set_port(0);
  }
  if (bind(fd, own.get(), own.length) == 0) {
    own.length = sizeof(own.storage);
    if (getsockname(fd, own.get(), &own.length) == 0) {
      *local = own.ToString();
      return fd;
    }
  }
  const int error = errno;
  close(fd);
  errno = error;
  return -1;
}

// 0, or errno.
int Connect(int fd, const SocketAddress& server, absl::Duration timeout) {
  if (connect(fd, server.get(), server.length) == 0) return 0;
  if (errno != EINPROGRESS) return errno;
  pollfd waiting{.fd = fd, .events = POLLOUT, .revents = 0};
  if (poll(&waiting, 1, static_cast<int>(absl::ToInt64Milliseconds(timeout))) != 1) {
    return ETIMEDOUT;
  }
  int error = 0;
  socklen_t length = sizeof(error);
  return getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &length) == 0 ? error : errno;
}

absl::Status CallHealth(int fd, absl::Time deadline) {
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
  return absl::Status(static_cast<absl::StatusCode>(status.error_code()), status.error_message());
}

}  // namespace

absl::Status CheckAlive(const SocketAddress& server, absl::Duration timeout,
                        const ProbeAnnouncement& announcement) {
  const absl::Time deadline = absl::Now() + timeout;
  const SocketAddress target = server.Reachable();
  std::string local;
  const int fd = OpenProbe(target, &local);
  if (fd < 0) return absl::ErrnoToStatus(errno, "no socket for the probe");
  announcement.begin(local);
  absl::Status status;
  if (const int error = Connect(fd, target, timeout); error != 0) {
    close(fd);
    status = absl::ErrnoToStatus(error, "connecting");
  } else {
    status = CallHealth(fd, deadline);
  }
  announcement.end(local);
  if (status.ok()) return status;
  return absl::Status(status.code(), absl::StrCat(target.ToString(), ": ", status.message()));
}

}  // namespace sightline
