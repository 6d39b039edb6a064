// SPDX-License-Identifier: Apache-2.0
#include "core/query/tiles.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <memory>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/float_environment.h"
#include "core/base/status_macros.h"
#include "core/intersect/hit.h"
#include "core/mesh/rebase.h"
#include "core/query/ray_block.h"
#include "core/query/sample_tracer.h"
#include "hwy/highway.h"

namespace sightline {
namespace {

// A block is a square of pixels whose rays walk together; its lanes run through smaller squares, so
// that the lanes of one SIMD vector are neighbours in both directions. Their rows are runs of
// pixels. A group is a square of blocks that begin their walks together.
constexpr uint32_t kBlockSide = 16;
constexpr uint32_t kRunPixels = 4;
constexpr uint32_t kGroupSide = 4;
static_assert(kBlockSide * kBlockSide == kBlockRays && kGroupSide * kGroupSide == kGroupBlocks);

// AVX2, the floor, is enough to lay rays out: four doubles.
namespace hn = hwy::HWY_NAMESPACE;
using Four = hn::CappedTag<double, kRunPixels>;
static_assert(hn::MaxLanes(Four()) == kRunPixels, "x86-64-v3 holds four doubles in a vector");

absl::Status CheckRect(const Camera& camera, const TileRect& tile) {
  const auto check = [](const char* field, uint64_t begin, uint64_t extent, const char* side,
                        uint64_t limit) -> absl::Status {
    if (extent == 0) {
      return absl::InvalidArgumentError(absl::StrCat("tile.", side, " = 0: a tile has pixels"));
    }
    if (begin + extent > limit) {
      return absl::InvalidArgumentError(
          absl::StrCat("tile.", field, " = ", begin, " with tile.", side, " = ", extent,
                       " leaves the image, whose ", side, " is ", limit));
    }
    return absl::OkStatus();
  };
  SL_RETURN_IF_ERROR(check("x", tile.x, tile.width, "width", camera.width));
  return check("y", tile.y, tile.height, "height", camera.height);
}

class TileTrace {
 public:
  TileTrace(const IndexedGeometry& scene, const Camera& camera, const TileRect& tile, Vec3f eye,
            std::span<const LightSample> samples, const TileOutputs& outputs,
            const QueryOptions& options, TileResult* out)
      : scene_(scene),
        tile_(tile),
        samples_(samples),
        outputs_(outputs),
        run_(options),
        pixels_(size_t{tile.width} * tile.height),
        row_bytes_((pixels_ + 7) / 8),
        out_(*out),
        tracer_(scene, run_, HitKind::kAny, /*t_min=*/0, &out->shadow) {
    // As many blocks as the tile fills, at most a group.
    const auto blocks = [](uint32_t side) { return (side + kBlockSide - 1) / kBlockSide; };
    const size_t most = size_t{std::min(blocks(tile.width), kGroupSide)} *
                        std::min(blocks(tile.height), kGroupSide);
    packets_ = std::make_unique_for_overwrite<RayPacket[]>(most);
    pixels_of_.resize(most);
    columns_of_.resize(most);
    for (size_t b = 0; b < most; ++b) {
      packets_[b].origin = eye;
      packets_[b].segments = false;
      packets_[b].mask = options.mask;
      packets_[b].want_barycentrics = outputs.uv;
    }
    if (outputs.lit || outputs.points) {
      positions_.resize(most * kBlockRays);
      sources_.resize(most * kBlockRays);
      point_pixel_.resize(most * kBlockRays);
    }
    if (outputs.hits) out_.hit_bits.assign(row_bytes_, 0);
    if (outputs.ids) out_.triangle.assign(pixels_, kNoTriangle);
    if (outputs.depth) out_.depth.assign(pixels_, std::numeric_limits<float>::infinity());
    if (outputs.uv) {
      out_.u.assign(pixels_, 0);
      out_.v.assign(pixels_, 0);
    }
    if (outputs.lit) out_.lit_bits.assign(samples.size() * row_bytes_, 0);
    for (std::vector<double>& column : columns_) column.resize(tile.width);
    for (uint32_t x = 0; x < tile.width; ++x) {
      const Vec3d column = PixelColumn(camera, tile.x + x);
      for (int axis = 0; axis < 3; ++axis) columns_[axis][x] = column[axis];
    }
    rows_.resize(tile.height);
    for (uint32_t y = 0; y < tile.height; ++y) rows_[y] = PixelRow(camera, tile.y + y);
  }

  absl::Status Run() {
    constexpr uint32_t kSide = kGroupSide * kBlockSide;
    for (uint32_t y = 0; y < tile_.height; y += kSide) {
      for (uint32_t x = 0; x < tile_.width; x += kSide) {
        SL_RETURN_IF_ERROR(TraceGroup(x, y));
      }
    }
    if (outputs_.points) SortPoints();
    return absl::OkStatus();
  }

