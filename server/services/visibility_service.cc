// SPDX-License-Identifier: Apache-2.0
#include "server/services/visibility_service.h"

#include "server/stream/segment_method.h"
#include "server/stream/shadow_method.h"
#include "server/stream/tile_method.h"
#include "server/stream/visibility_stream.h"

namespace sightline {

grpc::ServerBidiReactor<v1::TraceTilesRequest, v1::TraceTilesResponse>*
VisibilityService::TraceTiles(grpc::CallbackServerContext* context) {
  return VisibilityStream<TileMethod>::Start(context, env_);
}

grpc::ServerBidiReactor<v1::ComputeShadowsRequest, v1::ComputeShadowsResponse>*
VisibilityService::ComputeShadows(grpc::CallbackServerContext* context) {
  return VisibilityStream<ShadowMethod>::Start(context, env_);
}

grpc::ServerBidiReactor<v1::TestSegmentsRequest, v1::TestSegmentsResponse>*
VisibilityService::TestSegments(grpc::CallbackServerContext* context) {
  return VisibilityStream<SegmentMethod>::Start(context, env_);
}

}  // namespace sightline
