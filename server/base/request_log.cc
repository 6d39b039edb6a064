// SPDX-License-Identifier: Apache-2.0
#include "server/base/request_log.h"

#include <openssl/sha.h>

#include "absl/strings/string_view.h"
#include "server/base/error.h"

namespace sightline {
namespace {

constexpr size_t kMaxIdLength = 128;

}  // namespace

Fingerprint FingerprintOf(absl::string_view request) {
  Fingerprint digest;
  SHA256(reinterpret_cast<const uint8_t*>(request.data()), request.size(), digest.data());
  return digest;
}

RequestClaim& RequestClaim::operator=(RequestClaim&& other) noexcept {
  if (this == &other) return *this;
  Drop();
  log_ = std::exchange(other.log_, nullptr);
  id_ = std::move(other.id_);
  repeated_ = other.repeated_;
  resource_ = std::move(other.resource_);
  return *this;
}

void RequestClaim::Complete(absl::string_view resource) {
  resource_ = std::string(resource);
  if (log_ != nullptr) std::exchange(log_, nullptr)->Complete(id_, resource);
}

void RequestClaim::Drop() {
  if (log_ != nullptr) std::exchange(log_, nullptr)->Abandon(id_);
}

absl::StatusOr<RequestClaim> RequestLog::Claim(absl::string_view id,
                                               const Fingerprint& fingerprint) {
  RequestClaim claim;
  if (id.empty()) return claim;
  if (id.size() > kMaxIdLength) {
    return InvalidField("request_id", absl::StrCat(id.size(), " characters"),
                        "must have at most 128");
  }
  MutexLock lock(mutex_);
  const auto [found, inserted] =
      entries_.try_emplace(std::string(id), Entry{fingerprint, "", false});
  if (inserted) {
    claim.log_ = this;
    claim.id_ = std::string(id);
    return claim;
  }
  const Entry& entry = found->second;
  if (entry.fingerprint != fingerprint) {
    return InvalidField("request_id", id, "was used for a different request before",
                        v1::ERROR_REASON_REQUEST_ID_REUSED);
  }
  if (!entry.complete) {
    return MakeError(absl::StatusCode::kAborted, v1::ERROR_REASON_SCENE_BUSY,
                     absl::StrCat("the first call with request_id \"", id,
                                  "\" is still under way: ask again once it has ended"),
                     {{"field", "request_id"}, {"value", std::string(id)}});
  }
  claim.repeated_ = true;
  claim.resource_ = entry.resource;
  return claim;
}

void RequestLog::ForgetResource(absl::string_view resource) {
  MutexLock lock(mutex_);
  for (auto id = completed_.begin(); id != completed_.end();) {
    const auto entry = entries_.find(*id);
    if (entry == entries_.end() || entry->second.resource != resource) {
      ++id;
      continue;
    }
    entries_.erase(entry);
    id = completed_.erase(id);
  }
}

void RequestLog::Complete(const std::string& id, absl::string_view resource) {
  MutexLock lock(mutex_);
  Entry& entry = entries_[id];
  entry.complete = true;
  entry.resource = std::string(resource);
  completed_.push_back(id);
  while (completed_.size() > max_entries_) {
    entries_.erase(completed_.front());
    completed_.pop_front();
  }
}

void RequestLog::Abandon(const std::string& id) {
  MutexLock lock(mutex_);
  entries_.erase(id);
}

}  // namespace sightline
