// SPDX-License-Identifier: Apache-2.0
#include "core/base/limit_error.h"

#include <utility>
#include <vector>

#include "absl/strings/cord.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace sightline {
namespace {

constexpr char kPayload[] = "sightline/exceeded-limit";

}  // namespace

absl::Status LimitError(absl::string_view limit, uint64_t value, absl::string_view problem,
                        absl::string_view remedy) {
  absl::Status status =
      absl::ResourceExhaustedError(absl::StrCat(problem, "; ", limit, " is ", value, ": ", remedy));
  status.SetPayload(kPayload, absl::Cord(absl::StrCat(limit, " ", value)));
  return status;
}

std::optional<ExceededLimit> ExceededLimitOf(const absl::Status& status) {
  const absl::optional<absl::Cord> payload = status.GetPayload(kPayload);
  if (!payload.has_value()) return std::nullopt;
  const std::string text(*payload);
  const std::pair<absl::string_view, absl::string_view> parts = absl::StrSplit(text, ' ');
  ExceededLimit limit{.name = std::string(parts.first)};
  if (!absl::SimpleAtoi(parts.second, &limit.value)) return std::nullopt;
  return limit;
}

}  // namespace sightline