 private:
  // The blocks of a group, from a common cut.
  absl::Status TraceGroup(uint32_t x0, uint32_t y0) {
    size_t count = 0;
    for (uint32_t y = y0; y < std::min(y0 + kGroupSide * kBlockSide, tile_.height);
         y += kBlockSide) {
      for (uint32_t x = x0; x < std::min(x0 + kGroupSide * kBlockSide, tile_.width);
           x += kBlockSide) {
        PlaceBlock(count++, x, y);
      }
    }
    // Which pixels are hit is answered by any hit; all else needs the first.
    const bool need_first =
        outputs_.ids || outputs_.depth || outputs_.uv || outputs_.lit || outputs_.points;
    const HitKind kind = need_first ? HitKind::kClosest : HitKind::kAny;
    const Strategy strategy = run_.options().strategy;
    const ShaftCut* cut =
        CutGroup(scene_, run_, kind, strategy, std::span<const RayPacket>(packets_.get(), count),
                 &cut_, &out_.primary);
    for (size_t b = 0; b < count; ++b) {
      SL_RETURN_IF_ERROR(
          TracePacketBlock(scene_, run_, kind, strategy, &packets_[b], &out_.primary, cut));
      if (columns_of_[b] % kRunPixels == 0) {
        for (int i = 0; i < packets_[b].count; i += kRunPixels) WriteRun(b, i);
      } else {
        for (int i = 0; i < packets_[b].count; ++i) WriteHit(b, i);
      }
    }
    if (outputs_.lit || outputs_.points) return ShadeGroup(count);
    return absl::OkStatus();
  }

  // Block b: the pixels from (x0, y0) of the tile.
  void PlaceBlock(size_t b, uint32_t x0, uint32_t y0) {
    const uint32_t width = std::min(kBlockSide, tile_.width - x0);
    const uint32_t height = std::min(kBlockSide, tile_.height - y0);
    int count = 0;
    for (uint32_t gy = 0; gy < height; gy += kRunPixels) {
      for (uint32_t gx = 0; gx < width; gx += kRunPixels) {
        const uint32_t columns = std::min(kRunPixels, width - gx);
        for (uint32_t y = gy; y < std::min(gy + kRunPixels, height); ++y) {
          PlaceRays(b, x0 + gx, y0 + y, columns, count);
          count += static_cast<int>(columns);
        }
      }
    }
    packets_[b].count = count;
    columns_of_[b] = width;
  }

  // Lanes `lane` .. for `columns` pixels in a row from (x, y) of the tile.
  void PlaceRays(size_t b, uint32_t x, uint32_t y, uint32_t columns, int lane) {
    RayPacket& packet = packets_[b];
    const Vec3d& row = rows_[y];
    const uint32_t pixel = y * tile_.width + x;
    for (uint32_t k = 0; k < columns; ++k) {
      pixels_of_[b][lane + k] = pixel + k;
      packet.target_source[lane + k] = kNoTriangle;
    }
    float* const rows[3] = {packet.target_x, packet.target_y, packet.target_z};
    if (columns == kRunPixels) {
      const Four d;
      const hn::Rebind<float, Four> df;
      for (int axis = 0; axis < 3; ++axis) {
        const auto column = hn::LoadU(d, columns_[axis].data() + x);
        hn::StoreU(hn::DemoteTo(df, hn::Add(column, hn::Set(d, row[axis]))), df, rows[axis] + lane);
      }
      return;
    }
    for (uint32_t k = 0; k < columns; ++k) {
      for (int axis = 0; axis < 3; ++axis) {
        rows[axis][lane + k] = static_cast<float>(columns_[axis][x + k] + row[axis]);
      }
    }
  }

  // Four lanes that are four pixels in a row.
  void WriteRun(size_t b, int i) {
    const RayPacket& packet = packets_[b];
    const uint32_t pixel = pixels_of_[b][i];
    constexpr size_t kBytes = kRunPixels * sizeof(float);
    if (outputs_.hits) {
      for (uint32_t k = 0; k < kRunPixels; ++k) {
        const uint8_t hit = packet.triangle[i + k] != kNoTriangle;
        out_.hit_bits[(pixel + k) / 8] |= static_cast<uint8_t>(hit << ((pixel + k) % 8));
      }
    }
    if (outputs_.ids) std::memcpy(&out_.triangle[pixel], packet.triangle + i, kBytes);
    if (outputs_.depth) std::memcpy(&out_.depth[pixel], packet.t + i, kBytes);
    if (outputs_.uv) {
      std::memcpy(&out_.u[pixel], packet.u + i, kBytes);
      std::memcpy(&out_.v[pixel], packet.v + i, kBytes);
    }
  }

  void WriteHit(size_t b, int i) {
    const RayPacket& packet = packets_[b];
    const uint32_t pixel = pixels_of_[b][i];
    if (outputs_.hits && packet.triangle[i] != kNoTriangle) SetBit(out_.hit_bits.data(), pixel);
    if (outputs_.ids) out_.triangle[pixel] = packet.triangle[i];
    if (outputs_.depth) out_.depth[pixel] = packet.t[i];
    if (outputs_.uv) {
      out_.u[pixel] = packet.u[i];
      out_.v[pixel] = packet.v[i];
    }
  }

