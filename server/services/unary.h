// SPDX-License-Identifier: Apache-2.0
//
// How unary handlers run: a short lookup in the reaction, or a task of the build pool for what
// frees or makes much memory.
//
// Thread safety: functions only.
//
//   return Answer(context, [&] { return catalog.Get(id).status(); });
#ifndef SIGHTLINE_SERVER_SERVICES_UNARY_H_
#define SIGHTLINE_SERVER_SERVICES_UNARY_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/parallel.h"
#include "server/admission/call_tracker.h"
#include "server/base/error.h"

namespace sightline {

// Runs `handler` here and now.
template <typename Handler>
grpc::ServerUnaryReactor* Answer(grpc::CallbackServerContext* context, const Handler& handler) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(ToGrpcStatus(handler()));
  return reactor;
}

// Runs `handler` on the pool; a draining server waits for it. Its captures live until it is done.
template <typename Handler>
grpc::ServerUnaryReactor* AnswerLater(grpc::CallbackServerContext* context, CallTracker& calls,
                                      ThreadPool& pool, Handler handler) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  absl::StatusOr<ActiveCall> call = calls.Admit();
  if (!call.ok()) {
    reactor->Finish(ToGrpcStatus(call.status()));
    return reactor;
  }
  pool.Submit([reactor, call = *std::move(call), handler = std::move(handler)]() mutable {
    const absl::Status status = handler();
    reactor->Finish(ToGrpcStatus(status));
  });
  return reactor;
}

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
