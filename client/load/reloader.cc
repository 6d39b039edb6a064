// SPDX-License-Identifier: Apache-2.0
#include "client/load/reloader.h"

#include <span>
#include <type_traits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "core/base/check.h"

namespace sightline::load {
namespace {

// How long a change may take.
constexpr absl::Duration kTimeout = absl::Minutes(5);

static_assert(sizeof(Vec3d) == 3 * sizeof(double) && std::is_standard_layout_v<Vec3d>);

}  // namespace

Reloader::Reloader(const client::Client& client, const client::Scene& scene,
                   const ObjectInput& extra, const Options& options, Reference* reference)
    : client_(client),
      scene_(scene.name),
      extra_(extra),
      options_(options),
      reference_(reference),
      revision_(scene.revision),
      thread_([this] { Run(); }) {
  SIGHTLINE_CHECK(options.every > 0) << "a change after every 0 answers";
}

Reloader::~Reloader() {
  {
    MutexLock lock(mutex_);
    closed_ = true;
    changed_.SignalAll();
  }
  thread_.join();
  if (present_) Edit(/*add=*/false).IgnoreError();
}

void Reloader::CountAnswer() {
  MutexLock lock(mutex_);
  if (++answers_ % options_.every != 0) return;
  due_ = true;
  changed_.SignalAll();
}

ReloadReport Reloader::report() const {
  MutexLock lock(mutex_);
  ReloadReport report = report_;
  report.by = options_.by;
  return report;
}

void Reloader::WaitUntilIdle() {
  MutexLock lock(mutex_);
  while (due_ && !over_) changed_.Wait(mutex_);
}

void Reloader::Run() {
  while (true) {
    {
      MutexLock lock(mutex_);
      while (!due_ && !closed_) changed_.Wait(mutex_);
      over_ = closed_;
      if (over_) return;
    }
    const absl::Time start = absl::Now();
    const absl::Status status = options_.by == ReloadBy::kEdit ? Edit(!present_) : ReadAgain();
    MutexLock lock(mutex_);
    due_ = false;
    changed_.SignalAll();
    if (!status.ok()) {
      over_ = true;
      report_.status = status;
      return;
    }
    ++report_.changes;
    report_.latency.Record(absl::Now() - start);
  }
}

absl::Status Reloader::Edit(bool add) {
  client::SceneEdit edit{.kind = add ? client::SceneEdit::Kind::kAdd
                                     : client::SceneEdit::Kind::kRemove};
  edit.object.name = extra_.name;
  if (add) {
    edit.object.vertices = std::span<const double>(
        reinterpret_cast<const double*>(extra_.vertices.data()), extra_.vertices.size() * 3);
    edit.object.indices = extra_.indices;
  }
  // Before the edit: answers of the new revision may come before it returns.
  if (reference_ != nullptr) reference_->ExpectRevision(revision_ + 1, add ? 1 : 0);
  const absl::StatusOr<client::Scene> scene =
      client_.UpdateScene(scene_, {edit}, revision_, {.deadline = absl::Now() + kTimeout});
  if (scene.ok()) present_ = add;
  return Expect(scene);
}

absl::Status Reloader::ReadAgain() {
  // The same again, as far as the reference is concerned.
  if (reference_ != nullptr) reference_->ExpectRevision(revision_ + 1, 0);
  return Expect(client_.ReloadScene(scene_, {.deadline = absl::Now() + kTimeout}));
}

absl::Status Reloader::Expect(const absl::StatusOr<client::Scene>& scene) {
  if (!scene.ok()) return scene.status();
  if (scene->revision != revision_ + 1) {
    return absl::AbortedError(absl::StrCat("a change of ", scene_, " made revision ",
                                           scene->revision, " where ", revision_ + 1,
                                           " was due: is somebody else changing it?"));
  }
  revision_ = scene->revision;
  return absl::OkStatus();
}

}  // namespace sightline::load
