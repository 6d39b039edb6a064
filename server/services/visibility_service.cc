// SPDX-License-Identifier: Apache-2.0
#include "server/services/visibility_service.h"

#include "server/stream/segment_method.h"
#include "server/stream/shadow_method.h"
#include "server/stream/tile_method.h"
#include "server/stream/visibility_stream.h"

namespace sightline {

VisibilityService::Reactor* VisibilityService::TraceTiles(grpc::CallbackServerContext* context) {
  return VisibilityStream<TileMethod>::Start(context, env_);
}

VisibilityService::Reactor* VisibilityService::ComputeShadows(
    grpc::CallbackServerContext* context) {
  return VisibilityStream<ShadowMethod>::Start(context, env_);
}

VisibilityService::Reactor* VisibilityService::TestSegments(grpc::CallbackServerContext* context) {
  return VisibilityStream<SegmentMethod>::Start(context, env_);
}

}  // namespace sightline
