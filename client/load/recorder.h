// SPDX-License-Identifier: Apache-2.0
//
// Collects outcomes into a Measurement.
//
// Thread safety: every method from any thread.
//
//   Recorder recorder(absl::Seconds(1));
//   recorder.Begin(start + warm_up, start + warm_up + duration);
//   recorder.Add(outcome);
//   Measurement measured = recorder.Result(end);
#ifndef SIGHTLINE_CLIENT_LOAD_RECORDER_H_
#define SIGHTLINE_CLIENT_LOAD_RECORDER_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include "client/load/measurement.h"
#include "core/base/mutex.h"

namespace sightline::load {

// A name for what went wrong: the code, and the server's reason where it gave one.
std::string ErrorName(const absl::Status& status);

// A run so far, in little.
struct Glance {
  absl::Duration elapsed;  // Of the measured interval; not above zero during the warm-up.
  uint64_t answered = 0, failed = 0, wrong = 0;
  std::vector<Window> last;  // The last complete ones.
};

class Recorder {
 public:
  // Windows of an hour-long run at most: beyond that, answers count in the totals alone.
  // ParseOptions sees to it that no run has more.
  static constexpr size_t kMaxWindows = 4000;

  // REQUIRES: window > 0.
  explicit Recorder(absl::Duration window);

  // The measured interval; what was planned before `begin` is warm-up.
  void Begin(absl::Time begin, absl::Time end);
  void Add(const Outcome& outcome);
  // A closed loop's wait after a refusal, which counts as far as it is within the interval.
  void AddRefusalWait(absl::Time from, absl::Time to);
  // What there is by `now`, in an interval that ends at `now` if that is before its end.
  Measurement Result(absl::Time now) const;
  // At most `windows` of the last complete windows.
  Glance Look(absl::Time now, size_t windows) const;

 private:
  absl::Duration Elapsed(absl::Time now) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  size_t CompleteWindows(absl::Time now) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  mutable Mutex mutex_;
  absl::Time end_ ABSL_GUARDED_BY(mutex_) = absl::InfiniteFuture();
  Measurement measured_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_RECORDER_H_