  absl::Status ShadeGroup(size_t blocks) {
    size_t points = 0;
    {
      // Placing belongs to the shadows' cost, though it asks about no ray.
      const StatsScope scope(&out_.shadow, run_.options().strategy, /*rays=*/0);
      for (size_t b = 0; b < blocks; ++b) {
        const RayPacket& packet = packets_[b];
        for (int i = 0; i < packet.count; ++i) {
          const Hit hit = packet.hit(i);
          if (hit.triangle == kNoTriangle) continue;
          positions_[points] =
              PlaceHit(scene_, packet.origin, packet.target(i), hit.t, hit.triangle);
          sources_[points] = hit.triangle;
          point_pixel_[points++] = pixels_of_[b][i];
        }
      }
    }
    if (outputs_.points) {
      out_.points.positions.insert(out_.points.positions.end(), positions_.begin(),
                                   positions_.begin() + static_cast<ptrdiff_t>(points));
      out_.points.sources.insert(out_.points.sources.end(), sources_.begin(),
                                 sources_.begin() + static_cast<ptrdiff_t>(points));
      out_.point_pixel.insert(out_.point_pixel.end(), point_pixel_.begin(),
                              point_pixel_.begin() + static_cast<ptrdiff_t>(points));
    }
    if (!outputs_.lit) return absl::OkStatus();
    tracer_.SetPoints(std::span<const Vec3f>(positions_.data(), points),
                      std::span<const uint32_t>(sources_.data(), points));
    for (size_t s = 0; s < samples_.size(); ++s) {
      if (!samples_[s].valid) continue;
      SL_RETURN_IF_ERROR(tracer_.Trace(samples_[s], s));
      uint8_t* row = out_.lit_bits.data() + s * row_bytes_;
      for (size_t i = 0; i < points; ++i) {
        if (tracer_.triangle(i) == kNoTriangle) SetBit(row, point_pixel_[i]);
      }
    }
    return absl::OkStatus();
  }

  // Blocks came one after another; points are handed out in pixel order.
  void SortPoints() {
    const size_t n = out_.point_pixel.size();
    std::vector<uint32_t> at(pixels_, kNoTriangle);
    for (size_t i = 0; i < n; ++i) at[out_.point_pixel[i]] = static_cast<uint32_t>(i);
    PreparedPoints sorted;
    sorted.positions.reserve(n);
    sorted.sources.reserve(n);
    sorted.valid.assign(n, 1);
    size_t next = 0;
    for (size_t pixel = 0; pixel < pixels_; ++pixel) {
      if (at[pixel] == kNoTriangle) continue;
      sorted.positions.push_back(out_.points.positions[at[pixel]]);
      sorted.sources.push_back(out_.points.sources[at[pixel]]);
      out_.point_pixel[next++] = static_cast<uint32_t>(pixel);
    }
    out_.points = std::move(sorted);
  }

  static void SetBit(uint8_t* row, uint32_t pixel) { row[pixel / 8] |= uint8_t(1u << (pixel % 8)); }

  const IndexedGeometry& scene_;
  const TileRect tile_;
  const std::span<const LightSample> samples_;
  const TileOutputs& outputs_;
  const QueryRun run_;
  const size_t pixels_, row_bytes_;
  TileResult& out_;
  // Of the group being traced, by block: rays, their pixels, and the block's width.
  std::unique_ptr<RayPacket[]> packets_;
  std::vector<std::array<uint32_t, kBlockRays>> pixels_of_;
  std::vector<uint32_t> columns_of_;
  ShaftCut cut_;
  // Its points.
  std::vector<Vec3f> positions_;
  std::vector<uint32_t> sources_, point_pixel_;
  std::vector<double> columns_[3];  // PixelColumn of each column, by axis.
  std::vector<Vec3d> rows_;         // PixelRow of each row.
  SampleTracer tracer_;
};

}  // namespace

absl::Status TraceTile(const IndexedGeometry& scene, const Camera& camera, const TileRect& tile,
                       std::span<const LightSample> samples, const TileOutputs& outputs,
                       const QueryOptions& options, TileResult* result) {
  const ScopedFloatEnvironment environment;
  *result = TileResult{};
  SL_RETURN_IF_ERROR(ValidateCamera(camera));
  SL_RETURN_IF_ERROR(CheckRect(camera, tile));
  Vec3f eye;
  if (!Rebase(camera.eye, scene.geometry.origin, &eye)) {
    return absl::InvalidArgumentError(
        absl::StrCat("camera.eye = (", camera.eye.x, ", ", camera.eye.y, ", ", camera.eye.z,
                     ") lies beyond 2^40 along an axis, in the world or from the scene's origin"));
  }
  TileResult out;
  SL_RETURN_IF_ERROR(TileTrace(scene, camera, tile, eye, samples, outputs, options, &out).Run());
  *result = std::move(out);
  return absl::OkStatus();
}

}  // namespace sightline
