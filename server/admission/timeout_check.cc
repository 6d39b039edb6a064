// SPDX-License-Identifier: Apache-2.0
#include "server/admission/timeout_check.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "server/base/error.h"

namespace sightline {

absl::Status CheckTimeout(absl::Duration timeout, const Scheduler::Forecast& forecast) {
  const absl::Duration shared = absl::FromChrono(forecast.shared) * kForecastMargin;
  const absl::Duration alone = absl::FromChrono(forecast.alone) * kForecastMargin;
  if (shared <= timeout || alone > timeout) return absl::OkStatus();
  const std::string asked = absl::FormatDuration(timeout), needed = absl::FormatDuration(shared);
  return WithRetryDelay(
      MakeError(absl::StatusCode::kResourceExhausted, v1::ERROR_REASON_QUEUE_FULL,
                absl::StrCat("item.timeout = ", asked, " is too short for the queue, which takes ",
                             needed, " or so: try again later"),
                {{"limit", "item.timeout"}, {"limit_value", asked}, {"value", needed}}),
      shared - timeout);
}

}  // namespace sightline
