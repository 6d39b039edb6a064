// SPDX-License-Identifier: Apache-2.0
//
// When a walk looks at its token: once for so much work, counted where it is done, so that the work
// between two looks is bounded, whatever the scene is. Leaves of kd-trees and of binary BVHs hold
// any number of triangles where these lie on top of each other: they are counted sixteen by
// sixteen.
//
// Thread safety: one thread's own.
//
//   WorkPoll<64> poll(cancel);
//   while (...) {
//     if (poll.Fired()) return false;
//     Visit(...);
//   }
#ifndef SIGHTLINE_CORE_TRAVERSE_WORK_POLL_H_
#define SIGHTLINE_CORE_TRAVERSE_WORK_POLL_H_

#include <cstdint>

#include "core/base/cancel.h"

namespace sightline {

template <uint32_t kInterval>
class WorkPoll {
 public:
  // `cancel` may be null; else it must outlive this.
  explicit WorkPoll(const CancelToken* cancel) : cancel_(cancel) {}
  WorkPoll(const WorkPoll&) = delete;
  WorkPoll& operator=(const WorkPoll&) = delete;

  // Counts one more; looks where there have been so many. Returns whether the token fired: it then
  // stays so.
  bool Fired() {
    if (++since_ < kInterval) [[likely]]
      return fired_;
    since_ = 0;
    return fired_ = cancel_ != nullptr && cancel_->cancelled();
  }
  bool fired() const { return fired_; }  // As it was last seen.

 private:
  const CancelToken* const cancel_;
  uint32_t since_ = 0;
  bool fired_ = false;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_WORK_POLL_H_
