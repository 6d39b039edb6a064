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
#include "client/lib/stored_segments.h"
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

uint64_t SegmentCount(const SegmentQuery& query) {
  return (query.segments.size() + query.stored_segments.size()) / 6;  // One of them is empty.
}

absl::Status CheckSegmentQuery(const SegmentQuery& query) {
  const std::pair<const char*, size_t> arrays[] = {
      {"segments", query.segments.size()}, {"stored_segments", query.stored_segments.size()}};
  for (const auto& [name, size] : arrays) {
    if (size % 6 == 0) continue;
    return absl::InvalidArgumentError(
        absl::StrCat(name, " has ", size, " numbers, which 6 does not divide"));
  }
  if (!query.stored_segments.empty() && !query.segments.empty()) {
    return absl::InvalidArgumentError("segments and stored_segments are both given; give one");
  }
  if (!query.stored_segments.empty() && !query.origin.has_value()) {
    return absl::InvalidArgumentError("stored_segments need the origin that they are relative to");
  }
  if (query.segments_per_item == 0) return absl::InvalidArgumentError("segments_per_item is 0");
  return absl::OkStatus();
}

// The query as it is sent: with the revision that all its items see, and with an origin if its
// segments can travel in their stored form.
absl::StatusOr<SegmentQuery> PinnedQuery(const Client& client, SegmentQuery query,
                                         const QueryStart& start) {
  if (query.options.revision == 0) {
    const absl::StatusOr<Scene> scene = SceneToAsk(client, query.scene, start.call);
    if (!scene.ok()) return scene.status();
    query.options.revision = scene->revision;
    if (!query.origin.has_value()) query.origin = scene->origin;
  }
  if (start.stored_segments) return query;
  if (!query.stored_segments.empty()) {
    return absl::UnimplementedError("the server reads no stored_segments: give segments");
  }
  query.origin.reset();
  return query;
}

}  // namespace

v1::TestSegmentsHeader SegmentsHeader(const SegmentQuery& query, int64_t revision) {
  v1::TestSegmentsHeader header;
  FillHeader(query.scene, revision, query.options, header.mutable_stream());
  header.mutable_outputs()->set_blocked_bits(query.blocked);
  header.mutable_outputs()->set_first_blockers(query.blockers);
  if (query.origin.has_value()) ToProto(*query.origin, header.mutable_origin());
  return header;
}

void FillSegmentItem(const SegmentQuery& query, uint64_t begin, uint64_t count,
                     v1::SegmentItem* item) {
  if (!query.stored_segments.empty()) {
    item->set_segments_f32(PackRows(query.stored_segments, 6, begin, count));
  } else if (query.origin.has_value()) {
    item->set_segments_f32(
        StoreSegments(query.segments.subspan(6 * begin, 6 * count), *query.origin));
  } else {
    item->set_segments(PackRows(query.segments, 6, begin, count));
  }
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
  const StreamOptions begun = Begun(options);
  return RunOnRevision(query.options.revision != 0, on_segments,
                       [&](const auto& deliver) { return RunSegments(query, begun, deliver); });
}

absl::StatusOr<StreamSummary> Client::RunSegments(
    const SegmentQuery& asked, const StreamOptions& options,
    const std::function<absl::Status(Segments)>& on_segments) const {
  if (absl::Status s = CheckSegmentQuery(asked); !s.ok()) return s;
  absl::StatusOr<QueryStart> start = StartQuery(*this, options);
  if (!start.ok()) return start.status();
  const absl::StatusOr<SegmentQuery> pinned = PinnedQuery(*this, asked, *start);
  if (!pinned.ok()) return shared_->Checked(pinned.status());
  const SegmentQuery& query = *pinned;
  // Of either source, what goes with an origin goes as floats.
  const uint64_t bytes_each = 6 * (query.origin.has_value() ? sizeof(float) : sizeof(double));
  const ItemCut cut =
      CutIntoItems(SegmentCount(query), query.segments_per_item, 1, bytes_each, start->limits);

  StreamJob<v1::TestSegmentsRequest, v1::TestSegmentsResponse> job;
  job.item_count = cut.items();
  *job.header.mutable_header() = SegmentsHeader(query, query.options.revision);
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
  return shared_->Checked(RunQuery(std::move(job), decode, on_segments, *start, options,
                                   shared_->connection->channel_count()));
}

absl::StatusOr<Segments> Client::TestAllSegments(
    const SegmentQuery& query, const StreamOptions& options,
    const std::function<void(uint64_t done)>& on_progress) const {
  Segments all;
  const uint64_t n = SegmentCount(query);
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
