// SPDX-License-Identifier: Apache-2.0
//
// Work in this process that ends with a session's calls: a token for it, which their cancellation
// cancels.
//
// Thread safety: as CancelToken's.
//
//   const CancelledWork work(session.call().cancellation);
//   SL_ASSIGN_OR_RETURN(ImportedScene scene, ImportFile(path, {.cancel = work.token()}));
#ifndef SIGHTLINE_CLIENT_CLI_CANCELLED_WORK_H_
#define SIGHTLINE_CLIENT_CLI_CANCELLED_WORK_H_

#include "client/lib/cancellation.h"
#include "core/base/cancel.h"

namespace sightline::cli {

class CancelledWork {
 public:
  // `calls` may be null: then nothing ever happens. It must outlive the object.
  explicit CancelledWork(client::Cancellation* calls) : stop_(calls, [this] { token_.Cancel(); }) {}
  const CancelToken* token() const { return &token_; }

 private:
  CancelToken token_;
  const client::Cancellation::Registration stop_;
};

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_CANCELLED_WORK_H_
