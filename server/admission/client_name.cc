// SPDX-License-Identifier: Apache-2.0
#include "server/admission/client_name.h"

#include <memory>
#include <optional>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace sightline {
namespace {

// Of somebody whom the access file does not know, such as a caller that it knew when the call was
// checked and no longer does: next to nothing, since 0 would be no limit.
constexpr CallerLimits kUnknownCaller{
    .rays = 1, .streams = 1, .uploads = 1, .upload_bytes = 1, .scenes = 1};

}  // namespace

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
    // Apart from those that are known by the same address or socket: its limits are not theirs.
    return {absl::StrCat("unknown:", ClientOfPeer(context.peer())), kUnknownCaller};
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
