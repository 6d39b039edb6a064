// SPDX-License-Identifier: Apache-2.0
//
// How much of one kind each client has, and no more than its role or the server allows: calls under
// way, bytes of its uploads, scenes that it made. Many connections of a client are one client.
//
// Thread safety: every method of CallQuota from any thread; a share belongs to one owner at a time.
// The quota outlives its shares.
//
//   CallQuota quota("uploads", CallQuota::Shares::kPass,
//                   {"max_concurrent_uploads_per_client", 8});
//   absl::StatusOr<CallShare> share = quota.Take("token:nightly", /*most=*/2);
//   // RESOURCE_EXHAUSTED (QUOTA_EXCEEDED)
//   SL_RETURN_IF_ERROR(share->Add(message.ByteSizeLong(), /*most=*/1 << 20));
#ifndef SIGHTLINE_SERVER_ADMISSION_CALL_QUOTA_H_
#define SIGHTLINE_SERVER_ADMISSION_CALL_QUOTA_H_

#include <cstdint>
#include <map>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"

namespace sightline {

class CallQuota;

// What a client may have whose role says nothing.
struct UsualShare {
  absl::string_view limit;  // Its name in sightline.v1.Limits.
  uint64_t most = 0;        // 0: any number.
};

class CallShare {
 public:
  CallShare() = default;
  CallShare(CallShare&& other) noexcept
      : quota_(std::exchange(other.quota_, nullptr)),
        client_(std::move(other.client_)),
        amount_(other.amount_) {}
  CallShare& operator=(CallShare&& other) noexcept {
    Release();
    quota_ = std::exchange(other.quota_, nullptr);
    client_ = std::move(other.client_);
    amount_ = other.amount_;
    return *this;
  }
  ~CallShare() { Release(); }
  inline void Release();
  bool held() const { return quota_ != nullptr; }
  // Takes `more` into the same share, unless the client had more than `most` then; 0: whatever the
  // server allows.
  // REQUIRES: the share is one.
  inline absl::Status Add(uint64_t more, uint64_t most);

 private:
  friend class CallQuota;
  CallShare(CallQuota* quota, std::string client, uint64_t amount)
      : quota_(quota), client_(std::move(client)), amount_(amount) {}

  CallQuota* quota_ = nullptr;
  std::string client_;
  uint64_t amount_ = 0;
};

class CallQuota {
 public:
  // Whether shares end by themselves, as calls do: what is refused may be had a little later.
  enum class Shares { kPass, kLast };

  // `kind` is what an access file calls them: "streams", "uploads".
  explicit CallQuota(std::string kind, Shares shares = Shares::kPass, UsualShare usual = {})
      : kind_(std::move(kind)), shares_(shares), usual_(usual) {}
  CallQuota(const CallQuota&) = delete;
  CallQuota& operator=(const CallQuota&) = delete;

  // `most`: how many the client's role lets it have at once; 0: says nothing. `amount` is what the
  // share begins with.
  absl::StatusOr<CallShare> Take(const std::string& client, uint64_t most, uint64_t amount = 1) {
    SL_RETURN_IF_ERROR(Grow(client, /*has=*/0, amount, most));
    return CallShare(this, client, amount);
  }

 private:
  friend class CallShare;
  // `has` of what the client has taken is the share's that grows.
  absl::Status Grow(const std::string& client, uint64_t has, uint64_t more, uint64_t by_role) {
    const uint64_t most = by_role > 0 ? by_role : usual_.most;
    MutexLock lock(mutex_);
    const auto found = taken_.find(client);
    const uint64_t taken = found == taken_.end() ? 0 : found->second;
    if (most > 0 && (more > most || taken > most - more)) {
      // A share that is too large alone is so later, too. Otherwise, when one of its own ends is in
      // the client's hands.
      const bool later = shares_ == Shares::kPass && (more <= most && has <= most - more);
      const absl::Status over =
          OverLimit(absl::StrCat(kind_, " at once of ", client), taken + more,
                    by_role > 0 ? absl::StrCat("limit ", kind_, " of the access file")
                                : std::string(usual_.limit),
                    most, Remedy(later),
                    later ? v1::ERROR_REASON_QUOTA_EXCEEDED : v1::ERROR_REASON_LIMIT_EXCEEDED);
      return later ? WithRetryDelay(over, absl::Seconds(1)) : over;
    }
    if (more > 0) taken_[client] = taken + more;
    return absl::OkStatus();
  }
  absl::string_view Remedy(bool later) const {
    if (later) return "try again when some of them have ended";
    return shares_ == Shares::kLast ? "delete one first" : "send less at once";
  }
  void Return(const std::string& client, uint64_t amount) {
    if (amount == 0) return;
    MutexLock lock(mutex_);
    const auto taken = taken_.find(client);
    taken->second -= amount;
    if (taken->second == 0) taken_.erase(taken);
  }

  const std::string kind_;
  const Shares shares_;
  const UsualShare usual_;
  Mutex mutex_;
  std::map<std::string, uint64_t> taken_ ABSL_GUARDED_BY(mutex_);  // By client.
};

inline void CallShare::Release() {
  if (quota_ != nullptr) std::exchange(quota_, nullptr)->Return(client_, amount_);
}

inline absl::Status CallShare::Add(uint64_t more, uint64_t most) {
  SL_RETURN_IF_ERROR(quota_->Grow(client_, amount_, more, most));
  amount_ += more;
  return absl::OkStatus();
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_CALL_QUOTA_H_
