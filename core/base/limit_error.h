// SPDX-License-Identifier: Apache-2.0
//
// The error of what is over a limit that somebody set, and which limit that was: for whoever has to
// tell it from a lack of memory, and calls the limit by another name.
//
// Thread safety: functions only.
//
//   return LimitError("max_scenes", options.max_scenes, "the server holds 10 scenes");
//   if (const auto limit = ExceededLimitOf(status)) ... limit->name
#ifndef SIGHTLINE_CORE_BASE_LIMIT_ERROR_H_
#define SIGHTLINE_CORE_BASE_LIMIT_ERROR_H_

#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace sightline {

struct ExceededLimit {
  std::string name;  // Such as "max_triangles".
  uint64_t value = 0;
};

// ResourceExhausted: "<problem>; <limit> is <value>: <remedy>".
absl::Status LimitError(absl::string_view limit, uint64_t value, absl::string_view problem,
                        absl::string_view remedy);

// Nothing for an error of another kind.
std::optional<ExceededLimit> ExceededLimitOf(const absl::Status& status);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_LIMIT_ERROR_H_
