// SPDX-License-Identifier: Apache-2.0
//
// VisibilityService.ComputeShadows: what its stream and its items are made of. See
// visibility_stream.h for the shape that the three methods share.
//
// Thread safety: constant once opened.
#ifndef SIGHTLINE_SERVER_STREAM_SHADOW_METHOD_H_
#define SIGHTLINE_SERVER_STREAM_SHADOW_METHOD_H_

#include <cstdint>
#include <memory>
#include <span>

#include "absl/status/statusor.h"
#include "core/query/points.h"
#include "core/query/shadows.h"
#include "server/codec/wire_request.h"
#include "server/metrics/metrics.h"
#include "server/stream/item_points.h"
#include "server/stream/item_work.h"
#include "server/stream/placement_pace.h"
#include "server/stream/query_environment.h"
#include "server/stream/stream_method.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline {

class ShadowMethod final : public StreamMethod {
 public:
  using Request = v1::ComputeShadowsRequest;
  using Response = v1::ComputeShadowsResponse;
  using Header = v1::ComputeShadowsHeader;
  // An item as it is read: its message, but for arrays that stay where they came.
  struct Item {
    v1::ShadowItem message;
    PointBytes points;  // Of v1::ShadowItem.points.
  };
  static constexpr Operation kOperation = Operation::kComputeShadows;

  static absl::StatusOr<std::unique_ptr<ShadowMethod>> Open(const Header& header,
                                                            const QueryEnvironment& env);

  static std::span<const WirePath> ArrayPaths();
  static absl::Status Read(grpc::ByteBuffer* bytes, const ElementLimit& elements, Request* request,
                           Item* item);

  uint64_t Rays(const Item& item) const;
  absl::StatusOr<std::unique_ptr<ItemWork>> Prepare(const Item& item, const CancelToken& cancel,
                                                    uint64_t part_rays) const;

 private:
  class ShadowWork;
  struct Plan;
  explicit ShadowMethod(const QueryEnvironment& env)
      : StreamMethod(env), placement_pace_(std::make_unique<PlacementPace>()) {}

  absl::StatusOr<std::unique_ptr<ItemPoints>> FindPoints(const Item& item,
                                                         const std::shared_ptr<const Scene>& scene,
                                                         const CancelToken& cancel) const;
  absl::StatusOr<Plan> MakePlan(const ItemPoints& points, uint64_t samples,
                                uint64_t part_rays) const;

  PointOptions point_options_;
  ShadowOptions shadow_options_;
  v1::ShadowOutputs outputs_;
  const std::unique_ptr<PlacementPace> placement_pace_;  // The one thing that changes.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_SHADOW_METHOD_H_
