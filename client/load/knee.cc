// SPDX-License-Identifier: Apache-2.0
#include "client/load/knee.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/load/arrivals.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace sightline::load {
namespace {

// Below this share of the first rate the search gives up downwards.
constexpr double kLeastShare = 1.0 / 1024;

}  // namespace

absl::StatusOr<KneeTrial> JudgeTrial(double rate, const Measurement& measured, const Slo& slo) {
  if (measured.wrong > 0) {
    return absl::DataLossError(absl::StrCat(measured.wrong, " of ", measured.checked,
                                            " answers were wrong while the knee was searched"));
  }
  // Answers in time for what came in that time: Poisson arrivals are not exactly at the rate.
  const bool kept_up = static_cast<double>(measured.all.answered_in_time) >=
                       kKeepsUp * static_cast<double>(measured.all.requests);
  return KneeTrial{.rate = rate,
                   .answered = measured.Rate(),
                   .p50 = absl::ToDoubleMilliseconds(measured.all.planned.PercentileOf(50)),
                   .p99 = absl::ToDoubleMilliseconds(measured.all.planned.PercentileOf(99)),
                   .held = kept_up && Held(slo.Judge(measured))};
}

absl::Status FindKnee(double first_rate, const KneeTry& trial, Knee* knee) {
  SIGHTLINE_CHECK(first_rate > 0) << "rate " << first_rate;
  double rate = first_rate;
  bool again = false;  // The rate missed once.
  while (static_cast<int>(knee->trials.size()) < kMaxTrials) {
    SL_ASSIGN_OR_RETURN(KneeTrial result, trial(rate));
    knee->trials.push_back(result);
    if (result.held) {
      knee->rate = rate;
    } else if (!again) {
      again = true;
      continue;
    } else {
      knee->missed = rate;
    }
    again = false;
    if (knee->missed == 0) {
      if (rate >= kHighestRate) break;
      rate = std::min(2 * knee->rate, kHighestRate);
    } else if (knee->rate == 0) {
      rate = knee->missed / 2;
      if (rate < kLeastShare * first_rate) break;
    } else if (knee->missed - knee->rate <= kKneePrecision * knee->rate) {
      break;
    } else {
      rate = (knee->rate + knee->missed) / 2;
    }
  }
  return absl::OkStatus();
}

absl::Status HoldKnee(Knee* knee, const KneeTry& whole) {
  SIGHTLINE_CHECK(knee->rate > 0) << "rate " << knee->rate;
  double rate = knee->rate;
  for (int step = 0; step <= kStepsBack; ++step, rate *= kStepBack) {
    SL_ASSIGN_OR_RETURN(KneeTrial run, whole(rate));
    run.whole = true;
    knee->trials.push_back(run);
    if (run.held) {
      knee->rate = rate;
      return absl::OkStatus();
    }
    knee->missed = rate;
    knee->rate = 0;
  }
  return absl::OkStatus();
}

}  // namespace sightline::load
