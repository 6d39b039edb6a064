// SPDX-License-Identifier: Apache-2.0
//
// How clients get in: the sockets, the loop that takes connections, certificates, and the way in
// that each kind of connection has into gRPC.
//
//   TCP               TLS if there is a certificate, else plain; the access control is asked
//   Unix sockets      plain: the file's permissions guard them; the access control is asked
//   our own probe     plain, by the same sockets and loop; health checks alone
//
// Life: Open (binds), AddTo (before the gRPC server starts), Start (after it has), Stop (before it
// shuts down), destruction (after it).
//
// Thread safety: every method from any thread in the order above; Reload and CheckAlive block.
//
//   SL_ASSIGN_OR_RETURN(auto door, FrontDoor::Open(options, access));
//   door->AddTo(&builder);
//   server = builder.BuildAndStart();
//   door->Start();
#ifndef SIGHTLINE_SERVER_NET_FRONT_DOOR_H_
#define SIGHTLINE_SERVER_NET_FRONT_DOOR_H_

#include <grpcpp/server_builder.h>
#include <sys/types.h>

#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/auth/access_control.h"
#include "server/auth/certificate_store.h"
#include "server/net/accept_loop.h"

namespace sightline {

struct FrontDoorOptions {
  std::vector<std::string> listen;  // HOST:PORT or unix:PATH; empty: in-process channels alone.
  mode_t unix_socket_mode = 0600;
  ConnectionLimits connections;
  TlsFiles tls;
  bool client_certificate_optional = false;
};

class FrontDoor {
 public:
  // `access` outlives the door. InvalidArgument, Unavailable; what the certificates are found to
  // be.
  static absl::StatusOr<std::unique_ptr<FrontDoor>> Open(const FrontDoorOptions& options,
                                                         const AccessControl& access);
  FrontDoor(const FrontDoor&) = delete;
  FrontDoor& operator=(const FrontDoor&) = delete;

  void AddTo(grpc::ServerBuilder* builder);
  void Start();
  void Stop();

  // Of the first TCP socket; 0 without.
  int port() const;
  bool open() const { return !loop_.sockets().empty(); }
  AcceptLoop::Counts counts() { return loop_.counts(); }

  // Reads the certificates again. Whether they are new; what was wrong with them, in which case the
  // last good ones stay.
  absl::StatusOr<bool> ReloadCertificates();
  // When the server's certificate ends; infinite without.
  absl::Time CertificateEnd() const;

  // Connects and calls as a client would, within `timeout` for all sockets; see liveness.h.
  absl::Status CheckAlive(absl::Duration timeout);

 private:
  using Acceptor = std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor>;

  FrontDoor(const FrontDoorOptions& options, const AccessControl& access,
            std::vector<ListenSocket> sockets, const ConnectionLimits& connections,
            std::unique_ptr<CertificateStore> certificates);

  void HandOver(const TakenConnection& taken);

  const FrontDoorOptions options_;
  const AccessControl& access_;
  const std::unique_ptr<CertificateStore> certificates_;  // Null without TLS.
  // Set by AddTo.
  Acceptor tcp_, unix_, probe_;
  AcceptLoop loop_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_NET_FRONT_DOOR_H_
