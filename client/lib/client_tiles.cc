// SPDX-License-Identifier: Apache-2.0
//
// Camera tiles: cut, run, decode, put together.
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

namespace sightline::client {

namespace {

// Of a Tile or a TileImage.
template <typename Pixels>
void ResizePixels(const TileOutputs& want, uint64_t samples, uint64_t n, Pixels* out) {
  if (want.hits) out->hit.resize(n);
  if (want.ids) out->object.resize(n), out->triangle.resize(n);
  if (want.depths) out->depth.resize(n);
  if (want.barycentrics) out->u.resize(n), out->v.resize(n);
  if (want.lit) out->lit.resize(samples * n);
  if (want.answered_by) out->answered_by.resize(n);
  if (want.lit && want.lit_answered_by) out->lit_answered_by.resize(samples * n);
  if (want.mirrors) out->mirror.resize(n);
}

absl::Status CheckImage(const TileQuery& query, const Limits& limits) {
  const Camera& camera = query.camera;
  if (camera.width == 0 || camera.height == 0) {
    return absl::InvalidArgumentError(absl::StrCat("camera.width × height is ", camera.width, " × ",
                                                   camera.height, "; both must be above 0"));
  }
  if (camera.width > limits.max_image_width || camera.height > limits.max_image_height) {
    return absl::ResourceExhaustedError(absl::StrCat(
        "the image has ", camera.width, " × ", camera.height,
        " pixels; max_image_width × max_image_height is ", limits.max_image_width, " × ",
        limits.max_image_height, ": ask for a smaller image, or for several cameras' images"));
  }
  if (query.tile_size == 0) return absl::InvalidArgumentError("tile_size is 0");
  return absl::OkStatus();
}

}  // namespace

v1::TraceTilesHeader TilesHeader(const TileQuery& query, int64_t revision) {
  v1::TraceTilesHeader header;
  FillHeader(query.scene, revision, query.options, header.mutable_stream());
  ToProto(query.camera, header.mutable_camera());
  if (query.outputs.lit) {
    for (const Light& light : query.lights) ToProto(light, header.add_lights());
    header.mutable_shadow_outputs()->set_lit_bits(true);
    header.mutable_shadow_outputs()->set_answered_by(query.outputs.lit_answered_by);
  }
  v1::TileOutputs* outputs = header.mutable_outputs();
  outputs->set_hit_bits(query.outputs.hits);
  outputs->set_object_ids(query.outputs.ids);
  outputs->set_triangle_ids(query.outputs.ids);
  outputs->set_depths(query.outputs.depths);
  outputs->set_barycentrics(query.outputs.barycentrics);
  outputs->set_answered_by(query.outputs.answered_by);
  outputs->set_mirror_bits(query.outputs.mirrors);
  for (const Mirror& mirror : query.mirrors) {
    v1::Mirror* out = header.add_mirrors();
    out->set_object_name(mirror.object);
    if (!mirror.plane.has_value()) continue;
    ToProto(mirror.plane->point, out->mutable_plane()->mutable_point());
    ToProto(mirror.plane->normal, out->mutable_plane()->mutable_normal());
  }
  return header;
}

void FillTileItem(const TileRect& rect, v1::TileItem* item) {
  item->set_x(rect.x);
  item->set_y(rect.y);
  item->set_width(rect.width);
  item->set_height(rect.height);
}

absl::StatusOr<Tile> DecodeTile(const TileQuery& query, size_t index, const TileRect& rect,
                                std::vector<v1::TileReply> replies) {
  Tile tile{.index = index, .rect = rect};
  const uint64_t samples = query.outputs.lit ? TotalSamples(query.lights) : 0;
  const uint64_t n = uint64_t{tile.rect.width} * tile.rect.height;
  const TileOutputs& want = query.outputs;
  ResizePixels(want, samples, n, &tile);
  std::vector<uint8_t> valid(want.lit ? n : 0);
  const absl::Status status = DecodeReplies(
      std::move(replies), n, &tile.statistics,
      [&](const v1::TileReply& reply, uint64_t at, uint64_t count) -> absl::Status {
        const v1::TileResult& r = reply.tile();
        absl::Status s;
        if (want.hits) {
          s.Update(DecodeBits(r.hit_bits(), "hit_bits", 1, at, count, n, &tile.hit));
        }
        if (want.ids) {
          s.Update(DecodeRows(r.object_ids(), "object_ids", 1, at, count, n, &tile.object));
          s.Update(DecodeRows(r.triangle_ids(), "triangle_ids", 1, at, count, n, &tile.triangle));
        }
        if (want.depths) s.Update(DecodeRows(r.depths(), "depths", 1, at, count, n, &tile.depth));
        if (want.barycentrics) {
          s.Update(DecodeRows(r.barycentric_u(), "barycentric_u", 1, at, count, n, &tile.u));
          s.Update(DecodeRows(r.barycentric_v(), "barycentric_v", 1, at, count, n, &tile.v));
        }
        if (want.answered_by) {
          s.Update(DecodeRows(r.answered_by(), "answered_by", 1, at, count, n, &tile.answered_by));
        }
        if (want.mirrors) {
          s.Update(DecodeBits(r.mirror_bits(), "mirror_bits", 1, at, count, n, &tile.mirror));
        }
        if (want.lit && samples > 0) {
          s.Update(DecodeLit(reply.shadows(), samples, at, count, n, &tile.lit, &valid));
          if (want.lit_answered_by) {
            s.Update(DecodeRows(reply.shadows().answered_by(), "answered_by", samples, at, count, n,
                                &tile.lit_answered_by));
          }
        }
        return s;
      });
  if (!status.ok()) return status;
  return tile;
}

absl::StatusOr<StreamSummary> Client::TraceTiles(const TileQuery& query,
                                                 const std::function<absl::Status(Tile)>& on_tile,
                                                 const StreamOptions& options) const {
  const StreamOptions begun = Begun(options);
  return RunOnRevision(query.options.revision != 0, on_tile,
                       [&](const auto& deliver) { return RunTiles(query, begun, deliver); });
}

absl::StatusOr<StreamSummary> Client::RunTiles(
    const TileQuery& query, const StreamOptions& options,
    const std::function<absl::Status(Tile)>& on_tile) const {
  absl::StatusOr<QueryStart> start = StartQuery(*this, options);
  if (!start.ok()) return start.status();
  const Limits& limits = start->limits;
  absl::Status allowed = CheckImage(query, limits);
  allowed.Update(CheckLights(query.lights, limits));
  if (!allowed.ok()) return shared_->Checked(allowed);
  absl::StatusOr<int64_t> revision =
      PinnedRevision(query.scene, query.options.revision, start->call);
  if (!revision.ok()) return shared_->Checked(revision.status());

  const uint64_t samples = query.outputs.lit ? TotalSamples(query.lights) : 0;
  const uint64_t rays_per_pixel = 1 + samples;
  uint32_t side = std::min(query.tile_size, std::max(query.camera.width, query.camera.height));
  while (side > 1 && uint64_t{side} * side * rays_per_pixel > MaxItemRays(limits)) {
    side = (side + 1) / 2;
  }
  const uint32_t columns = (query.camera.width + side - 1) / side;
  const uint32_t rows = (query.camera.height + side - 1) / side;
  const auto rect = [&](size_t i) {
    TileRect r{.x = static_cast<uint32_t>(i % columns) * side,
               .y = static_cast<uint32_t>(i / columns) * side};
    r.width = std::min(side, query.camera.width - r.x);
    r.height = std::min(side, query.camera.height - r.y);
    return r;
  };

  StreamJob<v1::TraceTilesRequest, v1::TraceTilesResponse> job;
  job.item_count = size_t{columns} * rows;
  *job.header.mutable_header() = TilesHeader(query, *revision);
  job.open = [this](int lane, const CallOptions& stream_call) {
    return shared_->connection->OpenTiles(lane, stream_call);
  };
  job.make_item = [&](size_t i) {
    v1::TraceTilesRequest request;
    v1::TileItem* item = request.mutable_item();
    FillItem(i, options, item->mutable_item());
    FillTileItem(rect(i), item);
    return request;
  };
  job.cost = [&](size_t i) {
    const TileRect r = rect(i);
    return static_cast<int64_t>(uint64_t{r.width} * r.height * rays_per_pixel);
  };
  const auto decode = [&](size_t i, std::vector<v1::TileReply> replies) {
    return DecodeTile(query, i, rect(i), std::move(replies));
  };
  return shared_->Checked(RunQuery(std::move(job), decode, on_tile, *start, options,
                                   shared_->connection->channel_count()));
}

absl::StatusOr<TileImage> Client::TraceImage(
    const TileQuery& query, const StreamOptions& options,
    const std::function<void(uint64_t done)>& on_progress) const {
  TileImage image;
  image.width = query.camera.width;
  image.height = query.camera.height;
  image.samples = query.outputs.lit ? static_cast<uint32_t>(TotalSamples(query.lights)) : 0;
  const uint64_t n = uint64_t{image.width} * image.height;
  bool sized = false;
  const auto place = [&](const Tile& tile) {
    // Not before the first answer: until then the sizes may be absurd.
    if (!std::exchange(sized, true)) ResizePixels(query.outputs, image.samples, n, &image);
    const TileRect& r = tile.rect;
    const auto copy = [&](const auto& from, auto* to, uint64_t planes) {
      if (from.empty()) return;
      for (uint64_t p = 0; p < planes; ++p) {
        for (uint64_t y = 0; y < r.height; ++y) {
          std::copy_n(from.begin() + static_cast<ptrdiff_t>((p * r.height + y) * r.width), r.width,
                      to->begin() + static_cast<ptrdiff_t>(p * n + (r.y + y) * image.width + r.x));
        }
      }
    };
    copy(tile.hit, &image.hit, 1);
    copy(tile.object, &image.object, 1);
    copy(tile.triangle, &image.triangle, 1);
    copy(tile.depth, &image.depth, 1);
    copy(tile.u, &image.u, 1);
    copy(tile.v, &image.v, 1);
    copy(tile.lit, &image.lit, image.samples);
    copy(tile.answered_by, &image.answered_by, 1);
    copy(tile.lit_answered_by, &image.lit_answered_by, image.samples);
    copy(tile.mirror, &image.mirror, 1);
    if (query.options.statistics) {
      if (image.costs.size() <= tile.index) image.costs.resize(tile.index + 1);
      image.costs[tile.index] = {r, tile.statistics};
    }
    return uint64_t{r.width} * r.height;
  };
  const absl::Status status =
      CollectParts<Tile>([&](const auto& on_part) { return TraceTiles(query, on_part, options); },
                         place, on_progress, &image.summary);
  if (!status.ok()) return status;
  return image;
}

}  // namespace sightline::client
