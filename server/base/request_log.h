// SPDX-License-Identifier: Apache-2.0
//
// Remembers which request_id made what, so that a repeated creation returns the first one's result
// instead of making a second. Bounded: the oldest completed entries are forgotten, and of a request
// there is its digest alone, however large it was.
//
// Invariants: an id is claimed by at most one call at a time; a claim that is dropped without
// Complete leaves no trace, so that the call can be repeated.
//
// Thread safety: every method of RequestLog from any thread; a claim belongs to one owner at a
// time. The log outlives its claims.
//
//   SL_ASSIGN_OR_RETURN(RequestClaim claim, log.Claim("request-7", FingerprintOf(header_bytes)));
//   if (claim.repeated()) return Find(claim.resource());
//   ...
//   claim.Complete("scenes/hall");
#ifndef SIGHTLINE_SERVER_BASE_REQUEST_LOG_H_
#define SIGHTLINE_SERVER_BASE_REQUEST_LOG_H_

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/base/mutex.h"

namespace sightline {

class RequestLog;

// What is asked for: SHA-256, so that nobody can make another request that looks like it.
using Fingerprint = std::array<uint8_t, 32>;
Fingerprint FingerprintOf(absl::string_view request);

class RequestClaim {
 public:
  RequestClaim() = default;
  RequestClaim(RequestClaim&& other) noexcept { *this = std::move(other); }
  RequestClaim& operator=(RequestClaim&& other) noexcept;
  ~RequestClaim() { Drop(); }

  // Whether the id has already made `resource()`.
  bool repeated() const { return repeated_; }
  const std::string& resource() const { return resource_; }
  // The call has made `resource`. Does nothing for a call without an id.
  void Complete(absl::string_view resource);

 private:
  friend class RequestLog;
  void Drop();

  RequestLog* log_ = nullptr;  // Null once completed, repeated or without an id.
  std::string id_;
  bool repeated_ = false;
  std::string resource_;
};

class RequestLog {
 public:
  explicit RequestLog(size_t max_entries = 4096) : max_entries_(max_entries) {}

  // An empty id is always new. InvalidArgument (INVALID_FIELD: longer than 128 characters;
  // REQUEST_ID_REUSED: another fingerprint), Aborted (SCENE_BUSY: its first call is under way).
  absl::StatusOr<RequestClaim> Claim(absl::string_view id, const Fingerprint& fingerprint);
  // Forgets every id that made `resource`, because it is gone.
  void ForgetResource(absl::string_view resource);

 private:
  friend class RequestClaim;
  struct Entry {
    Fingerprint fingerprint;
    std::string resource;
    bool complete = false;
  };
  void Complete(const std::string& id, absl::string_view resource);
  void Abandon(const std::string& id);

  const size_t max_entries_;
  Mutex mutex_;
  std::map<std::string, Entry, std::less<>> entries_ ABSL_GUARDED_BY(mutex_);
  std::deque<std::string> completed_ ABSL_GUARDED_BY(mutex_);  // In order of completion.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_BASE_REQUEST_LOG_H_
