// SPDX-License-Identifier: Apache-2.0
#include "client/load/answer.h"

#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"

namespace sightline::load {
namespace {

template <typename T>
std::string FirstDifference(const char* what, const std::vector<T>& due,
                            const std::vector<T>& given) {
  if (due.size() != given.size()) {
    return absl::StrCat(given.size(), " ", what, " where ", due.size(), " are due");
  }
  // Bits, not values: a NaN is itself, and -0 is not 0.
  if (due.empty() || std::memcmp(due.data(), given.data(), due.size() * sizeof(T)) == 0) return "";
  size_t i = 0;
  while (std::memcmp(&due[i], &given[i], sizeof(T)) == 0) ++i;
  return absl::StrCat(what, "[", i, "] is ", +given[i], " where ", +due[i], " is due");
}

}  // namespace

Answer ToAnswer(client::Tile tile) {
  return {.flags = std::move(tile.lit),
          .objects = std::move(tile.object),
          .triangles = std::move(tile.triangle),
          .distances = std::move(tile.depth)};
}

Answer ToAnswer(client::Shadows shadows) { return {.flags = std::move(shadows.lit)}; }

Answer ToAnswer(client::Segments segments) {
  return {.flags = std::move(segments.blocked),
          .objects = std::move(segments.blocker_object),
          .triangles = std::move(segments.blocker_triangle),
          .distances = std::move(segments.blocker_distance)};
}

std::string Difference(const Answer& due, const Answer& given) {
  std::string found = FirstDifference("flags", due.flags, given.flags);
  if (found.empty()) found = FirstDifference("objects", due.objects, given.objects);
  if (found.empty()) found = FirstDifference("triangles", due.triangles, given.triangles);
  if (found.empty()) found = FirstDifference("distances", due.distances, given.distances);
  return found;
}

}  // namespace sightline::load
