// SPDX-License-Identifier: Apache-2.0
//
// Frees point sets whose lease ran out, also when nobody asks for anything: sweeps the store every
// few seconds from one thread of its own.
//
// Thread safety: constructed and destroyed by one thread.
//
//   LeaseSweeper sweeper(store, absl::Seconds(5));
#ifndef SIGHTLINE_SERVER_LEASE_SWEEPER_H_
#define SIGHTLINE_SERVER_LEASE_SWEEPER_H_

#include <thread>

#include "absl/time/time.h"
#include "core/base/mutex.h"
#include "server/points/point_set_store.h"

namespace sightline {

class LeaseSweeper {
 public:
  LeaseSweeper(PointSetStore& store, absl::Duration period);
  // Ends the thread.
  ~LeaseSweeper();

 private:
  void Run(absl::Duration period);

  PointSetStore& store_;
  Mutex mutex_;
  CondVar stopped_;
  bool stop_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_LEASE_SWEEPER_H_
