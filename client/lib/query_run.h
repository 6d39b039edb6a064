// SPDX-License-Identifier: Apache-2.0
//
// How every streamed query goes: ask what the server allows and which revision is current, cut the
// query into items, run them, decode what comes back and add up what it took. For the library's own
// files.
//
// Thread safety: free functions; callbacks come as StreamJob.deliver does (stream_runner.h).
//
//   absl::StatusOr<QueryStart> start = StartQuery(*this, options);
//   const ItemCut cut = CutIntoItems(n, 16384, samples, bytes_each, start->limits);
//   StreamJob<...> job; ...
//   return RunQuery(std::move(job), decode, on_shadows, *start, options, channels);
#ifndef SIGHTLINE_CLIENT_LIB_QUERY_RUN_H_
#define SIGHTLINE_CLIENT_LIB_QUERY_RUN_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "client/lib/client.h"
#include "client/lib/status.h"
#include "client/lib/stream_runner.h"
#include "client/lib/types.h"
#include "client/lib/upload.h"

namespace sightline::client {

// `options` of what begins now: whatever it does, and at whatever time, it has that one deadline.
inline StreamOptions Begun(StreamOptions options) {
  options.deadline = std::min(options.deadline, absl::Now() + options.timeout);
  options.timeout = absl::InfiniteDuration();
  return options;
}

// What a query knows when it begins.
struct QueryStart {
  absl::Time time;
  CallOptions call;  // For its calls beside the streams.
  Limits limits;
  bool stored_segments = false;  // Capabilities::stored_segments.
};

inline absl::StatusOr<QueryStart> StartQuery(const Client& client, const StreamOptions& options) {
  QueryStart start{.time = absl::Now()};
  start.call = {.deadline = Begun(options).deadline, .cancellation = options.cancellation};
  absl::StatusOr<Capabilities> capabilities = client.GetCapabilities(start.call);
  if (!capabilities.ok()) return capabilities.status();
  start.limits = capabilities->limits;
  start.stored_segments = capabilities->stored_segments;
  return start;
}

// The scene as it is now. FAILED_PRECONDITION (SCENE_NOT_READY) where it has no revision yet: a
// stream that named none would see whichever comes, and another one after an edit.
inline absl::StatusOr<Scene> SceneToAsk(const Client& client, const std::string& name,
                                        const CallOptions& call) {
  absl::StatusOr<Scene> scene = client.GetScene(name, call);
  if (!scene.ok() || scene->revision != 0) return scene;
  absl::Status status = absl::FailedPreconditionError(
      scene->state == SceneState::kFailed
          ? absl::StrCat(name, " could not be built: ", scene->state_message,
                         ". Delete it, and make it anew")
          : absl::StrCat(name, " is still being built: ask again once it is ready"));
  v1::ErrorInfo info;
  info.set_domain("sightline");
  info.set_reason("SCENE_NOT_READY");
  status.SetPayload(kErrorInfoUrl, absl::Cord(info.SerializeAsString()));
  return status;
}

// Runs a query: run(callback). Unless its caller has named the revision, it finds out which is
// current; if an edit came between, and the server has let go of it before anything was delivered,
// the query runs once more, on what is current then.
template <typename Part, typename Run>
absl::StatusOr<StreamSummary> RunOnRevision(bool named,
                                            const std::function<absl::Status(Part)>& on_part,
                                            const Run& run) {
  if (named) return run(on_part);
  bool delivered = false;
  const std::function<absl::Status(Part)> deliver = [&](Part part) {
    delivered = true;
    return on_part(std::move(part));
  };
  absl::StatusOr<StreamSummary> ran = run(deliver);
  const std::optional<ErrorDetail> detail = GetErrorDetail(ran.status());
  if (delivered || !detail || detail->reason != "REVISION_MISMATCH") return ran;
  return run(deliver);
}

inline uint64_t MaxItemRays(const Limits& limits) {
  return static_cast<uint64_t>(std::max<int64_t>(1, limits.max_item_rays));
}

// Elements in a row cut into items of `per_item`; the last may have less.
struct ItemCut {
  uint64_t total = 0;
  uint64_t per_item = 1;

  size_t items() const { return static_cast<size_t>((total + per_item - 1) / per_item); }
  uint64_t begin(size_t item) const { return item * per_item; }
  uint64_t count(size_t item) const { return std::min(per_item, total - begin(item)); }
};

// As many elements per item as are wanted, unless the limits on an item's rays or a message's bytes
// say less. `bytes_each`: of the item's arrays; 0 where the server has them.
inline ItemCut CutIntoItems(uint64_t total, uint64_t wanted_per_item, uint64_t rays_each,
                            uint64_t bytes_each, const Limits& limits) {
  const uint64_t most =
      std::min({wanted_per_item, MaxItemRays(limits) / std::max<uint64_t>(1, rays_each),
                ArrayBytes(limits.max_message_bytes) / std::max<uint64_t>(1, bytes_each)});
  return {.total = total, .per_item = std::max<uint64_t>(1, most)};
}

// Runs `job`, all of which is set but `deliver`: `decode` makes a Part of an item's replies, which
// goes to `on_part`.
template <typename Request, typename Response, typename Decode, typename Part>
absl::StatusOr<StreamSummary> RunQuery(StreamJob<Request, Response> job, const Decode& decode,
                                       const std::function<absl::Status(Part)>& on_part,
                                       const QueryStart& start, const StreamOptions& options,
                                       int channels) {
  using Reply = typename StreamJob<Request, Response>::Reply;
  StreamSummary summary;
  job.deliver = [&](size_t item, std::vector<Reply> replies) -> absl::Status {
    absl::StatusOr<Part> part = decode(item, std::move(replies));
    if (!part.ok()) return part.status();
    summary.statistics.Add(part->statistics);
    return on_part(*std::move(part));
  };
  const int lanes = options.streams > 0 ? options.streams : channels;
  const RunOptions run{
      .lanes = static_cast<int>(std::clamp<size_t>(job.item_count, 1, static_cast<size_t>(lanes))),
      .min_item_cost = start.limits.min_item_cost_rays,
      .deadline = start.call.deadline,
      .cancellation = options.cancellation,
      .retry = options.retry,
  };
  RunTotals totals;
  const absl::Status status = RunStreams(job, run, &totals);
  if (!status.ok()) return status;
  summary.revision = job.header.header().stream().revision();
  summary.items = job.item_count;
  for (size_t i = 0; i < job.item_count; ++i) summary.rays += static_cast<uint64_t>(job.cost(i));
  summary.bytes_received = totals.bytes_received;
  summary.bytes_sent = totals.bytes_sent;
  summary.resent_items = totals.resent_items;
  summary.elapsed = absl::Now() - start.time;
  return summary;
}

// Runs a query to its end and puts its parts together in `all`: run(callback) calls back with every
// part, place(part) puts one into `all` and returns how many elements it held; `on_progress`, if
// any, hears how many are there.
template <typename Part, typename Run, typename PlacePart>
absl::Status CollectParts(const Run& run, const PlacePart& place,
                          const std::function<void(uint64_t done)>& on_progress,
                          StreamSummary* summary) {
  uint64_t done = 0;
  absl::StatusOr<StreamSummary> ran = run([&](const Part& part) {
    done += place(part);
    if (on_progress) on_progress(done);
    return absl::OkStatus();
  });
  if (!ran.ok()) return ran.status();
  *summary = *std::move(ran);
  return absl::OkStatus();
}

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_QUERY_RUN_H_
