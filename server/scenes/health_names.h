// SPDX-License-Identifier: Apache-2.0
//
// Which scenes have a health of their own. gRPC's health service cannot forget a name, so that
// scenes which come and go would fill it: it is told of those that somebody named and that were
// there, in memory or stored, and of no more names in a server's life than there is room for.
//
// Invariant: a name that was taken stays taken; there are never more than `max_names`. The first
// that finds no room is logged.
//
// Thread safety: every method from any thread.
//
//   if (names.Take(view)) health->SetServingStatus(SceneName(view.status.name), serving);
#ifndef SIGHTLINE_SERVER_SCENES_HEALTH_NAMES_H_
#define SIGHTLINE_SERVER_SCENES_HEALTH_NAMES_H_

#include <cstddef>
#include <set>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/mutex.h"
#include "server/base/log.h"
#include "server/base/resource_name.h"
#include "server/scenes/scene_catalog.h"

namespace sightline {

class HealthNames {
 public:
  explicit HealthNames(size_t max_names) : max_names_(max_names) {}

  // Whether the health service is to hear of the scene.
  bool Take(const SceneView& view) {
    // Nobody asks for a name that the server made up, and what is gone, or was never made, need not
    // be begun with.
    const bool begin = !view.anonymous && !view.deleted && view.status.latest != nullptr;
    return Take(view.status.name, begin);
  }
  // The same for a scene that is stored, in memory or not.
  bool TakeStored(const std::string& name) { return Take(name, /*begin=*/true); }

 private:
  bool Take(const std::string& name, bool begin) {
    MutexLock lock(mutex_);
    if (names_.contains(name)) return true;
    if (!begin) return false;
    if (names_.size() < max_names_) return names_.insert(name).second;
    if (!std::exchange(full_, true)) {
      Log(LogLevel::kWarning, "health_names_full",
          {{"names", absl::StrCat(max_names_)},
           {"without_health", SceneName(name)},
           {"remedy", "raise max_scenes, or use names again"}});
    }
    return false;
  }

  const size_t max_names_;
  Mutex mutex_;
  bool full_ ABSL_GUARDED_BY(mutex_) = false;
  std::set<std::string> names_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SCENES_HEALTH_NAMES_H_
