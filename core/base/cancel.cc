// SPDX-License-Identifier: Apache-2.0
#include "core/base/cancel.h"

namespace sightline {

absl::Status CancelToken::ToStatus() const {
  switch (reason()) {
    case kLive:
      return absl::OkStatus();
    case kCancelled:
      return absl::CancelledError("the work was cancelled before it was done");
    case kDeadlineExceeded:
      return absl::DeadlineExceededError(
          "the deadline passed before the work was done; allow more time or ask for less");
  }
  return absl::InternalError("a cancel token in no known state");
}

bool CancelToken::TakeLook(Clock::rep left) const {
  while (left > kNoLooks && left <= kMostLooks) {
    if (deadline_.compare_exchange_weak(left, left - 1, std::memory_order_relaxed)) return true;
  }
  return left > kMostLooks;  // A deadline that replaced it meanwhile: the next look's to notice.
}

}  // namespace sightline
