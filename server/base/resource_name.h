// SPDX-License-Identifier: Apache-2.0
//
// Resource names: `scenes/{scene}` and `scenes/{scene}/pointSets/{point_set}`, whose ids are 1 to
// 63 of a-z, 0-9, '-', '_' and '.', starting with a letter or digit. Nothing else reaches the
// stores, so no name can reach a path or a log line in disguise.
//
// Thread safety: functions only.
//
//   SL_ASSIGN_OR_RETURN(std::string id, ParseSceneName("name", request.name()));
#ifndef SIGHTLINE_SERVER_BASE_RESOURCE_NAME_H_
#define SIGHTLINE_SERVER_BASE_RESOURCE_NAME_H_

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "server/base/error.h"

namespace sightline {

struct PointSetName {
  std::string scene_id, point_set_id;
};

// `field` is what the error names. InvalidArgument with the value and the form expected.
absl::Status CheckId(absl::string_view field, absl::string_view id);
absl::StatusOr<std::string> ParseSceneName(absl::string_view field, absl::string_view name);
absl::StatusOr<PointSetName> ParsePointSetName(absl::string_view field, absl::string_view name);

std::string SceneName(absl::string_view scene_id);
std::string PointSetNameOf(absl::string_view scene_id, absl::string_view point_set_id);

// What an error about the scene carries: `resource`.
ErrorMetadata SceneResource(absl::string_view scene_id);

// A fresh id such as "scene-5f0c2a9be1d34c77"; unique for all practical purposes.
std::string MakeId(absl::string_view prefix);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_BASE_RESOURCE_NAME_H_
