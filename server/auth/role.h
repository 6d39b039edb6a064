// SPDX-License-Identifier: Apache-2.0
//
// What a caller may be allowed to do, and which of it each method wants.
//
//   query     trace, compute, test; look at scenes; keep point sets
//   admin     make, change and delete scenes; look at them
//   metrics   read /metrics
//
// Invariant: the table names each method of ours whole, and one that it does not name wants admin,
// so that a new one is closed until somebody says who may call it (a test holds the table against
// the services' descriptors). Of gRPC's own services, health is open and reflection is every
// role's.
//
// Thread safety: values and functions.
//
//   if (!MayCall(caller.roles, "/sightline.v1.SceneService/DeleteScene")) ...
#ifndef SIGHTLINE_SERVER_AUTH_ROLE_H_
#define SIGHTLINE_SERVER_AUTH_ROLE_H_

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace sightline {

// Sets of roles; bits.
using RoleSet = uint8_t;
inline constexpr RoleSet kNoRole = 0, kQueryRole = 1, kAdminRole = 2, kMetricsRole = 4;
inline constexpr RoleSet kAllRoles = kQueryRole | kAdminRole | kMetricsRole;

// "query,admin". InvalidArgument listing the roles.
absl::StatusOr<RoleSet> ParseRoles(absl::string_view text);
std::string RoleNames(RoleSet roles);

// Any of the returned lets a caller call `method` ("/package.Service/Method"); kNoRole: everybody
// may, known or not.
RoleSet RolesFor(absl::string_view method);
// Whether the table names it.
bool IsKnownMethod(absl::string_view method);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_AUTH_ROLE_H_
