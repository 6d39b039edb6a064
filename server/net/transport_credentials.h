// SPDX-License-Identifier: Apache-2.0
//
// What gRPC does with a connection that it is handed: nothing, or TLS with whatever certificate is
// good at that moment; and before each of its calls, whoever it is for, the access control is
// asked. gRPC's C++ classes offer neither a reload from memory nor a check on plain connections, so
// this one stands on the C functions below them.
//
// Thread safety: made and added to a server by one thread; gRPC then calls it from its own.
//
//   builder.experimental().AddExternalConnectionAcceptor(
//       ..., std::make_shared<TransportCredentials>(
//                TransportCredentials::Options{.certificates = &store, .access = &access}));
#ifndef SIGHTLINE_SERVER_NET_TRANSPORT_CREDENTIALS_H_
#define SIGHTLINE_SERVER_NET_TRANSPORT_CREDENTIALS_H_

#include <grpc/grpc_security.h>
#include <grpcpp/security/server_credentials.h>

#include <memory>
#include <string>

#include "core/base/mutex.h"
#include "server/auth/access_control.h"
#include "server/auth/certificate_store.h"

namespace sightline {

class TransportCredentials final : public grpc::ServerCredentials {
 public:
  // All that is pointed to outlives the grpc::Server.
  struct Options {
    const CertificateStore* certificates = nullptr;  // Null: plain.
    // With authorities in the store: whether a client may come without a certificate.
    bool client_certificate_optional = false;
    const AccessControl* access = nullptr;  // Null: nobody is asked who they are.
    bool through_unix_socket = false;
    bool health_alone = false;  // Only methods that everybody may call.
  };

  explicit TransportCredentials(const Options& options);
  ~TransportCredentials() override;

  // gRPC's own way of checks; not offered here.
  void SetAuthMetadataProcessor(
      const std::shared_ptr<grpc::AuthMetadataProcessor>& processor) override;

 private:
  int AddPortToServer(const std::string& address, grpc_server* server) override;

  grpc_server_credentials* MakeTls();
  void CheckCalls();
  // A connection is about to begin: is there a newer certificate than it had before?
  grpc_ssl_certificate_config_reload_status Fetch(grpc_ssl_server_certificate_config** config);

  const Options options_;
  grpc_server_credentials* credentials_ = nullptr;
  Mutex mutex_;
  std::shared_ptr<const TlsBundle> fetched_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_NET_TRANSPORT_CREDENTIALS_H_
