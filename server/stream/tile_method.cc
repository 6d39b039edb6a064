// SPDX-License-Identifier: Apache-2.0
#include "server/stream/tile_method.h"

#include <algorithm>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/base/status_macros.h"
#include "core/query/relighting.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "core/traverse/rtt.h"
#include "server/base/error.h"
#include "server/codec/geometry_codec.h"
#include "server/codec/result_codec.h"

namespace sightline {
namespace {

absl::Status CheckTile(const v1::TileItem& item, const Camera& camera) {
  const auto check = [](absl::string_view name, uint64_t from, uint64_t size,
                        uint64_t whole) -> absl::Status {
    if (size == 0) return InvalidField(absl::StrCat("item.", name), size, "must be at least 1");
    if (from + size <= whole) return absl::OkStatus();
    return InvalidField(
        absl::StrCat("item.", name), size,
        absl::StrCat("the tile from ", from, " on leaves the image, which has ", whole));
  };
  SL_RETURN_IF_ERROR(check("width", item.x(), item.width(), camera.width));
  return check("height", item.y(), item.height(), camera.height);
}

}  // namespace

// A tile cut into bands of whole rows.
class TileMethod::TileWork final : public ItemWork {
 public:
  TileWork(const TileMethod& method, std::shared_ptr<const Scene> scene,
           std::shared_ptr<const SampleSet> samples, std::shared_ptr<const PreparedMirrors> mirrors,
           TileRect tile, std::vector<PartRange> parts)
      : ItemWork(std::move(scene), std::move(parts)),
        method_(method),
        samples_(std::move(samples)),
        mirrors_(std::move(mirrors)),
        tile_(tile) {}

  absl::StatusOr<PartRange> RunPart(size_t part, const CancelToken& cancel, ItemReply* reply,
                                    QueryStats* stats) override {
    const PartRange range = parts()[part];
    const TileRect band{tile_.x, tile_.y + static_cast<uint32_t>(range.offset / tile_.width),
                        tile_.width, static_cast<uint32_t>(range.count / tile_.width)};
    const v1::ShadowOutputs& wanted = method_.shadow_outputs_;
    const bool lights = !samples_->samples.empty();
    // Bits (and what answered) come with the tile; whatever else is wanted of the lights is asked
    // about the hits themselves.
    const bool bits_alone =
        !wanted.lit_counts() && !wanted.weighted_sums() && !wanted.first_blockers();
    TileOutputs outputs{
        .hits = true,
        .ids = method_.outputs_.object_ids() || method_.outputs_.triangle_ids(),
        .depth = method_.outputs_.depths(),
        .uv = method_.outputs_.barycentrics(),
        .lit = lights && bits_alone,
        .points = lights && !bits_alone,
        .answered_by = method_.outputs_.answered_by(),
        .lit_answered_by = wanted.answered_by(),
        .mirrors = method_.outputs_.mirror_bits(),
    };
    const QueryOptions options = PartOptions(method_.options_.query, cancel);
    TileResult result;
    SL_RETURN_IF_ERROR(TraceTile(scene(), method_.camera_, band,
                                 outputs.lit ? std::span<const LightSample>(samples_->samples)
                                             : std::span<const LightSample>(),
                                 *mirrors_, outputs, options, &result));
    stats->Add(result.primary);
    ShadowResult shadows;
    std::vector<uint8_t> hit;  // Of each pixel: whether there is something to light.
    if (lights && bits_alone) {
      shadows.lit_bits = std::move(result.lit_bits);
      shadows.answered_by = std::move(result.lit_answered_by);
      shadows.stats = result.shadow;
    } else if (lights) {
      SL_RETURN_IF_ERROR(ShadeHits(result, band, options, &shadows));
    }
    if (lights) {
      stats->Add(shadows.stats);
      hit.resize(range.count);
      for (size_t i = 0; i < hit.size(); ++i) hit[i] = (result.hit_bits[i / 8] >> (i % 8)) & 1;
    }
    reply->Add(v1::TileReply::kTileFieldNumber,
               EncodeTile(scene().geometry, std::move(result), method_.outputs_));
    if (!lights) return range;
    reply->Add(v1::TileReply::kShadowsFieldNumber,
               EncodeShadows(scene().geometry, std::move(shadows), hit, samples_->samples, wanted));
    return range;
  }

