// SPDX-License-Identifier: Apache-2.0
//
// How unary handlers run: a short lookup in the reaction, or a task of a pool: of the call pool for
// what frees much memory or looks at files, of the build pool for what makes much. Each is counted
// by how it ended; running out of memory fails the call alone. A draining server refuses new ones,
// and waits until those that it took are answered and their answers written.
//
// Thread safety: functions only.
//
//   return Answer(env_, Operation::kGetScene, [&] { return catalog.Get(id).status(); });
#ifndef SIGHTLINE_SERVER_SERVICES_UNARY_H_
#define SIGHTLINE_SERVER_SERVICES_UNARY_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/functional/any_invocable.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "server/admission/call_tracker.h"
#include "server/base/error.h"
#include "server/base/memory_guard.h"
#include "server/metrics/metrics.h"
#include "server/stream/query_environment.h"

namespace sightline {

// The reactor of a call that ends with `status`; it holds `call` until the answer is written.
grpc::ServerUnaryReactor* FinishedCall(ActiveCall call, const absl::Status& status);

// Runs `handler` here and now.
template <typename Handler>
grpc::ServerUnaryReactor* Answer(const QueryEnvironment& env, Operation operation,
                                 const Handler& handler) {
  const CallTimer timer(env.metrics, operation);
  absl::StatusOr<ActiveCall> call = env.calls.Admit();
  const absl::Status status = call.ok() ? GuardMemory(handler) : call.status();
  timer.Record(status.code());
  return FinishedCall(call.ok() ? *std::move(call) : ActiveCall(), status);
}

// Runs `handler` on `pool`, one of the environment's. Its captures live until it is done, and its
// token fires when the client goes away or the call's deadline passes.
using LaterHandler = absl::AnyInvocable<absl::Status(const CancelToken& cancel)>;
grpc::ServerUnaryReactor* AnswerLater(const grpc::CallbackServerContext& context,
                                      const QueryEnvironment& env, ThreadPool& pool,
                                      Operation operation, LaterHandler handler);

struct Page {
  size_t size = 0;
  std::string after;  // The last id of the page before.
};

// A page token is the last id of its page behind a fixed letter: it stays good when others come and
// go. INVALID_ARGUMENT for a negative size or a token that is none.
absl::StatusOr<Page> ParsePage(int32_t page_size, const std::string& page_token);
std::string PageToken(const std::string& last_id);

// Of page.size + 1 entries looked for: takes off the one beyond the page. Whether there was one, so
// that there is a next page.
template <typename Entry>
bool CutToPage(const Page& page, std::vector<Entry>* entries) {
  if (entries->size() <= page.size) return false;
  entries->resize(page.size);
  return true;
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SERVICES_UNARY_H_
