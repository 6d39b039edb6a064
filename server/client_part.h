// SPDX-License-Identifier: Apache-2.0
//
// Which limits of one client are half of a limit of all clients together, as long as they are not
// set themselves: so that one client alone never takes everything, whatever everything is.
//
// Thread safety: pure functions.
//
//   limits.max_connections = 300;
//   HalveTotal(*TotalOf("max_connections_per_address"), &limits);  // 150 of one address
#ifndef SIGHTLINE_SERVER_CLIENT_PART_H_
#define SIGHTLINE_SERVER_CLIENT_PART_H_

#include <algorithm>
#include <cstdint>

#include "absl/strings/string_view.h"
#include "server/base/limits.h"

namespace sightline {

struct ClientPart {
  absl::string_view name, total_name;  // As in LimitTable.
  uint64_t Limits::*value;
  uint64_t Limits::*total;
};

// Null: the limit `name` is no part of another.
inline const ClientPart* TotalOf(absl::string_view name) {
  static constexpr ClientPart kParts[] = {
      {"max_queued_rays_per_client", "max_queued_rays", &Limits::max_queued_rays_per_client,
       &Limits::max_queued_rays},
      {"max_connections_per_address", "max_connections", &Limits::max_connections_per_address,
       &Limits::max_connections},
      {"max_concurrent_uploads_per_client", "max_concurrent_uploads",
       &Limits::max_concurrent_uploads_per_client, &Limits::max_concurrent_uploads},
  };
  for (const ClientPart& part : kParts) {
    if (part.name == name) return &part;
  }
  return nullptr;
}

// At least one.
inline void HalveTotal(const ClientPart& part, Limits* limits) {
  limits->*part.value = std::max<uint64_t>(1, limits->*part.total / 2);
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CLIENT_PART_H_
