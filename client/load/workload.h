// SPDX-License-Identifier: Apache-2.0
//
// What a load test asks: items prepared before the clock starts, sent again and again.
//
//   tiles      the tiles of the images of a few cameras along a path, each with its lights' shadows
//   points     ranges of points on the surfaces that those cameras see, lit by the same lights
//   segments   segments between such points, a few to an item: small queries, alone
//
// A stream of tiles belongs to one camera and a stream of points to one set of lights, as the wire
// has it: StreamOf says which stream an item goes to.
//
// Thread safety: immutable once made.
//
//   SL_ASSIGN_OR_RETURN(Workload workload, Workload::Make(spec, surface_points));
//   Work work = workload.Pick(17);
#ifndef SIGHTLINE_CLIENT_LOAD_WORKLOAD_H_
#define SIGHTLINE_CLIENT_LOAD_WORKLOAD_H_

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/lib/types.h"
#include "client/load/request.h"

namespace sightline::load {

// How often each kind is asked, as weights; 0: never.
using Mix = std::array<double, kKinds>;

// "tiles=5,points=3,segments=2". INVALID_ARGUMENT naming the part and what it may be.
absl::StatusOr<Mix> ParseMix(absl::string_view text);

struct WorkloadSpec {
  std::string scene;                    // "scenes/hall"
  std::vector<client::Camera> cameras;  // Along the path, at least one, all of one size.
  std::vector<client::Light> lights;    // At least one if points are asked about.
  Mix mix = {1, 0, 0};
  uint32_t tile_size = 64;
  uint32_t points_per_item = 1024;
  uint32_t segments_per_item = 1;
  uint32_t distinct_items = 256;  // Of points and of segments.
  uint64_t seed = 1;
};

// Points begin .. begin + count - 1, or segments.
struct ItemRange {
  uint64_t begin = 0, count = 0;
};

struct TileWork {
  size_t camera = 0;
  client::TileRect rect;
};

class Workload {
 public:
  // `surface`: points that the cameras see, [n, 3]. INVALID_ARGUMENT where nothing is seen, or no
  // kind has a weight.
  static absl::StatusOr<Workload> Make(const WorkloadSpec& spec, std::vector<double> surface);

  // The queries name arrays of the workload's own: it may move, and is not copied.
  Workload(Workload&&) = default;
  Workload& operator=(Workload&&) = default;

  // The work of request `number`: its kind by weight and seed, its item in turn.
  Work Pick(uint64_t number) const;
  size_t ItemCount(Kind kind) const;
  // Streams that a kind needs on each connection; 0 if it is never asked.
  size_t StreamCount(Kind kind) const;
  size_t StreamOf(const Work& work) const;
  // Which of `connections` a request goes to: they take turns, and turn by turn so that each gets
  // every item, were it only since a check of every eighth would else be one of every other
  // connection.
  size_t ConnectionOf(const Request& request, size_t connections) const;
  // What the item costs on the wire, in rays.
  uint64_t Rays(const Work& work) const;
  // "tile 3 of camera 1 (x 64, y 0)", for messages.
  std::string Describe(const Work& work) const;

  const Mix& mix() const { return mix_; }
  const std::vector<client::TileQuery>& tile_queries() const { return tile_queries_; }
  const client::ShadowQuery& shadow_query() const { return shadow_query_; }
  const client::SegmentQuery& segment_query() const { return segment_query_; }
  const TileWork& tile(size_t item) const { return tiles_[item]; }
  ItemRange points(size_t item) const { return RangeOf(item, shadow_query_.points_per_item); }
  ItemRange segments(size_t item) const { return RangeOf(item, segment_query_.segments_per_item); }

  // Asks about the points of a set that the server holds, the same points in the same order.
  void UsePointSet(std::string name) { shadow_query_.point_set = std::move(name); }

 private:
  Workload() = default;
  static ItemRange RangeOf(size_t item, uint32_t each) { return {uint64_t{item} * each, each}; }

  Mix mix_{};
  uint64_t seed_ = 1;
  size_t items_ = 0;  // Of points and of segments.
  std::vector<client::TileQuery> tile_queries_;
  std::vector<TileWork> tiles_;
  std::vector<double> points_, segments_;  // What the queries' spans are of.
  client::ShadowQuery shadow_query_;
  client::SegmentQuery segment_query_;
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_WORKLOAD_H_
