// SPDX-License-Identifier: Apache-2.0
#include "client/load/server_target.h"

#include <algorithm>
#include <utility>

#include "client/lib/query_wire.h"
#include "core/base/status_macros.h"

namespace sightline::load {

using TileStream = ItemStream<v1::TraceTilesRequest, v1::TraceTilesResponse>;
using ShadowStream = ItemStream<v1::ComputeShadowsRequest, v1::ComputeShadowsResponse>;
using SegmentStream = ItemStream<v1::TestSegmentsRequest, v1::TestSegmentsResponse>;

absl::StatusOr<std::unique_ptr<ServerTarget>> ServerTarget::Open(
    client::Connection& connection, const Workload& workload, const Reference* reference,
    const ServerTargetOptions& options, Clock& clock, client::Cancellation* cancellation) {
  std::unique_ptr<ServerTarget> target(new ServerTarget(workload, reference));
  const LaneContext context = target->MakeContext(options, clock);
  for (int channel = 0; channel < connection.channel_count(); ++channel) {
    for (size_t camera = 0; camera < workload.StreamCount(Kind::kTiles); ++camera) {
      target->AddTileLane(connection, channel, camera, context);
    }
    if (workload.StreamCount(Kind::kPoints) > 0) {
      target->AddPointsLane(connection, channel, context);
    }
    if (workload.StreamCount(Kind::kSegments) > 0) {
      target->AddSegmentsLane(connection, channel, context);
    }
  }
  const client::Cancellation::Registration give_up(cancellation, [opening = target.get()] {
    for (const auto& lane : opening->all_) lane->Close();
  });
  for (const auto& lane : target->all_) SL_RETURN_IF_ERROR(lane->WaitUntilOpen());
  return target;
}

LaneContext ServerTarget::MakeContext(const ServerTargetOptions& options, Clock& clock) {
  return {.clock = &clock,
          .rays = [this](const Work& work) { return workload_.Rays(work); },
          .is_checked =
              [this](const Work& work) { return reference_ != nullptr && reference_->Knows(work); },
          .judge =
              [this](const Answer& answer, Outcome* outcome) {
                outcome->verdict = reference_->Judge(outcome->request.work, outcome->revision,
                                                     answer, &outcome->difference);
              },
          .describe = [this](const Work& work) { return workload_.Describe(work); },
          .on_done = [this](const Outcome& outcome) { on_done_(outcome); },
          .on_gone = [this] { gone_.store(true); },
          .item_timeout = options.item_timeout,
          .min_item_cost = options.limits.min_item_cost_rays,
          .retry = options.retry};
}

void ServerTarget::AddLane(Kind kind, int channel, std::unique_ptr<Lane> lane) {
  auto& connections = lanes_[static_cast<size_t>(kind)];
  connections.resize(static_cast<size_t>(channel) + 1);
  connections.back().push_back(lane.get());
  all_.push_back(std::move(lane));
}

// Revision 0 in every header: an item sees the scene as it is when it comes.

void ServerTarget::AddTileLane(client::Connection& connection, int channel, size_t camera,
                               const LaneContext& context) {
  TileStream::Wiring wiring;
  wiring.open = [&connection, channel](const client::CallOptions& call) {
    return connection.OpenTiles(channel, call);
  };
  *wiring.header.mutable_header() = client::TilesHeader(workload_.tile_queries()[camera], 0);
  wiring.make_item = [this](const Work& work) {
    v1::TraceTilesRequest message;
    client::FillTileItem(workload_.tile(work.item).rect, message.mutable_item());
    return message;
  };
  wiring.decode = [this](const Work& work,
                         std::vector<v1::TileReply> replies) -> absl::StatusOr<Answer> {
    const TileWork& tile = workload_.tile(work.item);
    SL_ASSIGN_OR_RETURN(client::Tile answer,
                        client::DecodeTile(workload_.tile_queries()[tile.camera], work.item,
                                           tile.rect, std::move(replies)));
    return ToAnswer(std::move(answer));
  };
  AddLane(Kind::kTiles, channel, std::make_unique<TileStream>(std::move(wiring), context));
}

void ServerTarget::AddPointsLane(client::Connection& connection, int channel,
                                 const LaneContext& context) {
  ShadowStream::Wiring wiring;
  wiring.open = [&connection, channel](const client::CallOptions& call) {
    return connection.OpenShadows(channel, call);
  };
  *wiring.header.mutable_header() = client::ShadowsHeader(workload_.shadow_query(), 0);
  wiring.make_item = [this](const Work& work) {
    v1::ComputeShadowsRequest message;
    const ItemRange range = workload_.points(work.item);
    client::FillShadowItem(workload_.shadow_query(), range.begin, range.count,
                           message.mutable_item());
    return message;
  };
  wiring.decode = [this](const Work& work,
                         std::vector<v1::ShadowReply> replies) -> absl::StatusOr<Answer> {
    const ItemRange range = workload_.points(work.item);
    SL_ASSIGN_OR_RETURN(client::Shadows answer,
                        client::DecodeShadows(workload_.shadow_query(), range.begin, range.count,
                                              std::move(replies)));
    return ToAnswer(std::move(answer));
  };
  AddLane(Kind::kPoints, channel, std::make_unique<ShadowStream>(std::move(wiring), context));
}

void ServerTarget::AddSegmentsLane(client::Connection& connection, int channel,
                                   const LaneContext& context) {
  SegmentStream::Wiring wiring;
  wiring.open = [&connection, channel](const client::CallOptions& call) {
    return connection.OpenSegments(channel, call);
  };
  *wiring.header.mutable_header() = client::SegmentsHeader(workload_.segment_query(), 0);
  wiring.make_item = [this](const Work& work) {
    v1::TestSegmentsRequest message;
    const ItemRange range = workload_.segments(work.item);
    client::FillSegmentItem(workload_.segment_query(), range.begin, range.count,
                            message.mutable_item());
    return message;
  };
  wiring.decode = [this](const Work& work,
                         std::vector<v1::SegmentReply> replies) -> absl::StatusOr<Answer> {
    const ItemRange range = workload_.segments(work.item);
    SL_ASSIGN_OR_RETURN(client::Segments answer,
                        client::DecodeSegments(workload_.segment_query(), range.begin, range.count,
                                               std::move(replies)));
    return ToAnswer(std::move(answer));
  };
  AddLane(Kind::kSegments, channel, std::make_unique<SegmentStream>(std::move(wiring), context));
}

void ServerTarget::Send(const Request& request) {
  const auto& connections = lanes_[static_cast<size_t>(request.work.kind)];
  const size_t connection = workload_.ConnectionOf(request, connections.size());
  connections[connection][workload_.StreamOf(request.work)]->Send(request);
}

void ServerTarget::CancelAll() {
  for (const auto& lane : all_) lane->CancelAll();
}

absl::Status ServerTarget::status() const {
  // Asked at every answer: the lanes' locks are left alone while all is well.
  if (!gone_.load()) return absl::OkStatus();
  for (const auto& lane : all_) SL_RETURN_IF_ERROR(lane->status());
  return absl::OkStatus();
}

}  // namespace sightline::load
