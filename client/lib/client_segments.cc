// SPDX-License-Identifier: Apache-2.0
//
// Segments: cut, run, decode, put together.
#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/lib/client.h"
#include "client/lib/client_state.h"
#include "client/lib/convert.h"
#include "client/lib/query_support.h"
#include "client/lib/stream_runner.h"
#include "client/lib/upload.h"

namespace sightline::client {

namespace {

void ResizeSegments(const SegmentQuery& query, uint64_t n, Segments* out) {
  out->segments = n;
  if (query.blocked) out->blocked.resize(n);
  out->valid.resize(n);
  if (query.blockers) {
    out->blocker_object.resize(n);
    out->blocker_triangle.resize(n);
    out->blocker_distance.resize(n);
  }
}

absl::StatusOr<Segments> DecodeSegments(const SegmentQuery& query, uint64_t offset, uint64_t n,
                                        std::vector<v1::SegmentReply> replies) {
  Segments out;
  out.offset = offset;
  ResizeSegments(query, n, &out);
  const absl::Status status = DecodeReplies(
      std::move(replies), n, &out.statistics,
      [&](const v1::SegmentReply& reply, uint64_t at, uint64_t count) -> absl::Status {
        const v1::SegmentResult& r = reply.segments();
        absl::Status s;
        s.Update(DecodeValid(r.valid_bits(), at, count, &out.valid));
        if (query.blocked) {
          s.Update(DecodeBits(r.blocked_bits(), "blocked_bits", 1, at, count, n, &out.blocked));
          for (uint64_t i = at; i < at + count && s.ok(); ++i) {
            if (out.valid[i] == 0) out.blocked[i] = kInvalid;
          }
        }
        if (query.blockers) {
          s.Update(DecodeRows(r.blocker_objects(), "blocker_objects", 1, at, count, n,
                              &out.blocker_object));
          s.Update(DecodeRows(r.blocker_triangles(), "blocker_triangles", 1, at, count, n,
                              &out.blocker_triangle));
          s.Update(DecodeRows(r.blocker_distances(), "blocker_distances", 1, at, count, n,
                              &out.blocker_distance));
        }
        return s;
      });
  if (!status.ok()) return status;
  return out;
}

}  // namespace

absl::StatusOr<StreamSummary> Client::TestSegments(
    const SegmentQuery& query, const std::function<absl::Status(Segments)>& on_segments,
    const StreamOptions& options) const {
  const absl::Time start = absl::Now();
  const CallOptions call{.deadline = start + options.timeout, .cancellation = options.cancellation};
  if (query.segments.size() % 6 != 0) {
    return absl::InvalidArgumentError(
        absl::StrCat("segments has ", query.segments.size(), " numbers, which 6 does not divide"));
  }
  if (query.segments_per_item == 0) return absl::InvalidArgumentError("segments_per_item is 0");
  absl::StatusOr<Capabilities> capabilities = GetCapabilities(call);
  if (!capabilities.ok()) return capabilities.status();
  const Limits& limits = capabilities->limits;
  absl::StatusOr<int64_t> revision = PinnedRevision(query.scene, query.options.revision, call);
  if (!revision.ok()) return revision.status();
  const uint64_t n = query.segments.size() / 6;
  constexpr uint64_t kBytesPerSegment = 6 * 8;
  const uint64_t per_item = std::max<uint64_t>(
      1, std::min({uint64_t{query.segments_per_item},
                   static_cast<uint64_t>(std::max<int64_t>(1, limits.max_item_rays)),
                   ChunkBytes(limits.max_message_bytes) / kBytesPerSegment}));
  const auto begin = [&](size_t i) { return i * per_item; };
  const auto count = [&](size_t i) { return std::min(per_item, n - i * per_item); };

  StreamJob<v1::TestSegmentsRequest, v1::TestSegmentsResponse> job;
  job.item_count = static_cast<size_t>((n + per_item - 1) / per_item);
  v1::TestSegmentsHeader* header = job.header.mutable_header();
  FillHeader(query.scene, *revision, query.options, header->mutable_stream());
  header->mutable_outputs()->set_blocked_bits(query.blocked);
  header->mutable_outputs()->set_first_blockers(query.blockers);
  job.open = [this](int lane, const CallOptions& stream_call) {
    return shared_->connection->OpenSegments(lane, stream_call);
  };
  job.make_item = [&](size_t i) {
    v1::TestSegmentsRequest request;
    FillItem(i, options, request.mutable_item()->mutable_item());
    request.mutable_item()->set_segments(PackRows(query.segments, 6, begin(i), count(i)));
    return request;
  };
  job.cost = [&](size_t i) { return static_cast<int64_t>(count(i)); };
  StreamSummary summary;
  job.deliver = [&](size_t i, std::vector<v1::SegmentReply> replies) -> absl::Status {
    absl::StatusOr<Segments> part = DecodeSegments(query, begin(i), count(i), std::move(replies));
    if (!part.ok()) return part.status();
    summary.statistics.Add(part->statistics);
    return on_segments(*std::move(part));
  };

  RunTotals totals;
  const absl::Status status = RunStreams(
      job,
      ToRunOptions(options, limits, shared_->connection->channel_count(), job.item_count, start),
      &totals);
  if (!status.ok()) return status;
  summary.revision = *revision;
  summary.items = job.item_count;
  summary.rays = n;
  summary.bytes_received = totals.bytes_received;
  summary.bytes_sent = totals.bytes_sent;
  summary.resent_items = totals.resent_items;
  summary.elapsed = absl::Now() - start;
  return summary;
}

absl::StatusOr<Segments> Client::TestAllSegments(
    const SegmentQuery& query, const StreamOptions& options,
    const std::function<void(uint64_t done)>& on_progress) const {
  Segments all;
  const uint64_t n = query.segments.size() / 6;
  ResizeSegments(query, n, &all);
  uint64_t done = 0;
  absl::StatusOr<StreamSummary> summary = TestSegments(
      query,
      [&](const Segments& part) {
        Place(part.blocked, 1, part.offset, n, &all.blocked);
        Place(part.valid, 1, part.offset, n, &all.valid);
        Place(part.blocker_object, 1, part.offset, n, &all.blocker_object);
        Place(part.blocker_triangle, 1, part.offset, n, &all.blocker_triangle);
        Place(part.blocker_distance, 1, part.offset, n, &all.blocker_distance);
        done += part.segments;
        if (on_progress) on_progress(done);
        return absl::OkStatus();
      },
      options);
  if (!summary.ok()) return summary.status();
  all.statistics = summary->statistics;
  all.summary = *summary;
  return all;
}

}  // namespace sightline::client
