// SPDX-License-Identifier: Apache-2.0
//
// Changes the scene while it is asked about, a revision each time: an object comes and goes, or the
// server reads the scene again from its repository. The reference is told beforehand what the next
// revision will be; a server that made another one ends the test, since then somebody else changes
// the scene, too.
//
// Changes run one after the other on a thread of their own. When they take longer than the requests
// between them, they fall behind and are left out, never queued. The destructor takes the object
// away again if it is there.
//
// Thread safety: every method from any thread.
//
//   Reloader reloader(client, scene, extra, {.every = 1000}, reference.get());
//   reloader.CountAnswer();   // After each answer.
#ifndef SIGHTLINE_CLIENT_LOAD_RELOADER_H_
#define SIGHTLINE_CLIENT_LOAD_RELOADER_H_

#include <cstdint>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/lib/client.h"
#include "client/load/histogram.h"
#include "client/load/reference.h"
#include "core/base/mutex.h"
#include "core/mesh/object.h"

namespace sightline::load {

enum class ReloadBy { kEdit, kFile };

struct ReloadReport {
  ReloadBy by = ReloadBy::kEdit;
  uint64_t changes = 0;
  LatencyHistogram latency;  // Of a change, until the new revision answers.
  absl::Status status;       // The first failure; no change follows it.
};

class Reloader {
 public:
  struct Options {
    uint64_t every = 0;  // Answers, > 0.
    ReloadBy by = ReloadBy::kEdit;
  };
  // `extra` comes and goes. `reference` may be null.
  Reloader(const client::Client& client, const client::Scene& scene, const ObjectInput& extra,
           const Options& options, Reference* reference);
  ~Reloader();

  void CountAnswer();
  // Returns once the change that is due or under way, if any, is done.
  void WaitUntilIdle();
  ReloadReport report() const;

 private:
  void Run();
  absl::Status Edit(bool add);
  absl::Status ReadAgain();
  // Takes over what a change made.
  absl::Status Expect(const absl::StatusOr<client::Scene>& scene);

  const client::Client client_;
  const std::string scene_;
  const ObjectInput extra_;
  const Options options_;
  Reference* const reference_;
  int64_t revision_;      // Of the thread.
  bool present_ = false;  // Of the thread: the object is in the scene.
  mutable Mutex mutex_;
  CondVar changed_;
  uint64_t answers_ ABSL_GUARDED_BY(mutex_) = 0;
  bool due_ ABSL_GUARDED_BY(mutex_) = false;   // A change is to be made, or is being made.
  bool over_ ABSL_GUARDED_BY(mutex_) = false;  // No change will be made any more.
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
  ReloadReport report_ ABSL_GUARDED_BY(mutex_);
  std::thread thread_;  // Last: it uses the others.
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_RELOADER_H_
