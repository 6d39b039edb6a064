// SPDX-License-Identifier: Apache-2.0
//
// Ends calls early from another thread. One Cancellation may serve many calls; once cancelled it
// stays so, and calls that start with it fail at once.
//
// Thread safety: all members may be called from any thread. A callback runs in the thread that
// cancels, or in the one that registers it when it is too late; it must not register or unregister.
//
//   Cancellation cancellation;
//   std::thread stop([&] { cancellation.Cancel(); });
//   client.TraceTiles(query, on_tile, {.cancellation = &cancellation});
#ifndef SIGHTLINE_CLIENT_LIB_CANCELLATION_H_
#define SIGHTLINE_CLIENT_LIB_CANCELLATION_H_

#include <functional>
#include <map>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "client/lib/mutex.h"

namespace sightline::client {

class Cancellation {
 public:
  Cancellation() = default;
  Cancellation(const Cancellation&) = delete;
  Cancellation& operator=(const Cancellation&) = delete;

  void Cancel() {
    MutexLock lock(&mutex_);
    cancelled_ = true;
    // Under the lock: once Unregister has returned, the callback neither runs nor will.
    for (auto& [id, callback] : callbacks_) callback();
    callbacks_.clear();
  }
  bool cancelled() const {
    MutexLock lock(&mutex_);
    return cancelled_;
  }

  // Calls back once, at Cancel or now if that was before, until the registration goes.
  class Registration {
   public:
    // `cancellation` may be null: then nothing ever happens.
    Registration(Cancellation* cancellation, std::function<void()> callback)
        : cancellation_(cancellation) {
      if (cancellation_ == nullptr) return;
      MutexLock lock(&cancellation_->mutex_);
      if (cancellation_->cancelled_) {
        callback();
        return;
      }
      id_ = ++cancellation_->last_id_;
      cancellation_->callbacks_[id_] = std::move(callback);
    }
    ~Registration() {
      if (cancellation_ == nullptr) return;
      MutexLock lock(&cancellation_->mutex_);
      cancellation_->callbacks_.erase(id_);
    }
    Registration(const Registration&) = delete;
    Registration& operator=(const Registration&) = delete;

   private:
    Cancellation* cancellation_;
    int id_ = 0;
  };

 private:
  mutable Mutex mutex_;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  int last_id_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<int, std::function<void()>> callbacks_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_CANCELLATION_H_
