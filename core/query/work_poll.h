// SPDX-License-Identifier: Apache-2.0
//
// Looks at a cancel token once in so much work: for searches about one point, which may lie near
// any number of triangles, as many as the scene has copies of one.
//
// Thread safety: an object belongs to one thread.
//
//   WorkPoll poll(cancel);
//   FindTouching(scene, p, radius, skip, &ids, kMost, &poll);
//   if (poll.stopped()) return cancel->ToStatus();  // `ids` are not all of them.
#ifndef SIGHTLINE_CORE_QUERY_WORK_POLL_H_
#define SIGHTLINE_CORE_QUERY_WORK_POLL_H_

#include <cstddef>

#include "core/base/cancel.h"

namespace sightline {

class WorkPoll {
 public:
  explicit WorkPoll(const CancelToken* cancel) : cancel_(cancel) {}

  // Counts triangles that were looked at, or what takes as long. True: the token has fired, leave
  // off; what was found is to be dropped.
  bool Stops(size_t triangles) {
    work_ += triangles;
    return work_ >= kTrianglesBetweenLooks && Look();
  }
  bool stopped() const { return stopped_; }

 private:
  // A triangle takes 10 to 50 ns (Touches, Blocks): some hundred microseconds.
  static constexpr size_t kTrianglesBetweenLooks = 4096;

  bool Look() {
    stopped_ = stopped_ || (cancel_ != nullptr && cancel_->cancelled());
    if (!stopped_) work_ = 0;  // Else every later call looks, and stops, too.
    return stopped_;
  }

  const CancelToken* const cancel_;
  size_t work_ = 0;
  bool stopped_ = false;
};

// For functions to which a poll may be null.
inline bool Stops(WorkPoll* poll, size_t triangles) {
  return poll != nullptr && poll->Stops(triangles);
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_WORK_POLL_H_
