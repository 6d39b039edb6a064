// SPDX-License-Identifier: Apache-2.0
#include "client/load/arrivals.h"

#include <cmath>

#include "core/base/check.h"

namespace sightline::load {

ArrivalSchedule::ArrivalSchedule(Arrivals arrivals, double rate, uint64_t seed)
    : arrivals_(arrivals), rate_(rate), random_(seed) {
  SIGHTLINE_CHECK(std::isfinite(rate) && rate > 0) << "rate " << rate;
}

absl::Duration ArrivalSchedule::Next() {
  if (arrivals_ == Arrivals::kConstant) {
    // From the count, so that no error adds up.
    seconds_ = static_cast<double>(count_++) / rate_;
  } else {
    seconds_ -= std::log1p(-random_.Uniform()) / rate_;
  }
  return absl::Nanoseconds(std::floor(seconds_ * 1e9));
}

}  // namespace sightline::load
