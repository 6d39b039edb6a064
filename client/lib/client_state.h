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
#include "client/lib/client.h"
#include "client/lib/mutex.h"

namespace sightline::client {

struct Client::Shared {
  explicit Shared(std::shared_ptr<Connection> c) : connection(std::move(c)) {}

  const std::shared_ptr<Connection> connection;
  Mutex mutex;
  std::optional<Capabilities> capabilities ABSL_GUARDED_BY(mutex);
};

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_CLIENT_STATE_H_
