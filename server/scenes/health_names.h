// SPDX-License-Identifier: Apache-2.0
//
// Which scenes have a health of their own. gRPC's health service cannot forget a name, so that
// scenes which come and go would fill it: it is told of those that somebody named, and of no more
// names in a server's life than there is room for.
//
// Invariant: a name that was taken stays taken; there are never more than `max_names`.
//
// Thread safety: every method from any thread.
//
//   if (names.Take(view)) health->SetServingStatus(SceneName(view.status.name), serving);
#ifndef SIGHTLINE_SERVER_SCENES_HEALTH_NAMES_H_
#define SIGHTLINE_SERVER_SCENES_HEALTH_NAMES_H_

#include <cstddef>
#include <set>
#include <string>

#include "core/base/mutex.h"
#include "server/scenes/scene_catalog.h"

namespace sightline {

class HealthNames {
 public:
  explicit HealthNames(size_t max_names) : max_names_(max_names) {}

  // Whether the health service is to hear of the scene.
  bool Take(const SceneView& view) {
    MutexLock lock(mutex_);
    if (names_.contains(view.status.name)) return true;
    // Nobody asks for a name that the server made up, and what is gone need not be begun with.
    if (view.anonymous || view.deleted || names_.size() >= max_names_) return false;
    names_.insert(view.status.name);
    return true;
  }

 private:
  const size_t max_names_;
  Mutex mutex_;
  std::set<std::string> names_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SCENES_HEALTH_NAMES_H_
