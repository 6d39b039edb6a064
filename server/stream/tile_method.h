// SPDX-License-Identifier: Apache-2.0
//
// VisibilityService.TraceTiles: what its stream and its items are made of. See visibility_stream.h
// for the shape that the three methods share.
//
// Thread safety: every method from any thread; constant once opened but for the mirrors that are
// kept.
#ifndef SIGHTLINE_SERVER_STREAM_TILE_METHOD_H_
#define SIGHTLINE_SERVER_STREAM_TILE_METHOD_H_

#include <cstdint>
#include <memory>
#include <span>

#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/base/mutex.h"
#include "core/geometry/camera.h"
#include "core/query/mirrors.h"
#include "core/scene/scene.h"
#include "server/codec/wire_request.h"
#include "server/metrics/metrics.h"
#include "server/stream/item_work.h"
#include "server/stream/query_environment.h"
#include "server/stream/stream_method.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline {

class TileMethod final : public StreamMethod {
 public:
  using Request = v1::TraceTilesRequest;
  using Response = v1::TraceTilesResponse;
  using Header = v1::TraceTilesHeader;
  // An item as it is read.
  struct Item {
    v1::TileItem message;
  };
  static constexpr Operation kOperation = Operation::kTraceTiles;

  static absl::StatusOr<std::unique_ptr<TileMethod>> Open(const Header& header,
                                                          const QueryEnvironment& env);

  // The arrays of a request that may be large.
  static std::span<const WirePath> ArrayPaths() { return {}; }
  // Takes the bytes of a message; if it is an item, into `item`, else into `request`.
  // `elements`, and what is returned: as of ReadRequest (server/codec/wire_request.h). Cheap:
  // called in a reaction.
  static absl::Status Read(grpc::ByteBuffer* bytes, const ElementLimit& elements, Request* request,
                           Item* item);

  // What the item asks for, in rays; saturating. Cheap: called in a reaction.
  uint64_t Rays(const Item& item) const;
  absl::StatusOr<std::unique_ptr<ItemWork>> Prepare(const Item& item, const CancelToken& cancel,
                                                    uint64_t part_rays) const;

 private:
  class TileWork;
  explicit TileMethod(const QueryEnvironment& env) : StreamMethod(env) {}

  // Of an item's rows: so many that no part's border divides them. `bytes` as in CutIntoParts.
  template <typename Bytes>
  uint64_t RowsTogether(uint64_t width, const Bytes& bytes) const;
  // The header's mirrors in this revision. Kept for the items to come: an object's plane is looked
  // for among all of its triangles.
  absl::StatusOr<std::shared_ptr<const PreparedMirrors>> MirrorsFor(
      const std::shared_ptr<const Scene>& scene, const CancelToken& cancel) const;

  Camera camera_;
  google::protobuf::RepeatedPtrField<v1::Mirror> mirrors_;
  v1::TileOutputs outputs_;
  v1::ShadowOutputs shadow_outputs_;
  mutable Mutex mutex_;
  // What `prepared_mirrors_` are for.
  mutable std::weak_ptr<const Scene> mirrored_scene_ ABSL_GUARDED_BY(mutex_);
  mutable std::shared_ptr<const PreparedMirrors> prepared_mirrors_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_TILE_METHOD_H_
