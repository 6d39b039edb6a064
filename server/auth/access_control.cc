// SPDX-License-Identifier: Apache-2.0
#include "server/auth/access_control.h"

#include <grpc/grpc_security_constants.h>

#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace sightline {

absl::Status AccessControl::Load(const std::string& path) {
  path_ = path;
  return Reload();
}

absl::Status AccessControl::Reload() {
  if (path_.empty()) return absl::OkStatus();
  SL_ASSIGN_OR_RETURN(AccessPolicy read, AccessPolicy::Read(path_));
  auto policy = std::make_shared<const AccessPolicy>(std::move(read));
  MutexLock lock(mutex_);
  policy_.swap(policy);
  return absl::OkStatus();
}

std::shared_ptr<const AccessPolicy> AccessControl::policy() const {
  MutexLock lock(mutex_);
  return policy_;
}

std::optional<Caller> AccessControl::Identify(const Shown& shown) const {
  if (!active()) return std::nullopt;
  return policy()->Identify(shown);
}

absl::Status AccessControl::Check(absl::string_view method, const Shown& shown) const {
  return CheckRoles(method, RolesFor(method), shown);
}

absl::Status AccessControl::CheckRoles(absl::string_view what, RoleSet roles,
                                       const Shown& shown) const {
  if (!active() || roles == kNoRole) return absl::OkStatus();
  const std::optional<Caller> caller = Identify(shown);
  if (caller.has_value() && (caller->roles & roles) != 0) return absl::OkStatus();
  ++refused_;
  if (!caller.has_value() && shown.authorizations.size() > 1) {
    return absl::UnauthenticatedError(absl::StrCat(what, " wants the role ", RoleNames(roles), ": ",
                                                   shown.authorizations.size(),
                                                   " authorizations were sent; send one"));
  }
  if (!caller.has_value()) {
    return absl::UnauthenticatedError(
        absl::StrCat(what, " wants the role ", RoleNames(roles),
                     ": show a certificate or a token that this server knows"));
  }
  return absl::PermissionDeniedError(absl::StrCat(what, " wants the role ", RoleNames(roles), "; ",
                                                  caller->name, " has ", RoleNames(caller->roles)));
}

void AddMetadata(absl::string_view key, absl::string_view value, Shown* shown) {
  if (key == "authorization") shown->authorizations.emplace_back(value);
}

Shown ShownBy(const grpc::ServerContextBase& context) {
  Shown shown;
  for (const auto& [key, value] : context.client_metadata()) {
    AddMetadata({key.data(), key.size()}, {value.data(), value.size()}, &shown);
  }
  const std::shared_ptr<const grpc::AuthContext> auth = context.auth_context();
  if (auth != nullptr && auth->IsPeerAuthenticated()) {
    for (const char* property : {GRPC_X509_SAN_PROPERTY_NAME, GRPC_X509_CN_PROPERTY_NAME}) {
      for (const grpc::string_ref& name : auth->FindPropertyValues(property)) {
        shown.certificate_names.emplace_back(name.data(), name.size());
      }
    }
  }
  shown.through_unix_socket = absl::StartsWith(context.peer(), "unix:");
  return shown;
}

}  // namespace sightline
