// SPDX-License-Identifier: Apache-2.0
#include "server/net/front_door.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "core/base/status_macros.h"
#include "server/base/log.h"
#include "server/metrics/liveness.h"
#include "server/net/transport_credentials.h"

namespace sightline {
namespace {

// What an operator may not have meant.
void Warn(const std::vector<ListenSocket>& sockets, bool tls, bool access) {
  for (const ListenSocket& socket : sockets) {
    if (socket.address().IsLoopback() || (tls && access)) continue;
    const std::string address = socket.address().ToString();
    if (!tls) Log(LogLevel::kWarning, "listening_without_tls", {{"address", address}});
    if (!access) Log(LogLevel::kWarning, "listening_without_roles", {{"address", address}});
  }
}

}  // namespace

absl::StatusOr<std::unique_ptr<FrontDoor>> FrontDoor::Open(const FrontDoorOptions& options,
                                                           const AccessControl& access) {
  std::unique_ptr<CertificateStore> certificates;
  if (!options.tls.certificate.empty()) {
    SL_ASSIGN_OR_RETURN(certificates, CertificateStore::Open(options.tls));
  }
  SL_ASSIGN_OR_RETURN(std::vector<ListenSocket> sockets,
                      BindAll(options.listen, options.unix_socket_mode));
  const bool known_callers =
      access.active() || (!options.tls.client_ca.empty() && !options.client_certificate_optional);
  Warn(sockets, certificates != nullptr, known_callers);
  const size_t possible = ConnectionsWithinDescriptors();
  ConnectionLimits connections = options.connections;
  if (possible < connections.all) {
    Log(LogLevel::kWarning, "fewer_connections_than_asked_for",
        {{"max_connections", absl::StrCat(connections.all)},
         {"within_descriptors", absl::StrCat(possible)},
         {"remedy", "raise the limit on open files (ulimit -n)"}});
    // One address keeps its part of what there is.
    const double part = static_cast<double>(possible) / static_cast<double>(connections.all);
    connections.per_address = std::max<size_t>(
        1, static_cast<size_t>(part * static_cast<double>(connections.per_address)));
    connections.all = possible;
  }
  return std::unique_ptr<FrontDoor>(
      new FrontDoor(options, access, std::move(sockets), connections, std::move(certificates)));
}

FrontDoor::FrontDoor(const FrontDoorOptions& options, const AccessControl& access,
                     std::vector<ListenSocket> sockets, const ConnectionLimits& connections,
                     std::unique_ptr<CertificateStore> certificates)
    : options_(options),
      access_(access),
      certificates_(std::move(certificates)),
      loop_(std::move(sockets), connections,
            [this](const TakenConnection& taken) { HandOver(taken); }) {}

void FrontDoor::AddTo(grpc::ServerBuilder* builder) {
  if (!open()) return;
  const auto add = [&](const TransportCredentials::Options& options) {
    return builder->experimental().AddExternalConnectionAcceptor(
        grpc::ServerBuilder::experimental_type::ExternalConnectionType::FROM_FD,
        std::make_shared<TransportCredentials>(options));
  };
  tcp_ = add({.certificates = certificates_.get(),
              .client_certificate_optional = options_.client_certificate_optional,
              .access = &access_});
  unix_ = add({.access = &access_, .through_unix_socket = true});
  probe_ = add({.health_alone = true});
}

void FrontDoor::HandOver(const TakenConnection& taken) {
  grpc::experimental::ExternalConnectionAcceptor::NewConnectionParameters parameters;
  parameters.listener_fd = taken.listener_fd;
  parameters.fd = taken.fd;
  (taken.is_ours ? probe_ : taken.is_unix ? unix_ : tcp_)->HandleNewConnection(&parameters);
}

void FrontDoor::Start() {
  if (open()) loop_.Start();
}

void FrontDoor::Stop() { loop_.Stop(); }

int FrontDoor::port() const {
  for (const ListenSocket& socket : loop_.sockets()) {
    if (!socket.is_unix()) return socket.address().port();
  }
  return 0;
}

absl::StatusOr<bool> FrontDoor::ReloadCertificates() {
  if (certificates_ == nullptr) return false;
  return certificates_->Reload();
}

absl::Time FrontDoor::CertificateEnd() const {
  return certificates_ == nullptr ? absl::InfiniteFuture() : certificates_->current()->not_after;
}

absl::Status FrontDoor::CheckAlive(absl::Duration timeout) {
  const absl::Time deadline = absl::Now() + timeout;
  for (const ListenSocket& socket : loop_.sockets()) {
    SL_RETURN_IF_ERROR(sightline::CheckAlive(
        socket.address(), std::max(absl::ZeroDuration(), deadline - absl::Now()),
        {.begin = [this](const std::string& p) { loop_.Expect(p); },
         .end = [this](const std::string& p) { loop_.Forget(p); }}));
  }
  return absl::OkStatus();
}

}  // namespace sightline
