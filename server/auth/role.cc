// SPDX-License-Identifier: Apache-2.0
#include "server/auth/role.h"

#include <algorithm>
#include <iterator>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace sightline {
namespace {

constexpr std::pair<absl::string_view, RoleSet> kRoles[] = {
    {"query", kQueryRole}, {"admin", kAdminRole}, {"metrics", kMetricsRole}};

struct Entry {
  absl::string_view method;  // Its full name; gRPC's own services by what they begin with.
  RoleSet roles;
};
constexpr Entry kGrpcServices[] = {
    // Load balancers and probes ask without a name of their own.
    {"/grpc.health.v1.Health/", kNoRole},
    {"/grpc.reflection.", kAllRoles},
};
// Each by its whole name: a method that is new is nobody's but the admins'.
constexpr Entry kMethods[] = {
    {"/sightline.v1.CapabilityService/GetCapabilities", kAllRoles},
    {"/sightline.v1.VisibilityService/TraceTiles", kQueryRole},
    {"/sightline.v1.VisibilityService/ComputeShadows", kQueryRole},
    {"/sightline.v1.VisibilityService/TestSegments", kQueryRole},
    {"/sightline.v1.PointSetService/CreatePointSet", kQueryRole},
    {"/sightline.v1.PointSetService/GetPointSet", kQueryRole},
    {"/sightline.v1.PointSetService/ListPointSets", kQueryRole},
    {"/sightline.v1.PointSetService/DeletePointSet", kQueryRole},
    {"/sightline.v1.PointSetService/RenewLease", kQueryRole},
    {"/sightline.v1.SceneService/GetScene", kQueryRole | kAdminRole},
    {"/sightline.v1.SceneService/ListScenes", kQueryRole | kAdminRole},
    {"/sightline.v1.SceneService/ListSceneObjects", kQueryRole | kAdminRole},
    {"/sightline.v1.SceneService/WatchScene", kQueryRole | kAdminRole},
    {"/sightline.v1.SceneService/CreateScene", kAdminRole},
    {"/sightline.v1.SceneService/UpdateScene", kAdminRole},
    {"/sightline.v1.SceneService/DeleteScene", kAdminRole},
    {"/sightline.v1.SceneService/LoadScene", kAdminRole},
    {"/sightline.v1.SceneService/UnloadScene", kAdminRole},
    {"/sightline.v1.SceneService/ReloadScene", kAdminRole},
    {"/sightline.v1.SceneService/ListStoredScenes", kAdminRole},
};

const Entry* Find(absl::string_view method) {
  for (const Entry& entry : kGrpcServices) {
    if (absl::StartsWith(method, entry.method)) return &entry;
  }
  const auto* const found =
      std::find_if(std::begin(kMethods), std::end(kMethods),
                   [&](const Entry& entry) { return method == entry.method; });
  return found == std::end(kMethods) ? nullptr : found;
}

}  // namespace

absl::StatusOr<RoleSet> ParseRoles(absl::string_view text) {
  RoleSet roles = kNoRole;
  for (const absl::string_view name : absl::StrSplit(text, ',')) {
    const auto* const found = std::find_if(std::begin(kRoles), std::end(kRoles),
                                           [&](const auto& role) { return role.first == name; });
    if (found == std::end(kRoles)) {
      return absl::InvalidArgumentError(
          absl::StrCat("\"", name, "\" is no role; there are query, admin, metrics"));
    }
    roles |= found->second;
  }
  return roles;
}

std::string RoleNames(RoleSet roles) {
  std::string names;
  for (const auto& [name, role] : kRoles) {
    if ((roles & role) != 0) absl::StrAppend(&names, names.empty() ? "" : ",", name);
  }
  return names;
}

RoleSet RolesFor(absl::string_view method) {
  const Entry* const entry = Find(method);
  return entry == nullptr ? kAdminRole : entry->roles;
}

bool IsKnownMethod(absl::string_view method) { return Find(method) != nullptr; }

}  // namespace sightline
