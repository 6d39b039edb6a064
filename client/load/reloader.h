// SPDX-License-Identifier: Apache-2.0
//
// Edits the scene while it is asked about: an object comes and goes, a revision each time. The
// reference is told beforehand what the next revision will be; a server that made another one ends
// the test, since then somebody else edits the scene, too.
//
// Edits run one after the other on a thread of their own. When they take longer than the requests
// between them, they fall behind and are left out, never queued. The destructor takes the object
// away again if it is there.
//
// Thread safety: every method from any thread.
//
//   Reloader reloader(client, scene, extra, /*every=*/1000, reference.get());
//   reloader.CountAnswer();   // After each answer.
#ifndef SIGHTLINE_CLIENT_LOAD_RELOADER_H_
#define SIGHTLINE_CLIENT_LOAD_RELOADER_H_

#include <cstdint>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "client/lib/client.h"
#include "client/load/histogram.h"
#include "client/load/reference.h"
#include "core/base/mutex.h"
#include "core/mesh/object.h"

namespace sightline::load {

struct ReloadReport {
  uint64_t edits = 0;
  LatencyHistogram latency;  // Of an edit, until the new revision answers.
  absl::Status status;       // The first failure; no edit follows it.
};

class Reloader {
 public:
  // `reference` may be null. REQUIRES: every > 0.
  Reloader(const client::Client& client, const client::Scene& scene, const ObjectInput& extra,
           uint64_t every, Reference* reference);
  ~Reloader();

  void CountAnswer();
  // Returns once the edit that is due or under way, if any, is done.
  void WaitUntilIdle();
  ReloadReport report() const;

 private:
  void Run();
  absl::Status Edit(bool add);

  const client::Client client_;
  const std::string scene_;
  const ObjectInput extra_;
  const uint64_t every_;
  Reference* const reference_;
  int64_t revision_;      // Of the thread.
  bool present_ = false;  // Of the thread: the object is in the scene.
  mutable Mutex mutex_;
  CondVar changed_;
  uint64_t answers_ ABSL_GUARDED_BY(mutex_) = 0;
  bool due_ ABSL_GUARDED_BY(mutex_) = false;   // An edit is to be made, or is being made.
  bool over_ ABSL_GUARDED_BY(mutex_) = false;  // No edit will be made any more.
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
  ReloadReport report_ ABSL_GUARDED_BY(mutex_);
  std::thread thread_;  // Last: it uses the others.
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_RELOADER_H_
