// SPDX-License-Identifier: Apache-2.0
#include "server/base/resource_name.h"

#include <algorithm>
#include <random>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

constexpr size_t kMaxIdLength = 63;
constexpr size_t kMaxShown = 100;  // Of a bad value in an error message.

bool IsAlphanumeric(char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); }

std::string Shown(absl::string_view text) {
  std::string shown;
  for (const char c : text.substr(0, kMaxShown)) shown += c >= ' ' && c <= '~' ? c : '?';
  return shown;
}

}  // namespace

absl::Status CheckId(absl::string_view field, absl::string_view id) {
  const bool good = !id.empty() && id.size() <= kMaxIdLength && IsAlphanumeric(id[0]) &&
                    std::all_of(id.begin(), id.end(), [](char c) {
                      return IsAlphanumeric(c) || c == '-' || c == '_' || c == '.';
                    });
  if (good) return absl::OkStatus();
  return InvalidField(
      field, Shown(id),
      "an id is 1 to 63 of a-z, 0-9, '-', '_' and '.', starting with a letter or digit");
}

absl::StatusOr<std::string> ParseSceneName(absl::string_view field, absl::string_view name) {
  const std::vector<absl::string_view> parts =
      absl::StrSplit(name.substr(0, 4 * kMaxIdLength), '/');
  if (parts.size() != 2 || parts[0] != "scenes" || !CheckId(field, parts[1]).ok()) {
    return InvalidField(field, Shown(name), "must be scenes/{scene}");
  }
  return std::string(parts[1]);
}

absl::StatusOr<PointSetName> ParsePointSetName(absl::string_view field, absl::string_view name) {
  const std::vector<absl::string_view> parts =
      absl::StrSplit(name.substr(0, 4 * kMaxIdLength), '/');
  if (parts.size() != 4 || parts[0] != "scenes" || parts[2] != "pointSets" ||
      !CheckId(field, parts[1]).ok() || !CheckId(field, parts[3]).ok()) {
    return InvalidField(field, Shown(name), "must be scenes/{scene}/pointSets/{point_set}");
  }
  return PointSetName{std::string(parts[1]), std::string(parts[3])};
}

std::string SceneName(absl::string_view scene_id) { return absl::StrCat("scenes/", scene_id); }

std::string PointSetNameOf(absl::string_view scene_id, absl::string_view point_set_id) {
  return absl::StrCat("scenes/", scene_id, "/pointSets/", point_set_id);
}

ErrorMetadata SceneResource(absl::string_view scene_id) {
  return {{"resource", SceneName(scene_id)}};
}

std::string MakeId(absl::string_view prefix) {
  static thread_local std::mt19937_64 generator{std::random_device{}()};
  return absl::StrFormat("%s-%016x", prefix, generator());
}

}  // namespace sightline