 private:
  absl::Status ShadeHits(const TileResult& tile, const TileRect& band, const QueryOptions& options,
                         ShadowResult* shadows) const {
    *shadows = NothingLit(Pixels(band), samples_->samples.size(),
                          DecodeShadowOutputs(method_.shadow_outputs_));
    if (tile.points.size() == 0) return absl::OkStatus();
    if (options.strategy == Strategy::kPacket && options.pixel_shadow_packets) {
      return ShadeSquares(tile, band, options, shadows);
    }
    return Shade(PointRange::All(tile.points), tile.point_pixel, band, ShadowOptions{}, options,
                 shadows);
  }

  // By packets of the pixels' own squares. Some points stand in for pixels that hit nothing, and
  // are up to a square's where a band is but a row: so some packets at a time are answered.
  absl::Status ShadeSquares(const TileResult& tile, const TileRect& band,
                            const QueryOptions& options, ShadowResult* shadows) const {
    const HitPackets packets =
        PacketsOfHits(tile.points, tile.point_pixel, band.width, band.height, options.packet_side);
    constexpr size_t kSomePackets = 16 * 16 * 16;  // Points; a multiple of every packet's.
    ShadowHints hints;
    const size_t all = packets.points.size();
    for (size_t first = 0; first < all; first += kSomePackets) {
      const size_t count = std::min<size_t>(kSomePackets, all - first);
      SL_RETURN_IF_ERROR(Shade(PointRange::Slice(packets.points, first, count),
                               std::span(packets.pixel).subspan(first, count), band,
                               {.ordered = true, .hints = &hints}, options, shadows));
    }
    return absl::OkStatus();
  }

  // Of some points, into those of all pixels.
  absl::Status Shade(const PointRange& points, std::span<const uint32_t> pixels,
                     const TileRect& band, const ShadowOptions& shadow, const QueryOptions& options,
                     ShadowResult* shadows) const {
    const ShadowOutputs outputs = DecodeShadowOutputs(method_.shadow_outputs_);
    ShadowResult of_points;
    SL_RETURN_IF_ERROR(
        ComputeShadows(scene(), points, *samples_, shadow, outputs, options, &of_points));
    shadows->stats.Add(of_points.stats);
    SpreadShadows(of_points, pixels, Pixels(band), samples_->samples.size(), outputs, shadows);
    return absl::OkStatus();
  }

  static size_t Pixels(const TileRect& band) { return size_t{band.width} * band.height; }

