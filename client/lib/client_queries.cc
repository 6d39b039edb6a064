// SPDX-License-Identifier: Apache-2.0
//
// The streamed queries: cut, run, decode, put together.
#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/lib/client.h"
#include "client/lib/client_state.h"
#include "client/lib/convert.h"
#include "client/lib/stream_runner.h"
#include "client/lib/upload.h"

namespace sightline::client {
namespace {

constexpr uint8_t kInvalid = 255;

uint64_t TotalSamples(const std::vector<Light>& lights) {
  uint64_t samples = 0;
  for (const Light& light : lights) samples += light.SampleCount();
  return samples;
}

void FillItem(size_t id, const StreamOptions& options, v1::ItemHeader* item) {
  item->set_item_id(id);
  if (options.item_timeout > absl::ZeroDuration()) {
    ToProto(options.item_timeout, item->mutable_timeout());
  }
}

void FillHeader(const std::string& scene, int64_t revision, const QueryOptions& options,
                v1::StreamHeader* header) {
  header->set_scene(scene);
  header->set_revision(revision);
  ToProto(options, header->mutable_options());
}

RunOptions ToRunOptions(const StreamOptions& options, const Limits& limits, int channels,
                        size_t items, absl::Time start) {
  RunOptions run;
  const int lanes = options.streams > 0 ? options.streams : channels;
  run.lanes = static_cast<int>(std::clamp<size_t>(items, 1, static_cast<size_t>(lanes)));
  run.min_item_cost = limits.min_item_cost_rays;
  run.deadline = start + options.timeout;
  run.cancellation = options.cancellation;
  run.retry = options.retry;
  return run;
}

// Hands the replies of an item to `decode` in order of offset; together they must hold each of the
// `count` elements once.
template <typename Reply, typename Decode>
absl::Status DecodeReplies(std::vector<Reply> replies, uint64_t count, Statistics* statistics,
                           const Decode& decode) {
  std::sort(replies.begin(), replies.end(), [](const Reply& a, const Reply& b) {
    return a.header().offset() < b.header().offset();
  });
  uint64_t done = 0;
  for (const Reply& reply : replies) {
    const v1::ReplyHeader& header = reply.header();
    if (header.offset() != done || header.element_count() > count - done) {
      return absl::InternalError(absl::StrCat("the server's reply holds ", header.element_count(),
                                              " elements from ", header.offset(), " on where ",
                                              count - done, " from ", done, " on are due"));
    }
    if (absl::Status s = decode(reply, done, header.element_count()); !s.ok()) return s;
    done += header.element_count();
    if (header.has_statistics()) *statistics = FromProto(header.statistics());
  }
  if (done == count) return absl::OkStatus();
  return absl::InternalError(
      absl::StrCat("the server answered ", done, " of ", count, " elements of an item"));
}

// Bits [rows, count] into columns begin .. of [rows, total], as 1 or 0.
absl::Status DecodeBits(absl::string_view bits, absl::string_view field, uint64_t rows,
                        uint64_t begin, uint64_t count, uint64_t total, std::vector<uint8_t>* out) {
  const BitRows bit(bits, count);
  if (absl::Status s = bit.Check(rows, field); !s.ok()) return s;
  for (uint64_t r = 0; r < rows; ++r) {
    for (uint64_t i = 0; i < count; ++i) (*out)[r * total + begin + i] = bit(r, i) ? 1 : 0;
  }
  return absl::OkStatus();
}

// Bits [count], or none for "all of them", into elements begin ...
absl::Status DecodeValid(absl::string_view bits, uint64_t begin, uint64_t count,
                         std::vector<uint8_t>* out) {
  if (!bits.empty()) return DecodeBits(bits, "valid_bits", 1, begin, count, out->size(), out);
  std::fill_n(out->begin() + static_cast<ptrdiff_t>(begin), count, uint8_t{1});
  return absl::OkStatus();
}

// Lit bits with what is not valid set to kInvalid. `valid` receives the points' own validity.
absl::Status DecodeLit(const v1::ShadowResult& result, uint64_t samples, uint64_t begin,
                       uint64_t count, uint64_t total, std::vector<uint8_t>* lit,
                       std::vector<uint8_t>* valid) {
  absl::Status s =
      DecodeBits(result.lit_bits(), "lit_bits", samples, begin, count, total, lit);
  s.Update(DecodeValid(result.valid_bits(), begin, count, valid));
  if (!s.ok()) return s;
  for (uint64_t r = 0; r < samples; ++r) {
    for (uint64_t i = begin; i < begin + count; ++i) {
      if ((*valid)[i] == 0) (*lit)[r * total + i] = kInvalid;
    }
  }
  for (uint32_t r : result.invalid_samples()) {
    if (r >= samples) {
      return absl::InternalError(absl::StrCat("the server's reply names sample ", r, " of ", samples));
    }
    std::fill_n(lit->begin() + static_cast<ptrdiff_t>(r * total + begin), count, kInvalid);
  }
  return absl::OkStatus();
}

// [rows, count] numbers into columns begin .. of [rows, total].
template <typename T>
absl::Status DecodeRows(absl::string_view bytes, absl::string_view field, uint64_t rows,
                        uint64_t begin, uint64_t count, uint64_t total, std::vector<T>* out) {
  if (bytes.size() != rows * count * sizeof(T)) {
    return Unpack<T>(bytes, rows * count, field, nullptr);
  }
  for (uint64_t r = 0; r < rows; ++r) {
    const absl::Status s = Unpack<T>(bytes.substr(r * count * sizeof(T), count * sizeof(T)), count,
                                     field, out->data() + r * total + begin);
    if (!s.ok()) return s;
  }
  return absl::OkStatus();
}

// Copies columns of a part, [rows, part], into [rows, total] at `begin`.
template <typename T>
void Place(const std::vector<T>& part, uint64_t rows, uint64_t begin, uint64_t total,
           std::vector<T>* out) {
  if (part.empty()) return;
  const uint64_t columns = part.size() / rows;
  for (uint64_t r = 0; r < rows; ++r) {
    std::copy_n(part.begin() + static_cast<ptrdiff_t>(r * columns), columns,
                out->begin() + static_cast<ptrdiff_t>(r * total + begin));
  }
}

absl::Status CheckLights(const std::vector<Light>& lights, const Limits& limits) {
  const uint64_t samples = TotalSamples(lights);
  if (limits.max_light_samples != 0 && samples > limits.max_light_samples) {
    return absl::ResourceExhaustedError(absl::StrCat("the lights have ", samples,
                                                     " samples; max_light_samples is ",
                                                     limits.max_light_samples));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<int64_t> Client::PinnedRevision(const std::string& scene, int64_t revision,
                                               const CallOptions& options) const {
  if (revision != 0) return revision;
  absl::StatusOr<Scene> current = GetScene(scene, options);
  if (!current.ok()) return current.status();
  // A scene without a revision is not ready; the stream says so better than we could.
  return current->revision;
}

// ---- Tiles --------------------------------------------------------------------------------------

namespace {

absl::StatusOr<Tile> DecodeTile(const TileQuery& query, uint64_t samples,
                                std::vector<v1::TileReply> replies, Tile tile) {
  const uint64_t n = uint64_t{tile.rect.width} * tile.rect.height;
  const TileOutputs& want = query.outputs;
  if (want.hits) tile.hit.resize(n);
  if (want.ids) tile.object.resize(n), tile.triangle.resize(n);
  if (want.depths) tile.depth.resize(n);
  if (want.barycentrics) tile.u.resize(n), tile.v.resize(n);
  if (want.lit) tile.lit.resize(samples * n);
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
        if (want.lit && samples > 0) {
          s.Update(DecodeLit(reply.shadows(), samples, at, count, n, &tile.lit, &valid));
        }
        return s;
      });
  if (!status.ok()) return status;
  return tile;
}

absl::Status CheckImage(const TileQuery& query, const Limits& limits) {
  const Camera& camera = query.camera;
  if (camera.width == 0 || camera.height == 0) {
    return absl::InvalidArgumentError(absl::StrCat("camera.width × height is ", camera.width, " × ",
                                                   camera.height, "; both must be above 0"));
  }
  if (camera.width > limits.max_image_width || camera.height > limits.max_image_height) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the image has ", camera.width, " × ", camera.height,
                     " pixels; max_image_width × max_image_height is ", limits.max_image_width,
                     " × ", limits.max_image_height));
  }
  if (query.tile_size == 0) return absl::InvalidArgumentError("tile_size is 0");
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<StreamSummary> Client::TraceTiles(const TileQuery& query,
                                                 const std::function<absl::Status(Tile)>& on_tile,
                                                 const StreamOptions& options) const {
  const absl::Time start = absl::Now();
  const CallOptions call{.deadline = start + options.timeout, .cancellation = options.cancellation};
  absl::StatusOr<Capabilities> capabilities = GetCapabilities(call);
  if (!capabilities.ok()) return capabilities.status();
  const Limits& limits = capabilities->limits;
  if (absl::Status s = CheckImage(query, limits); !s.ok()) return s;
  if (absl::Status s = CheckLights(query.lights, limits); !s.ok()) return s;
  absl::StatusOr<int64_t> revision = PinnedRevision(query.scene, query.options.revision, call);
  if (!revision.ok()) return revision.status();

  const uint64_t samples = query.outputs.lit ? TotalSamples(query.lights) : 0;
  const uint64_t rays_per_pixel = 1 + samples;
  uint32_t side = std::min(query.tile_size, std::max(query.camera.width, query.camera.height));
  while (side > 1 && uint64_t{side} * side * rays_per_pixel >
                         static_cast<uint64_t>(std::max<int64_t>(1, limits.max_item_rays))) {
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
  v1::TraceTilesHeader* header = job.header.mutable_header();
  FillHeader(query.scene, *revision, query.options, header->mutable_stream());
  ToProto(query.camera, header->mutable_camera());
  if (query.outputs.lit) {
    for (const Light& light : query.lights) ToProto(light, header->add_lights());
    header->mutable_shadow_outputs()->set_lit_bits(true);
  }
  v1::TileOutputs* outputs = header->mutable_outputs();
  outputs->set_hit_bits(query.outputs.hits);
  outputs->set_object_ids(query.outputs.ids);
  outputs->set_triangle_ids(query.outputs.ids);
  outputs->set_depths(query.outputs.depths);
  outputs->set_barycentrics(query.outputs.barycentrics);
  job.open = [this](int lane, const CallOptions& stream_call) {
    return shared_->connection->OpenTiles(lane, stream_call);
  };
  job.make_item = [&](size_t i) {
    v1::TraceTilesRequest request;
    v1::TileItem* item = request.mutable_item();
    FillItem(i, options, item->mutable_item());
    const TileRect r = rect(i);
    item->set_x(r.x);
    item->set_y(r.y);
    item->set_width(r.width);
    item->set_height(r.height);
    return request;
  };
  job.cost = [&](size_t i) {
    const TileRect r = rect(i);
    return static_cast<int64_t>(uint64_t{r.width} * r.height * rays_per_pixel);
  };
  StreamSummary summary;
  job.deliver = [&](size_t i, std::vector<v1::TileReply> replies) -> absl::Status {
    absl::StatusOr<Tile> tile =
        DecodeTile(query, samples, std::move(replies), Tile{.index = i, .rect = rect(i)});
    if (!tile.ok()) return tile.status();
    summary.statistics.Add(tile->statistics);
    return on_tile(*std::move(tile));
  };

  RunTotals totals;
  const absl::Status status = RunStreams(
      job, ToRunOptions(options, limits, shared_->connection->channel_count(), job.item_count, start),
      &totals);
  if (!status.ok()) return status;
  summary.revision = *revision;
  summary.items = job.item_count;
  summary.rays = uint64_t{query.camera.width} * query.camera.height * rays_per_pixel;
  summary.bytes_received = totals.bytes_received;
  summary.bytes_sent = totals.bytes_sent;
  summary.resent_items = totals.resent_items;
  summary.elapsed = absl::Now() - start;
  return summary;
}

absl::StatusOr<TileImage> Client::TraceImage(
    const TileQuery& query, const StreamOptions& options,
    const std::function<void(uint64_t done)>& on_progress) const {
  TileImage image;
  image.width = query.camera.width;
  image.height = query.camera.height;
  image.samples = query.outputs.lit ? static_cast<uint32_t>(TotalSamples(query.lights)) : 0;
  const uint64_t n = uint64_t{image.width} * image.height;
  uint64_t done = 0;
  const auto place = [&](const Tile& tile) {
    if (done == 0) {  // Not before the first answer: until then the sizes may be absurd.
      const TileOutputs& want = query.outputs;
      if (want.hits) image.hit.resize(n);
      if (want.ids) image.object.resize(n), image.triangle.resize(n);
      if (want.depths) image.depth.resize(n);
      if (want.barycentrics) image.u.resize(n), image.v.resize(n);
      if (want.lit) image.lit.resize(image.samples * n);
    }
    const TileRect& r = tile.rect;
    const auto copy = [&](const auto& from, auto* to, uint64_t planes) {
      if (from.empty()) return;
      for (uint64_t p = 0; p < planes; ++p) {
        for (uint64_t y = 0; y < r.height; ++y) {
          std::copy_n(from.begin() + static_cast<ptrdiff_t>((p * r.height + y) * r.width), r.width,
                      to->begin() +
                          static_cast<ptrdiff_t>(p * n + (r.y + y) * image.width + r.x));
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
    if (query.options.statistics) {
      if (image.costs.size() <= tile.index) image.costs.resize(tile.index + 1);
      image.costs[tile.index] = {r, tile.statistics};
    }
    done += uint64_t{r.width} * r.height;
  };
  absl::StatusOr<StreamSummary> summary = TraceTiles(
      query,
      [&](const Tile& tile) {
        place(tile);
        if (on_progress) on_progress(done);
        return absl::OkStatus();
      },
      options);
  if (!summary.ok()) return summary.status();
  image.summary = *summary;
  return image;
}

// ---- Shadows ------------------------------------------------------------------------------------

namespace {

absl::Status CheckPoints(const Points& points) {
  if (points.positions.size() % 3 != 0) {
    return absl::InvalidArgumentError(absl::StrCat(
        "points.positions has ", points.positions.size(), " numbers, which 3 does not divide"));
  }
  const size_t n = points.positions.size() / 3;
  const auto check = [n](size_t size, size_t row, absl::string_view field) -> absl::Status {
    if (size == 0 || size == n * row) return absl::OkStatus();
    return absl::InvalidArgumentError(absl::StrCat("points.", field, " has ", size, " numbers; ",
                                                   n, " points need ", n * row));
  };
  absl::Status s = check(points.source_objects.size(), 1, "source_objects");
  s.Update(check(points.source_triangles.size(), 1, "source_triangles"));
  s.Update(check(points.normals.size(), 3, "normals"));
  return s;
}

void ResizeShadows(const ShadowOutputs& want, uint64_t n, Shadows* out) {
  const uint64_t pairs = out->samples * n;
  out->points = n;
  if (want.lit) out->lit.resize(pairs);
  out->valid.resize(n);
  if (want.counts) out->counts.resize(n);
  if (want.weighted_sums) out->weighted_sums.resize(n);
  if (want.blockers) {
    out->blocker_object.resize(pairs);
    out->blocker_triangle.resize(pairs);
    out->blocker_distance.resize(pairs);
  }
}

absl::StatusOr<Shadows> DecodeShadows(const ShadowOutputs& want, uint64_t samples, uint64_t offset,
                                      uint64_t n, std::vector<v1::ShadowReply> replies) {
  Shadows out;
  out.offset = offset;
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
        if (want.blockers) {
          s.Update(DecodeRows(r.blocker_objects(), "blocker_objects", samples, at, count, n,
                              &out.blocker_object));
          s.Update(DecodeRows(r.blocker_triangles(), "blocker_triangles", samples, at, count, n,
                              &out.blocker_triangle));
          s.Update(DecodeRows(r.blocker_distances(), "blocker_distances", samples, at, count, n,
                              &out.blocker_distance));
        }
        return s;
      });
  if (!status.ok()) return status;
  return out;
}

}  // namespace

absl::StatusOr<StreamSummary> Client::ComputeShadows(
    const ShadowQuery& query, const std::function<absl::Status(Shadows)>& on_shadows,
    const StreamOptions& options) const {
  const absl::Time start = absl::Now();
  const CallOptions call{.deadline = start + options.timeout, .cancellation = options.cancellation};
  if (absl::Status s = CheckPoints(query.points); !s.ok()) return s;
  if (query.points_per_item == 0) return absl::InvalidArgumentError("points_per_item is 0");
  if (query.lights.empty()) return absl::InvalidArgumentError("lights: at least one is needed");
  absl::StatusOr<Capabilities> capabilities = GetCapabilities(call);
  if (!capabilities.ok()) return capabilities.status();
  const Limits& limits = capabilities->limits;
  if (absl::Status s = CheckLights(query.lights, limits); !s.ok()) return s;
  const uint64_t samples = TotalSamples(query.lights);
  uint64_t n = query.points.positions.size() / 3;
  int64_t revision = query.options.revision;
  if (!query.point_set.empty()) {
    absl::StatusOr<PointSet> set = GetPointSet(query.point_set, call);
    if (!set.ok()) return set.status();
    n = set->points;
    if (revision == 0) revision = set->revision;
  } else {
    absl::StatusOr<int64_t> pinned = PinnedRevision(query.scene, revision, call);
    if (!pinned.ok()) return pinned.status();
    revision = *pinned;
  }
  constexpr uint64_t kBytesPerPoint = 3 * 8 + 4 + 4 + 3 * 8;
  const uint64_t per_item = std::max<uint64_t>(
      1, std::min({uint64_t{query.points_per_item},
                   static_cast<uint64_t>(std::max<int64_t>(1, limits.max_item_rays)) /
                       std::max<uint64_t>(1, samples),
                   ChunkBytes(limits.max_message_bytes) / kBytesPerPoint}));
  const auto begin = [&](size_t i) { return i * per_item; };
  const auto count = [&](size_t i) { return std::min(per_item, n - i * per_item); };

  StreamJob<v1::ComputeShadowsRequest, v1::ComputeShadowsResponse> job;
  job.item_count = static_cast<size_t>((n + per_item - 1) / per_item);
  v1::ComputeShadowsHeader* header = job.header.mutable_header();
  FillHeader(query.scene, revision, query.options, header->mutable_stream());
  for (const Light& light : query.lights) ToProto(light, header->add_lights());
  ToProto(query.point_options, header->mutable_point_options());
  header->set_t_min(query.t_min);
  header->mutable_outputs()->set_lit_bits(query.outputs.lit);
  header->mutable_outputs()->set_lit_counts(query.outputs.counts);
  header->mutable_outputs()->set_weighted_sums(query.outputs.weighted_sums);
  header->mutable_outputs()->set_first_blockers(query.outputs.blockers);
  job.open = [this](int lane, const CallOptions& stream_call) {
    return shared_->connection->OpenShadows(lane, stream_call);
  };
  job.make_item = [&](size_t i) {
    v1::ComputeShadowsRequest request;
    v1::ShadowItem* item = request.mutable_item();
    FillItem(i, options, item->mutable_item());
    if (!query.point_set.empty()) {
      item->mutable_point_set_range()->set_point_set(query.point_set);
      item->mutable_point_set_range()->set_offset(begin(i));
      item->mutable_point_set_range()->set_count(count(i));
    } else {
      PackPoints(query.points, begin(i), count(i), item->mutable_points());
    }
    return request;
  };
  job.cost = [&](size_t i) { return static_cast<int64_t>(count(i) * samples); };
  StreamSummary summary;
  job.deliver = [&](size_t i, std::vector<v1::ShadowReply> replies) -> absl::Status {
    absl::StatusOr<Shadows> part =
        DecodeShadows(query.outputs, samples, begin(i), count(i), std::move(replies));
    if (!part.ok()) return part.status();
    summary.statistics.Add(part->statistics);
    return on_shadows(*std::move(part));
  };

  RunTotals totals;
  const absl::Status status = RunStreams(
      job, ToRunOptions(options, limits, shared_->connection->channel_count(), job.item_count, start),
      &totals);
  if (!status.ok()) return status;
  summary.revision = revision;
  summary.items = job.item_count;
  summary.rays = n * samples;
  summary.bytes_received = totals.bytes_received;
  summary.bytes_sent = totals.bytes_sent;
  summary.resent_items = totals.resent_items;
  summary.elapsed = absl::Now() - start;
  return summary;
}

absl::StatusOr<Shadows> Client::ComputeAllShadows(
    const ShadowQuery& query, const StreamOptions& options,
    const std::function<void(uint64_t done)>& on_progress) const {
  Shadows all;
  all.samples = static_cast<uint32_t>(TotalSamples(query.lights));
  uint64_t n = query.points.positions.size() / 3;
  if (!query.point_set.empty()) {
    absl::StatusOr<PointSet> set = GetPointSet(query.point_set, {});
    if (!set.ok()) return set.status();
    n = set->points;
  }
  ResizeShadows(query.outputs, n, &all);
  uint64_t done = 0;
  absl::StatusOr<StreamSummary> summary = ComputeShadows(
      query,
      [&](const Shadows& part) {
        Place(part.lit, all.samples, part.offset, n, &all.lit);
        Place(part.valid, 1, part.offset, n, &all.valid);
        all.invalid_samples = part.invalid_samples;
        Place(part.counts, 1, part.offset, n, &all.counts);
        Place(part.weighted_sums, 1, part.offset, n, &all.weighted_sums);
        Place(part.blocker_object, all.samples, part.offset, n, &all.blocker_object);
        Place(part.blocker_triangle, all.samples, part.offset, n, &all.blocker_triangle);
        Place(part.blocker_distance, all.samples, part.offset, n, &all.blocker_distance);
        all.near_surface_points += part.near_surface_points;
        done += part.points;
        if (on_progress) on_progress(done);
        return absl::OkStatus();
      },
      options);
  if (!summary.ok()) return summary.status();
  all.statistics = summary->statistics;
  all.summary = *summary;
  return all;
}

// ---- Segments -----------------------------------------------------------------------------------

namespace {

void ResizeSegments(const SegmentQuery& query, uint64_t n, Segments* out) {
  out->segments = n;
  if (query.blocked) out->blocked.resize(n);
  out->valid.resize(n);
  if (query.blockers) {
    out->blocker_object.resize(n);
    out->blocker_triangle.resize(n);
    out->blocker_distance.resize(n);
  }
}

absl::StatusOr<Segments> DecodeSegments(const SegmentQuery& query, uint64_t offset, uint64_t n,
                                        std::vector<v1::SegmentReply> replies) {
  Segments out;
  out.offset = offset;
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
        if (query.blockers) {
          s.Update(DecodeRows(r.blocker_objects(), "blocker_objects", 1, at, count, n,
                              &out.blocker_object));
          s.Update(DecodeRows(r.blocker_triangles(), "blocker_triangles", 1, at, count, n,
                              &out.blocker_triangle));
          s.Update(DecodeRows(r.blocker_distances(), "blocker_distances", 1, at, count, n,
                              &out.blocker_distance));
        }
        return s;
      });
  if (!status.ok()) return status;
  return out;
}

}  // namespace

absl::StatusOr<StreamSummary> Client::TestSegments(
    const SegmentQuery& query, const std::function<absl::Status(Segments)>& on_segments,
    const StreamOptions& options) const {
  const absl::Time start = absl::Now();
  const CallOptions call{.deadline = start + options.timeout, .cancellation = options.cancellation};
  if (query.segments.size() % 6 != 0) {
    return absl::InvalidArgumentError(absl::StrCat("segments has ", query.segments.size(),
                                                   " numbers, which 6 does not divide"));
  }
  if (query.segments_per_item == 0) return absl::InvalidArgumentError("segments_per_item is 0");
  absl::StatusOr<Capabilities> capabilities = GetCapabilities(call);
  if (!capabilities.ok()) return capabilities.status();
  const Limits& limits = capabilities->limits;
  absl::StatusOr<int64_t> revision = PinnedRevision(query.scene, query.options.revision, call);
  if (!revision.ok()) return revision.status();
  const uint64_t n = query.segments.size() / 6;
  constexpr uint64_t kBytesPerSegment = 6 * 8;
  const uint64_t per_item = std::max<uint64_t>(
      1, std::min({uint64_t{query.segments_per_item},
                   static_cast<uint64_t>(std::max<int64_t>(1, limits.max_item_rays)),
                   ChunkBytes(limits.max_message_bytes) / kBytesPerSegment}));
  const auto begin = [&](size_t i) { return i * per_item; };
  const auto count = [&](size_t i) { return std::min(per_item, n - i * per_item); };

  StreamJob<v1::TestSegmentsRequest, v1::TestSegmentsResponse> job;
  job.item_count = static_cast<size_t>((n + per_item - 1) / per_item);
  v1::TestSegmentsHeader* header = job.header.mutable_header();
  FillHeader(query.scene, *revision, query.options, header->mutable_stream());
  header->mutable_outputs()->set_blocked_bits(query.blocked);
  header->mutable_outputs()->set_first_blockers(query.blockers);
  job.open = [this](int lane, const CallOptions& stream_call) {
    return shared_->connection->OpenSegments(lane, stream_call);
  };
  job.make_item = [&](size_t i) {
    v1::TestSegmentsRequest request;
    FillItem(i, options, request.mutable_item()->mutable_item());
    request.mutable_item()->set_segments(PackRows(query.segments, 6, begin(i), count(i)));
    return request;
  };
  job.cost = [&](size_t i) { return static_cast<int64_t>(count(i)); };
  StreamSummary summary;
  job.deliver = [&](size_t i, std::vector<v1::SegmentReply> replies) -> absl::Status {
    absl::StatusOr<Segments> part = DecodeSegments(query, begin(i), count(i), std::move(replies));
    if (!part.ok()) return part.status();
    summary.statistics.Add(part->statistics);
    return on_segments(*std::move(part));
  };

  RunTotals totals;
  const absl::Status status = RunStreams(
      job, ToRunOptions(options, limits, shared_->connection->channel_count(), job.item_count, start),
      &totals);
  if (!status.ok()) return status;
  summary.revision = *revision;
  summary.items = job.item_count;
  summary.rays = n;
  summary.bytes_received = totals.bytes_received;
  summary.bytes_sent = totals.bytes_sent;
  summary.resent_items = totals.resent_items;
  summary.elapsed = absl::Now() - start;
  return summary;
}

absl::StatusOr<Segments> Client::TestAllSegments(
    const SegmentQuery& query, const StreamOptions& options,
    const std::function<void(uint64_t done)>& on_progress) const {
  Segments all;
  const uint64_t n = query.segments.size() / 6;
  ResizeSegments(query, n, &all);
  uint64_t done = 0;
  absl::StatusOr<StreamSummary> summary = TestSegments(
      query,
      [&](const Segments& part) {
        Place(part.blocked, 1, part.offset, n, &all.blocked);
        Place(part.valid, 1, part.offset, n, &all.valid);
        Place(part.blocker_object, 1, part.offset, n, &all.blocker_object);
        Place(part.blocker_triangle, 1, part.offset, n, &all.blocker_triangle);
        Place(part.blocker_distance, 1, part.offset, n, &all.blocker_distance);
        done += part.segments;
        if (on_progress) on_progress(done);
        return absl::OkStatus();
      },
      options);
  if (!summary.ok()) return summary.status();
  all.statistics = summary->statistics;
  all.summary = *summary;
  return all;
}

}  // namespace sightline::client
