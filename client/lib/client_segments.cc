// SPDX-License-Identifier: Apache-2.0
//
// Segments: cut, run, decode, put together.
#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/lib/client.h"
#include "client/lib/client_state.h"
#include "client/lib/convert.h"
#include "client/lib/query_run.h"
#include "client/lib/query_support.h"
#include "client/lib/query_wire.h"
#include "client/lib/stream_runner.h"
#include "client/lib/upload.h"

namespace sightline::client {

namespace {

void ResizeSegments(const SegmentQuery& query, uint64_t n, Segments* out) {
  out->segments = n;
  if (query.blocked) out->blocked.resize(n);
  out->valid.resize(n);
  if (query.blockers) ResizeBlockers(n, out);
}

}  // namespace

v1::TestSegmentsHeader SegmentsHeader(const SegmentQuery& query, int64_t revision) {
  v1::TestSegmentsHeader header;
  FillHeader(query.scene, revision, query.options, header.mutable_stream());
  header.mutable_outputs()->set_blocked_bits(query.blocked);
  header.mutable_outputs()->set_first_blockers(query.blockers);
  return header;
}

void FillSegmentItem(const SegmentQuery& query, uint64_t begin, uint64_t count,
                     v1::SegmentItem* item) {
  item->set_segments(PackRows(query.segments, 6, begin, count));
}

absl::StatusOr<Segments> DecodeSegments(const SegmentQuery& query, uint64_t begin, uint64_t n,
                                        std::vector<v1::SegmentReply> replies) {
  Segments out;
  out.offset = begin;
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
        if (query.blockers) s.Update(DecodeBlockers(r, 1, at, count, n, &out));
        return s;
      });
  if (!status.ok()) return status;
  return out;
}

absl::StatusOr<StreamSummary> Client::TestSegments(
    const SegmentQuery& query, const std::function<absl::Status(Segments)>& on_segments,
    const StreamOptions& options) const {
  if (query.segments.size() % 6 != 0) {
    return absl::InvalidArgumentError(
        absl::StrCat("segments has ", query.segments.size(), " numbers, which 6 does not divide"));
  }
  if (query.segments_per_item == 0) return absl::InvalidArgumentError("segments_per_item is 0");
  absl::StatusOr<QueryStart> start = StartQuery(*this, options);
  if (!start.ok()) return start.status();
  absl::StatusOr<int64_t> revision =
      PinnedRevision(query.scene, query.options.revision, start->call);
  if (!revision.ok()) return revision.status();
  constexpr uint64_t kBytesPerSegment = 6 * 8;
  const ItemCut cut = CutIntoItems(query.segments.size() / 6, query.segments_per_item, 1,
                                   kBytesPerSegment, start->limits);

  StreamJob<v1::TestSegmentsRequest, v1::TestSegmentsResponse> job;
  job.item_count = cut.items();
  *job.header.mutable_header() = SegmentsHeader(query, *revision);
  job.open = [this](int lane, const CallOptions& stream_call) {
    return shared_->connection->OpenSegments(lane, stream_call);
  };
  job.make_item = [&](size_t i) {
    v1::TestSegmentsRequest request;
    FillItem(i, options, request.mutable_item()->mutable_item());
    FillSegmentItem(query, cut.begin(i), cut.count(i), request.mutable_item());
    return request;
  };
  job.cost = [&](size_t i) { return static_cast<int64_t>(cut.count(i)); };
  const auto decode = [&](size_t i, std::vector<v1::SegmentReply> replies) {
    return DecodeSegments(query, cut.begin(i), cut.count(i), std::move(replies));
  };
  return RunQuery(std::move(job), decode, on_segments, *start, options,
                  shared_->connection->channel_count());
}

absl::StatusOr<Segments> Client::TestAllSegments(
    const SegmentQuery& query, const StreamOptions& options,
    const std::function<void(uint64_t done)>& on_progress) const {
  Segments all;
  const uint64_t n = query.segments.size() / 6;
  ResizeSegments(query, n, &all);
  const absl::Status status = CollectParts<Segments>(
      [&](const auto& on_part) { return TestSegments(query, on_part, options); },
      [&](const Segments& part) {
        Place(part.blocked, 1, part.offset, n, &all.blocked);
        Place(part.valid, 1, part.offset, n, &all.valid);
        PlaceBlockers(part, 1, n, &all);
        return part.segments;
      },
      on_progress, &all.summary);
  if (!status.ok()) return status;
  all.statistics = all.summary.statistics;
  return all;
}

}  // namespace sightline::client