  const TileMethod& method_;
  const std::shared_ptr<const SampleSet> samples_;
  const std::shared_ptr<const PreparedMirrors> mirrors_;
  const TileRect tile_;
};

absl::StatusOr<std::unique_ptr<TileMethod>> TileMethod::Open(const Header& header,
                                                             const QueryEnvironment& env) {
  std::unique_ptr<TileMethod> method(new TileMethod(env));
  SL_ASSIGN_OR_RETURN(method->options_, DecodeOptions(header.stream().options()));
  if (!header.has_camera()) return InvalidField("header.camera", "(unset)", "is required");
  SL_ASSIGN_OR_RETURN(method->camera_, DecodeCamera(header.camera(), env.limits));
  SL_ASSIGN_OR_RETURN(method->lights_, LightSet::Open(header.lights(), env.limits));
  if (static_cast<size_t>(header.mirrors().size()) > kMaxMirrors) {
    return InvalidField("header.mirrors", header.mirrors().size(),
                        absl::StrCat("may be ", kMaxMirrors, " at most"));
  }
  method->mirrors_ = header.mirrors();
  method->outputs_ = WantedTile(header.outputs(), method->sample_count() > 0);
  method->shadow_outputs_ = WantedShadows(header.shadow_outputs());
  SL_RETURN_IF_ERROR(method->OpenScene(header.stream()));
  return method;
}

absl::Status TileMethod::Read(grpc::ByteBuffer* bytes, const ElementLimit& elements,
                              Request* request, Item* item) {
  SL_RETURN_IF_ERROR(ReadRequest(bytes, ArrayPaths(), elements, request, {}));
  if (request->has_item()) item->message = std::move(*request->mutable_item());
  return absl::OkStatus();
}

uint64_t TileMethod::Rays(const Item& item) const {
  return RayCount(uint64_t{item.message.width()} * item.message.height(), 1 + sample_count());
}

// Rows that no part's border may divide: those of RTT's tiles and of packets' squares, as long as a
// reply holds them.
template <typename Bytes>
uint64_t TileMethod::RowsTogether(uint64_t width, const Bytes& bytes) const {
  const QueryOptions& query = options_.query;
  const uint64_t rows = query.strategy == Strategy::kRtt ? RttTileSide(query.rtt_antialiasing)
                        : query.strategy == Strategy::kPacket
                            ? static_cast<uint64_t>(query.packet_side)
                            : 1;
  return bytes(std::lcm(rows * width, uint64_t{8})) <= env_.limits.target_reply_bytes ? rows : 1;
}

absl::StatusOr<std::shared_ptr<const PreparedMirrors>> TileMethod::MirrorsFor(
    const std::shared_ptr<const Scene>& scene, const CancelToken& cancel) const {
  if (mirrors_.empty()) return std::make_shared<const PreparedMirrors>();
  MutexLock lock(mutex_);
  if (prepared_mirrors_ == nullptr || mirrored_scene_.lock() != scene) {
    SL_ASSIGN_OR_RETURN(const std::vector<Mirror> mirrors,
                        DecodeMirrors(mirrors_, scene->name, scene->geometry));
    absl::StatusOr<PreparedMirrors> prepared =
        PrepareMirrors(scene->geometry, mirrors, camera_, &cancel);
    // The camera was looked at before: what is not right is a mirror's plane.
    if (absl::IsInvalidArgument(prepared.status())) {
      return WithReason(prepared.status(), v1::ERROR_REASON_INVALID_FIELD,
                        {{"field", "header.mirrors"}});
    }
    SL_RETURN_IF_ERROR(prepared.status());
    prepared_mirrors_ = std::make_shared<const PreparedMirrors>(*std::move(prepared));
    mirrored_scene_ = scene;
  }
  return prepared_mirrors_;
}

absl::StatusOr<std::unique_ptr<ItemWork>> TileMethod::Prepare(const Item& item,
                                                              const CancelToken& cancel,
                                                              uint64_t part_rays) const {
  SL_RETURN_IF_ERROR(CheckTile(item.message, camera_));
  SL_ASSIGN_OR_RETURN(std::shared_ptr<const Scene> scene, pin_->ForItem());
  SL_ASSIGN_OR_RETURN(std::shared_ptr<const SampleSet> samples, lights_->For(scene));
  SL_ASSIGN_OR_RETURN(std::shared_ptr<const PreparedMirrors> mirrors, MirrorsFor(scene, cancel));
  const TileRect tile{item.message.x(), item.message.y(), item.message.width(),
                      item.message.height()};
  const uint64_t sample_count = samples->samples.size();
  const auto bytes = [&](uint64_t n) {
    return TileBytes(outputs_, n) +
           (sample_count > 0 ? ShadowBytes(shadow_outputs_, n, sample_count) : 0);
  };
  const uint64_t rows = RowsTogether(tile.width, bytes);
  SL_ASSIGN_OR_RETURN(std::vector<PartRange> parts,
                      CutIntoParts(uint64_t{tile.width} * tile.height, rows * tile.width,
                                   1 + sample_count, part_rays, env_.limits, bytes));
  return std::unique_ptr<ItemWork>(new TileWork(*this, std::move(scene), std::move(samples),
                                                std::move(mirrors), tile, std::move(parts)));
}

}  // namespace sightline
