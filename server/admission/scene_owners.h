// SPDX-License-Identifier: Apache-2.0
//
// Whose scenes are whose: each client's count against its role's limit from their creation until
// they are deleted. Those that were there before the server started are nobody's.
//
// Thread safety: every method from any thread.
//
//   SL_ASSIGN_OR_RETURN(CallShare share, owners.Take(client.name, client.limits.scenes));
//   ...                                     // The scene is made, or the share goes.
//   owners.Keep("hall", std::move(share));
#ifndef SIGHTLINE_SERVER_ADMISSION_SCENE_OWNERS_H_
#define SIGHTLINE_SERVER_ADMISSION_SCENE_OWNERS_H_

#include <cstdint>
#include <map>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "core/base/mutex.h"
#include "server/admission/call_quota.h"

namespace sightline {

class SceneOwners {
 public:
  // ResourceExhausted (LIMIT_EXCEEDED): the client has made `most` already; 0: any number.
  absl::StatusOr<CallShare> Take(const std::string& client, uint64_t most) {
    return quota_.Take(client, most);
  }
  void Keep(const std::string& scene_id, CallShare share) {
    if (!share.held()) return;
    MutexLock lock(mutex_);
    shares_.insert_or_assign(scene_id, std::move(share));
  }
  // The scene's share, to be kept again if the scene stays; none if it is nobody's.
  CallShare Remove(const std::string& scene_id) {
    MutexLock lock(mutex_);
    const auto found = shares_.find(scene_id);
    if (found == shares_.end()) return CallShare();
    CallShare share = std::move(found->second);
    shares_.erase(found);
    return share;
  }

 private:
  CallQuota quota_{"scenes", CallQuota::Shares::kLast};
  Mutex mutex_;
  std::map<std::string, CallShare> shares_ ABSL_GUARDED_BY(mutex_);  // By scene.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_SCENE_OWNERS_H_
