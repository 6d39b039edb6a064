// SPDX-License-Identifier: Apache-2.0
//
// What copies of a Client share. For the library's own files.
//
// Thread safety: all members may be used from any thread.
#ifndef SIGHTLINE_CLIENT_LIB_CLIENT_STATE_H_
#define SIGHTLINE_CLIENT_LIB_CLIENT_STATE_H_

#include <memory>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "client/lib/client.h"
#include "client/lib/mutex.h"

namespace sightline::client {

struct Client::Shared {
  explicit Shared(std::shared_ptr<Connection> c) : connection(std::move(c)) {}

  // Hand on how a query, or an upload, ended that was cut after the server's limits. Where it was
  // not without trouble the server may be another by now, which has others: they are forgotten.
  // That is so of one that was refused here, too: by limits that may be another server's.
  absl::StatusOr<StreamSummary> Checked(absl::StatusOr<StreamSummary> ran) {
    if (!ran.ok() || ran->resent_items > 0) ForgetCapabilities();
    return ran;
  }
  template <typename T>
  absl::StatusOr<T> Checked(absl::StatusOr<T> uploaded) {
    if (!uploaded.ok()) ForgetCapabilities();
    return uploaded;
  }
  void ForgetCapabilities() {
    MutexLock lock(&mutex);
    capabilities.reset();
  }

  const std::shared_ptr<Connection> connection;
  Mutex mutex;
  std::optional<Capabilities> capabilities ABSL_GUARDED_BY(mutex);
};

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_CLIENT_STATE_H_
