// SPDX-License-Identifier: Apache-2.0
//
// The workload's answers as the server itself gives them when it is asked another way: in bulk, by
// the client library, by a strategy that shares little with AUTO. BRUTE_FORCE, which walks no tree,
// where it is cheap enough; else SINGLE, a ray at a time.
//
// Thread safety: free functions.
//
//   const client::Strategy way = StrategyFor(*workload, scene.triangles);
//   SL_ASSIGN_OR_RETURN(Answers due, ServerAnswers(client, *workload, scene.revision, way, 8, {}));
#ifndef SIGHTLINE_CLIENT_LOAD_SERVER_ANSWERS_H_
#define SIGHTLINE_CLIENT_LOAD_SERVER_ANSWERS_H_

#include <cstddef>
#include <cstdint>

#include "absl/status/statusor.h"
#include "client/lib/client.h"
#include "client/lib/types.h"
#include "client/load/answer.h"
#include "client/load/workload.h"

namespace sightline::load {

client::Strategy StrategyFor(const Workload& workload, uint64_t triangles);
// "SINGLE", as --help and reports name it. REQUIRES: one of StrategyFor's.
const char* NameOf(client::Strategy strategy);

// Of each kind that is asked about, every `stride`-th item, at `revision` (> 0). The server's error
// if it does not answer all of them.
absl::StatusOr<Answers> ServerAnswers(const client::Client& client, const Workload& workload,
                                      int64_t revision, client::Strategy strategy, size_t stride,
                                      const client::StreamOptions& stream);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_SERVER_ANSWERS_H_
