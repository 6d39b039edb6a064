// SPDX-License-Identifier: Apache-2.0
//
// The order of the rooms: a room uses only what stands above it, in #include lines and in the
// targets that its CMakeLists.txt names.
//
// Thread safety: pure functions.
#ifndef SIGHTLINE_TESTS_POLICY_ROOM_RULES_H_
#define SIGHTLINE_TESTS_POLICY_ROOM_RULES_H_

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "tests/policy/source_tree.h"

namespace sightline::policy {

// The room that a path of the tree lies in ("core/mesh/object.h" → "core/mesh"), if any.
std::optional<std::string_view> RoomOfPath(std::string_view path);
// The room that a target belongs to ("sightline_core_mesh" → "core/mesh"), if any.
std::optional<std::string_view> RoomOfTarget(std::string_view target);

// Whether code of `user` may use what is in `used`. REQUIRES: both are rooms.
bool MayUse(std::string_view user, std::string_view used);

// #include lines that break the order, or bring in a library that the room must not know.
std::vector<std::string> FindIncludeViolations(const SourceFile& file);
// Targets that a room's CMakeLists.txt names although they stand below it.
std::vector<std::string> FindTargetViolations(const SourceFile& file);

}  // namespace sightline::policy

#endif  // SIGHTLINE_TESTS_POLICY_ROOM_RULES_H_
