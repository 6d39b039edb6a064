// SPDX-License-Identifier: Apache-2.0
//
// VisibilityService.TestSegments: what its stream and its items are made of. See
// visibility_stream.h for the shape that the three methods share.
//
// Thread safety: constant once opened.
#ifndef SIGHTLINE_SERVER_STREAM_SEGMENT_METHOD_H_
#define SIGHTLINE_SERVER_STREAM_SEGMENT_METHOD_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/geometry/vec3.h"
#include "core/scene/scene.h"
#include "server/codec/wire_request.h"
#include "server/metrics/metrics.h"
#include "server/stream/item_work.h"
#include "server/stream/query_environment.h"
#include "server/stream/stream_method.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline {

class SegmentMethod final : public StreamMethod {
 public:
  using Request = v1::TestSegmentsRequest;
  using Response = v1::TestSegmentsResponse;
  using Header = v1::TestSegmentsHeader;
  // An item as it is read: its message, but for arrays that stay where they came.
  struct Item {
    v1::SegmentItem message;
    WireArray segments, stored_segments;  // Of the latter, v1::SegmentItem.segments_f32.
  };
  static constexpr Operation kOperation = Operation::kTestSegments;

  static absl::StatusOr<std::unique_ptr<SegmentMethod>> Open(const Header& header,
                                                             const QueryEnvironment& env);

  static std::span<const WirePath> ArrayPaths();
  static absl::Status Read(grpc::ByteBuffer* bytes, const ElementLimit& elements, Request* request,
                           Item* item);

  uint64_t Rays(const Item& item) const;
  absl::StatusOr<std::unique_ptr<ItemWork>> Prepare(Item&& item, const CancelToken& cancel,
                                                    uint64_t part_rays) const;

 private:
  template <typename End>
  class SegmentWork;
  explicit SegmentMethod(const QueryEnvironment& env) : StreamMethod(env) {}

  // Whether `stored_segments` are relative to the scene's origin.
  absl::Status CheckOrigin(const Scene& scene) const;

  v1::SegmentOutputs outputs_;
  std::optional<Vec3d> origin_;  // What the header says that they are relative to.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_SEGMENT_METHOD_H_
