// SPDX-License-Identifier: Apache-2.0
//
// The one place that says whether a call may be made: an access file's policy, read again when the
// file changes, over the roles that methods want. Without a file everybody may do everything.
//
// Invariant: a Reload that fails leaves the policy that there was.
//
// Thread safety: every method from any thread; Load and Reload read a file, so not on a gRPC
// thread.
//
//   AccessControl access;
//   SL_RETURN_IF_ERROR(access.Load("access.conf"));
//   const absl::Status allowed = access.Check("/sightline.v1.SceneService/DeleteScene", shown);
#ifndef SIGHTLINE_SERVER_AUTH_ACCESS_CONTROL_H_
#define SIGHTLINE_SERVER_AUTH_ACCESS_CONTROL_H_

#include <grpcpp/server_context.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/base/mutex.h"
#include "server/auth/access_policy.h"

namespace sightline {

class AccessControl {
 public:
  // From now on the file rules; what AccessPolicy::Read returns. REQUIRES: once, before any call.
  absl::Status Load(const std::string& path);
  // Reads the file again, if there is one.
  absl::Status Reload();
  bool active() const { return !path_.empty(); }

  // OK, Unauthenticated (the file knows no such caller) or PermissionDenied (it lacks the role).
  absl::Status Check(absl::string_view method, const Shown& shown) const;
  // For what is no gRPC method: any of `roles`.
  absl::Status CheckRoles(absl::string_view what, RoleSet roles, const Shown& shown) const;
  // Nothing where everybody may do everything, too.
  std::optional<Caller> Identify(const Shown& shown) const;
  // How often the checks said no.
  uint64_t refused() const { return refused_; }

 private:
  std::shared_ptr<const AccessPolicy> policy() const;

  std::string path_;  // Constant once loaded; empty: no file.
  mutable std::atomic<uint64_t> refused_ = 0;
  mutable Mutex mutex_;
  std::shared_ptr<const AccessPolicy> policy_ ABSL_GUARDED_BY(mutex_);
};

// The one place that says which of a call's metadata tells who its caller is; called with all of
// it, by ShownBy and by the check before the call.
void AddMetadata(absl::string_view key, absl::string_view value, Shown* shown);

// What the caller behind a call shows. REQUIRES: the call has begun.
Shown ShownBy(const grpc::ServerContextBase& context);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_AUTH_ACCESS_CONTROL_H_
