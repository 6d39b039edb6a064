// SPDX-License-Identifier: Apache-2.0
#include "client/load/knee.h"

#include <utility>

#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace sightline::load {
namespace {

// Below this share of the first rate the search gives up downwards.
constexpr double kLeastShare = 1.0 / 1024;

}  // namespace

absl::StatusOr<Knee> FindKnee(double first_rate, const KneeTry& trial) {
  SIGHTLINE_CHECK(first_rate > 0) << "rate " << first_rate;
  Knee knee;
  double rate = first_rate;
  bool again = false;  // The rate missed once.
  while (static_cast<int>(knee.trials.size()) < kMaxTrials) {
    SL_ASSIGN_OR_RETURN(KneeTrial result, trial(rate));
    knee.trials.push_back(result);
    if (result.held) {
      knee.rate = rate;
    } else if (!again) {
      again = true;
      continue;
    } else {
      knee.missed = rate;
    }
    again = false;
    if (knee.missed == 0) {
      rate = 2 * knee.rate;
    } else if (knee.rate == 0) {
      rate = knee.missed / 2;
      if (rate < kLeastShare * first_rate) break;
    } else if (knee.missed - knee.rate <= kKneePrecision * knee.rate) {
      break;
    } else {
      rate = (knee.rate + knee.missed) / 2;
    }
  }
  return knee;
}

absl::Status HoldKnee(Knee* knee, const KneeTry& whole) {
  SIGHTLINE_CHECK(knee->rate > 0) << "rate " << knee->rate;
  for (int step = 0;; ++step) {
    SL_ASSIGN_OR_RETURN(KneeTrial run, whole(knee->rate));
    run.whole = true;
    knee->trials.push_back(run);
    if (run.held) return absl::OkStatus();
    knee->missed = knee->rate;
    if (step == kStepsBack) {
      knee->rate = 0;
      return absl::OkStatus();
    }
    knee->rate *= kStepBack;
  }
}

}  // namespace sightline::load
