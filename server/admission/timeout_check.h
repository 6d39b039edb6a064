// SPDX-License-Identifier: Apache-2.0
//
// Whether an item can be answered within its timeout, as things stand: better refused at once than
// computed for nobody. Under overload this is what keeps goodput up: whatever is accepted is in
// time.
//
// Thread safety: functions only.
//
//   SL_RETURN_IF_ERROR(CheckTimeout(timeout, flow->Foresee(cost)));
#ifndef SIGHTLINE_SERVER_ADMISSION_TIMEOUT_CHECK_H_
#define SIGHTLINE_SERVER_ADMISSION_TIMEOUT_CHECK_H_

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/admission/scheduler.h"

namespace sightline {

// The pace of a busy machine goes up and down by about this factor from one second to the next; a
// forecast is stretched by it before it is compared with a timeout. (Beside builds on every core, a
// quarter left 7 % of what was accepted at three times the capacity too late.)
inline constexpr double kForecastMargin = 1.5;

// Beyond it a deadline means nothing, and clocks overflow.
inline constexpr absl::Duration kLongestTimeout = absl::Hours(24 * 365);

// RESOURCE_EXHAUSTED (QUEUE_FULL, with a retry delay) for an item that would be in time if it were
// alone, and is not. One that is too long by itself may be tried: no later time is better, and the
// forecast may be wrong.
absl::Status CheckTimeout(absl::Duration timeout, const Scheduler::Forecast& forecast);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_TIMEOUT_CHECK_H_
