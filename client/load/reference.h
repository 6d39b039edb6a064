// SPDX-License-Identifier: Apache-2.0
//
// What is due: the workload's answers, found before the clock starts, so that comparing costs next
// to nothing while it runs. By the engine in this process with single rays (every strategy's
// answers are the same bits), or as whoever makes the reference found them.
//
// A scene that is edited under load has two states, with and without one more object. An answer
// names the revision that it is true of; ExpectRevision says beforehand which state that will be.
//
// Thread safety: every method from any thread once made.
//
//   SL_ASSIGN_OR_RETURN(auto reference, Reference::Make(scene, {}, workload, 1, pool));
//   reference->ExpectRevision(1, 0);
//   Verdict verdict = reference->Judge(work, revision, answer, &difference);
#ifndef SIGHTLINE_CLIENT_LOAD_REFERENCE_H_
#define SIGHTLINE_CLIENT_LOAD_REFERENCE_H_

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/load/answer.h"
#include "client/load/request.h"
#include "client/load/workload.h"
#include "core/base/cancel.h"
#include "core/base/mutex.h"
#include "core/base/parallel.h"
#include "core/mesh/object.h"
#include "core/scene/scene.h"

namespace sightline::load {

class Reference {
 public:
  // The scene that the server has, relative to the same origin. `extra`: what an edit adds. Of each
  // kind every `stride`-th item is found, the others are not checked. Cancelled from `cancel`.
  static absl::StatusOr<std::unique_ptr<Reference>> Make(const std::shared_ptr<const Scene>& scene,
                                                         const std::optional<ObjectInput>& extra,
                                                         const Workload& workload, size_t stride,
                                                         ThreadPool& pool,
                                                         const CancelToken* cancel = nullptr);
  // Of a scene that is not edited: of every `stride`-th item its answer.
  static std::unique_ptr<Reference> Of(Answers answers, size_t stride);

  // Answers of `revision` are those without (0) or with (1) the extra object.
  void ExpectRevision(int64_t revision, size_t state);

  // Wrong, with where it differs first: another answer than the one due, or a revision that nobody
  // expects. `answer` is not looked at where nothing is known of the item.
  Verdict Judge(const Work& work, int64_t revision, const Answer& answer,
                std::string* difference) const;
  bool Knows(const Work& work) const { return work.item % stride_ == 0; }

 private:
  explicit Reference(size_t stride) : stride_(stride) {}
  absl::Status Find(const Scene& scene, const Workload& workload, ThreadPool& pool,
                    const CancelToken* cancel, Answers* answers) const;

  const size_t stride_;
  std::vector<Answers> states_;  // Of every stride-th item.
  mutable Mutex mutex_;
  std::map<int64_t, size_t> revisions_ ABSL_GUARDED_BY(mutex_);
};

// One item by the engine alone.
absl::StatusOr<Answer> EngineAnswer(const Scene& scene, const Workload& workload, const Work& work,
                                    const CancelToken* cancel = nullptr);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_REFERENCE_H_
