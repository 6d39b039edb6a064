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

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include "client/load/measurement.h"
#include "core/base/mutex.h"

namespace sightline::load {

// A name for what went wrong: the code, and the server's reason where it gave one.
std::string ErrorName(const absl::Status& status);

class Recorder {
 public:
  // Windows of an hour-long run at most: beyond that, answers count in the totals alone.
  static constexpr size_t kMaxWindows = 4000;

  // REQUIRES: window > 0.
  explicit Recorder(absl::Duration window);

  // The measured interval; what was planned before `begin` is warm-up.
  void Begin(absl::Time begin, absl::Time end);
  void Add(const Outcome& outcome);
  // What there is by `now`, in an interval that ends at `now` if that is before its end.
  Measurement Result(absl::Time now) const;

 private:
  mutable Mutex mutex_;
  absl::Time end_ ABSL_GUARDED_BY(mutex_) = absl::InfiniteFuture();
  Measurement measured_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_RECORDER_H_
