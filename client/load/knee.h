// SPDX-License-Identifier: Apache-2.0
//
// Searches the highest rate of an open loop at which an objective holds: the knee, beyond which
// latencies climb. The rate is doubled until a trial misses, then the gap between the highest that
// held and the lowest that missed is halved until it is within 5 %. A rate counts as missed once
// two trials of it have missed: one bad trial on a busy machine does not end the search.
//
// Bounded: at most kMaxTrials trials, at kHighestRate (arrivals.h) at most.
//
// Thread safety: none; FindKnee runs in the caller's thread.
//
//   Knee knee;
//   SL_RETURN_IF_ERROR(FindKnee(50, [&](double rate) { return RunTrial(rate); }, &knee));
#ifndef SIGHTLINE_CLIENT_LOAD_KNEE_H_
#define SIGHTLINE_CLIENT_LOAD_KNEE_H_

#include <functional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/load/measurement.h"
#include "client/load/slo.h"

namespace sightline::load {

inline constexpr int kMaxTrials = 40;
inline constexpr double kKneePrecision = 0.05;
inline constexpr double kStepBack = 0.9;
inline constexpr int kStepsBack = 5;
// An open loop that answers less than this share of what is due is beyond the knee, whatever the
// latencies of its first seconds say.
inline constexpr double kKeepsUp = 0.95;

struct KneeTrial {
  double rate = 0;          // Asked for, requests per second.
  double answered = 0;      // Achieved.
  double p50 = 0, p99 = 0;  // Milliseconds, from the planned time.
  bool held = false;
  bool whole = false;  // A run in full, of those after the search.
};

struct Knee {
  double rate = 0;                // The highest that held; 0: not even the lowest tried.
  double missed = 0;              // The lowest that missed; 0: none did.
  std::vector<KneeTrial> trials;  // In the order in which they ran.
};

// What a run at `rate` came to: it held if it met the objective and kept up with what was due.
// DATA_LOSS if it had a wrong answer: wrong is wrong, at whatever rate, and a search that stepped
// back from it would hide it.
absl::StatusOr<KneeTrial> JudgeTrial(double rate, const Measurement& measured, const Slo& slo);

// Runs one rate; its error ends the search.
using KneeTry = std::function<absl::StatusOr<KneeTrial>(double rate)>;

// After an error `knee` has what was found by then. REQUIRES: first_rate > 0, an empty `knee`.
absl::Status FindKnee(double first_rate, const KneeTry& trial, Knee* knee);

// A trial is short: what holds in it may not hold in a whole run. Runs the knee's rate by `whole`,
// and steps back by a tenth, kStepsBack times at most, until one holds: that is then the knee's
// rate, and 0 if none does. The runs are among its trials. After an error the knee's rate is that
// of the trials, or 0 once a whole run has missed: of lower rates nothing is known in full.
// REQUIRES: knee->rate > 0.
absl::Status HoldKnee(Knee* knee, const KneeTry& whole);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_KNEE_H_
