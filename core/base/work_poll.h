// SPDX-License-Identifier: Apache-2.0
//
// When work looks at its cancel token: once for so much of it, counted where it is done, so that
// what lies between two looks is bounded, whatever the input is. What may be of any size by itself,
// as leaves of kd-trees and of binary BVHs are where triangles lie on top of each other, is counted
// part by part.
//
// Thread safety: one thread's own.
//
//   WorkPoll<64> poll(cancel);
//   while (...) {
//     if (poll.Stops()) return false;
//     Visit(...);
//   }
#ifndef SIGHTLINE_CORE_BASE_WORK_POLL_H_
#define SIGHTLINE_CORE_BASE_WORK_POLL_H_

#include <cstddef>

#include "core/base/cancel.h"

namespace sightline {

// kInterval: how much work lies between two looks.
template <size_t kInterval>
class WorkPoll {
 public:
  // `cancel` may be null; else it must outlive this.
  explicit WorkPoll(const CancelToken* cancel) : cancel_(cancel) {}
  WorkPoll(const WorkPoll&) = delete;
  WorkPoll& operator=(const WorkPoll&) = delete;

  // Counts so much more. True, from then on: the token has fired, leave off.
  bool Stops(size_t work = 1) {
    work_ += work;
    if (work_ < kInterval) [[likely]]
      return false;
    return Look();
  }
  bool stopped() const { return stopped_; }  // As it was last seen.

 private:
  bool Look() {
    stopped_ = stopped_ || (cancel_ != nullptr && cancel_->cancelled());
    if (!stopped_) work_ = 0;  // Else every later call stops, too.
    return stopped_;
  }

  const CancelToken* const cancel_;
  size_t work_ = 0;
  bool stopped_ = false;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_WORK_POLL_H_
