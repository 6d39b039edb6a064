// SPDX-License-Identifier: Apache-2.0
#include "server/admission/client_name.h"

#include <memory>
#include <optional>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace sightline {

std::string ClientOfPeer(absl::string_view peer) {
  if (absl::StartsWith(peer, "unix")) return "unix";
  // "ipv6:%5B::1%5D:443": the port is behind the last colon here, too.
  return std::string(peer.substr(0, peer.rfind(':')));
}

Client ClientOf(const grpc::ServerContextBase& context, const AccessControl* access) {
  if (access != nullptr && access->active()) {
    if (const std::optional<Caller> caller = access->Identify(ShownBy(context))) {
      return {caller->name, caller->limits};
    }
  }
  const std::shared_ptr<const grpc::AuthContext> auth = context.auth_context();
  if (auth != nullptr && auth->IsPeerAuthenticated()) {
    const std::vector<grpc::string_ref> identity = auth->GetPeerIdentity();
    if (!identity.empty()) {
      return {absl::StrCat("identity:",
                           absl::string_view(identity.front().data(), identity.front().size())),
              {}};
    }
  }
  return {ClientOfPeer(context.peer()), {}};
}

}  // namespace sightline
