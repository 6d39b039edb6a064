// SPDX-License-Identifier: Apache-2.0
//
// How many calls of one kind each client has under way, and no more than its role allows: what a
// client opens on many connections is one client's still.
//
// Thread safety: every method of CallQuota from any thread; a share belongs to one owner at a time.
// The quota outlives its shares.
//
//   absl::StatusOr<CallShare> share = quota.Take("token:nightly", /*most=*/8);
//   // RESOURCE_EXHAUSTED (QUOTA_EXCEEDED)
#ifndef SIGHTLINE_SERVER_ADMISSION_CALL_QUOTA_H_
#define SIGHTLINE_SERVER_ADMISSION_CALL_QUOTA_H_

#include <cstdint>
#include <map>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "core/base/mutex.h"
#include "server/base/error.h"

namespace sightline {

class CallQuota;

class CallShare {
 public:
  CallShare() = default;
  CallShare(CallShare&& other) noexcept
      : quota_(std::exchange(other.quota_, nullptr)), client_(std::move(other.client_)) {}
  CallShare& operator=(CallShare&& other) noexcept {
    Release();
    quota_ = std::exchange(other.quota_, nullptr);
    client_ = std::move(other.client_);
    return *this;
  }
  ~CallShare() { Release(); }
  inline void Release();

 private:
  friend class CallQuota;
  CallShare(CallQuota* quota, std::string client) : quota_(quota), client_(std::move(client)) {}

  CallQuota* quota_ = nullptr;
  std::string client_;
};

class CallQuota {
 public:
  // `kind` is what an access file calls them: "streams", "uploads".
  explicit CallQuota(std::string kind) : kind_(std::move(kind)) {}
  CallQuota(const CallQuota&) = delete;
  CallQuota& operator=(const CallQuota&) = delete;

  // `most`: how many the client may have at once; 0: any number.
  absl::StatusOr<CallShare> Take(const std::string& client, uint64_t most) {
    MutexLock lock(mutex_);
    uint64_t& taken = taken_[client];
    if (most > 0 && taken >= most) {
      // When one of its own ends is in the client's hands.
      return WithRetryDelay(OverLimit(absl::StrCat(kind_, " at once of ", client), taken + 1,
                                      absl::StrCat("limit ", kind_, " of the access file"), most,
                                      v1::ERROR_REASON_QUOTA_EXCEEDED),
                            absl::Seconds(1));
    }
    ++taken;
    return CallShare(this, client);
  }

 private:
  friend class CallShare;
  void Return(const std::string& client) {
    MutexLock lock(mutex_);
    const auto taken = taken_.find(client);
    if (--taken->second == 0) taken_.erase(taken);
  }

  const std::string kind_;
  Mutex mutex_;
  std::map<std::string, uint64_t> taken_ ABSL_GUARDED_BY(mutex_);  // By client.
};

inline void CallShare::Release() {
  if (quota_ != nullptr) std::exchange(quota_, nullptr)->Return(client_);
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_CALL_QUOTA_H_
