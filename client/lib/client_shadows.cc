// SPDX-License-Identifier: Apache-2.0
//
// Shadows of points: cut, run, decode, put together.
#include <algorithm>
#include <limits>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/lib/client.h"
#include "client/lib/client_state.h"
#include "client/lib/convert.h"
#include "client/lib/point_curve.h"
#include "client/lib/query_run.h"
#include "client/lib/query_support.h"
#include "client/lib/query_wire.h"
#include "client/lib/stream_runner.h"
#include "client/lib/upload.h"

namespace sightline::client {

namespace {

void ResizeShadows(const ShadowOutputs& want, uint64_t n, Shadows* out) {
  const uint64_t pairs = out->samples * n;
  out->points = n;
  if (want.lit) out->lit.resize(pairs);
  out->valid.resize(n);
  if (want.counts) out->counts.resize(n);
  if (want.weighted_sums) out->weighted_sums.resize(n);
  if (want.blockers) ResizeBlockers(pairs, out);
  if (want.answered_by) out->answered_by.resize(pairs);
}

}  // namespace

v1::ComputeShadowsHeader ShadowsHeader(const ShadowQuery& query, int64_t revision) {
  v1::ComputeShadowsHeader header;
  FillHeader(query.scene, revision, query.options, header.mutable_stream());
  for (const Light& light : query.lights) ToProto(light, header.add_lights());
  ToProto(query.point_options, header.mutable_point_options());
  header.set_t_min(query.t_min);
  header.mutable_outputs()->set_lit_bits(query.outputs.lit);
  header.mutable_outputs()->set_lit_counts(query.outputs.counts);
  header.mutable_outputs()->set_weighted_sums(query.outputs.weighted_sums);
  header.mutable_outputs()->set_first_blockers(query.outputs.blockers);
  header.mutable_outputs()->set_answered_by(query.outputs.answered_by);
  return header;
}

void FillShadowItem(const ShadowQuery& query, uint64_t begin, uint64_t count,
                    v1::ShadowItem* item) {
  if (query.point_set.empty()) {
    PackPoints(query.points, begin, count, item->mutable_points());
    return;
  }
  item->mutable_point_set_range()->set_point_set(query.point_set);
  item->mutable_point_set_range()->set_offset(begin);
  item->mutable_point_set_range()->set_count(count);
}

absl::StatusOr<Shadows> DecodeShadows(const ShadowQuery& query, uint64_t begin, uint64_t n,
                                      std::vector<v1::ShadowReply> replies) {
  const ShadowOutputs& want = query.outputs;
  const uint64_t samples = TotalSamples(query.lights);
  Shadows out;
  out.offset = begin;
  out.samples = static_cast<uint32_t>(samples);
  ResizeShadows(want, n, &out);
  const absl::Status status = DecodeReplies(
      std::move(replies), n, &out.statistics,
      [&](const v1::ShadowReply& reply, uint64_t at, uint64_t count) -> absl::Status {
        const v1::ShadowResult& r = reply.shadows();
        out.near_surface_points += r.near_surface_point_count();
        absl::Status s;
        if (want.lit) {
          s.Update(DecodeLit(r, samples, at, count, n, &out.lit, &out.valid));
        } else {
          s.Update(DecodeValid(r.valid_bits(), at, count, &out.valid));
        }
        out.invalid_samples.assign(r.invalid_samples().begin(), r.invalid_samples().end());
        if (want.counts) {
          s.Update(DecodeRows(r.lit_counts(), "lit_counts", 1, at, count, n, &out.counts));
        }
        if (want.weighted_sums) {
          s.Update(
              DecodeRows(r.weighted_sums(), "weighted_sums", 1, at, count, n, &out.weighted_sums));
        }
        if (want.blockers) s.Update(DecodeBlockers(r, samples, at, count, n, &out));
        if (want.answered_by) {
          s.Update(
              DecodeRows(r.answered_by(), "answered_by", samples, at, count, n, &out.answered_by));
        }
        return s;
      });
  if (!status.ok()) return status;
  return out;
}

absl::StatusOr<StreamSummary> Client::ComputeShadows(
    const ShadowQuery& query, const std::function<absl::Status(Shadows)>& on_shadows,
    const StreamOptions& options) const {
  uint64_t points = 0;
  return RunShadows(query, options, on_shadows, &points);
}

absl::StatusOr<StreamSummary> Client::RunShadows(
    const ShadowQuery& query, const StreamOptions& options,
    const std::function<absl::Status(Shadows)>& on_shadows, uint64_t* points) const {
  const StreamOptions begun = Begun(options);
  const auto run = [&](const std::function<absl::Status(Shadows)>& deliver) {
    return RunShadowsOnce(query, begun, deliver, points);
  };
  // A point set has the revision that it was made for.
  const bool named = query.options.revision != 0 || !query.point_set.empty();
  return RunOnRevision(named, on_shadows, run);
}

absl::StatusOr<StreamSummary> Client::RunShadowsOnce(
    const ShadowQuery& query, const StreamOptions& options,
    const std::function<absl::Status(Shadows)>& on_shadows, uint64_t* points) const {
  if (absl::Status s = CheckPoints(query.points); !s.ok()) return s;
  if (query.points_per_item == 0) return absl::InvalidArgumentError("points_per_item is 0");
  if (query.lights.empty()) return absl::InvalidArgumentError("lights: at least one is needed");
  absl::StatusOr<QueryStart> start = StartQuery(*this, options);
  if (!start.ok()) return start.status();
  if (absl::Status s = CheckLights(query.lights, start->limits); !s.ok()) {
    return shared_->Checked(s);
  }
  const uint64_t samples = TotalSamples(query.lights);
  uint64_t n = query.points.positions.size() / 3;
  int64_t revision = query.options.revision;
  if (!query.point_set.empty()) {
    absl::StatusOr<PointSet> set = GetPointSet(query.point_set, start->call);
    if (!set.ok()) return shared_->Checked(set.status());
    n = set->points;
    if (revision == 0) revision = set->revision;
  } else {
    absl::StatusOr<int64_t> pinned = PinnedRevision(query.scene, revision, start->call);
    if (!pinned.ok()) return shared_->Checked(pinned.status());
    revision = *pinned;
  }
  *points = n;
  const uint64_t bytes_each = query.point_set.empty() ? BytesPerPoint(query.points) : 0;
  const ItemCut cut = CutIntoItems(n, query.points_per_item, samples, bytes_each, start->limits);

  StreamJob<v1::ComputeShadowsRequest, v1::ComputeShadowsResponse> job;
  job.item_count = cut.items();
  *job.header.mutable_header() = ShadowsHeader(query, revision);
  job.open = [this](int lane, const CallOptions& stream_call) {
    return shared_->connection->OpenShadows(lane, stream_call);
  };
  job.make_item = [&](size_t i) {
    v1::ComputeShadowsRequest request;
    v1::ShadowItem* item = request.mutable_item();
    FillItem(i, options, item->mutable_item());
    FillShadowItem(query, cut.begin(i), cut.count(i), item);
    return request;
  };
  job.cost = [&](size_t i) { return static_cast<int64_t>(cut.count(i) * samples); };
  const auto decode = [&](size_t i, std::vector<v1::ShadowReply> replies) {
    return DecodeShadows(query, cut.begin(i), cut.count(i), std::move(replies));
  };
  return shared_->Checked(RunQuery(std::move(job), decode, on_shadows, *start, options,
                                   shared_->connection->channel_count()));
}

absl::StatusOr<Shadows> Client::ComputeAllShadows(
    const ShadowQuery& query, const StreamOptions& options,
    const std::function<void(uint64_t done)>& on_progress) const {
  const StreamOptions begun = Begun(options);
  Shadows all;
  all.samples = static_cast<uint32_t>(TotalSamples(query.lights));
  uint64_t n = query.points.positions.size() / 3;  // Of a set: what the server says.
  // Fewer are an item or two, which the server puts in order itself.
  constexpr uint64_t kLeastOrdered = 1 << 14;
  constexpr uint64_t kLeastSamples = 4;
  std::optional<PointCurve> curve;
  ShadowQuery sent = query;
  if (query.point_set.empty() && n >= kLeastOrdered && all.samples >= kLeastSamples &&
      n <= std::numeric_limits<uint32_t>::max()) {
    if (absl::Status s = CheckPoints(query.points); !s.ok()) return s;
    curve.emplace(query.points);
    sent.points = curve->points();
  }
  bool sized = false;
  const absl::Status status = CollectParts<Shadows>(
      [&](const auto& on_part) { return RunShadows(sent, begun, on_part, &n); },
      [&](const Shadows& part) {
        // Not before the first answer: until then the sizes may be absurd.
        if (!std::exchange(sized, true)) ResizeShadows(query.outputs, n, &all);
        const auto place = [&](const auto& rows, uint64_t row_count, auto* out) {
          if (!curve.has_value()) return Place(rows, row_count, part.offset, n, out);
          for (size_t k = 0; k < rows.size(); ++k) {
            const uint64_t row = k / part.points, column = k % part.points;
            (*out)[row * n + curve->index(part.offset + column)] = rows[k];
          }
        };
        place(part.lit, all.samples, &all.lit);
        place(part.valid, 1, &all.valid);
        all.invalid_samples = part.invalid_samples;
        place(part.counts, 1, &all.counts);
        place(part.weighted_sums, 1, &all.weighted_sums);
        place(part.blocker_object, all.samples, &all.blocker_object);
        place(part.blocker_triangle, all.samples, &all.blocker_triangle);
        place(part.blocker_distance, all.samples, &all.blocker_distance);
        place(part.answered_by, all.samples, &all.answered_by);
        all.near_surface_points += part.near_surface_points;
        return part.points;
      },
      on_progress, &all.summary);
  if (!status.ok()) return status;
  all.statistics = all.summary.statistics;
  return all;
}

}  // namespace sightline::client
