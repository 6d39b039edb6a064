// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/frame.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "tests/bench/workload.h"

namespace sightline::bench {
namespace {

constexpr TileOutputs kPlacedOutputs = {.hits = false, .ids = true, .depth = true, .lit = true};
constexpr TileOutputs kSteppedBackOutputs = {.hits = false, .ids = true, .depth = true};
constexpr uint32_t kTilePixels = 64 * 64;

uint64_t CountBits(const std::vector<uint8_t>& bits) {
  uint64_t count = 0;
  for (const uint8_t byte : bits) count += static_cast<uint64_t>(std::popcount(byte));
  return count;
}

}  // namespace

absl::StatusOr<Frame> Frame::Make(const BuiltinView& view, uint32_t width, uint32_t height,
                                  const SceneGeometry& geometry, ThreadPool& pool) {
  SL_ASSIGN_OR_RETURN(const Camera camera,
                      LookAt(view.eye, view.at, view.up, view.fov_y_degrees, width, height));
  std::vector<LightSample> samples;
  for (size_t i = 0; i < view.lights.size(); ++i) {
    SL_RETURN_IF_ERROR(AppendSamples(Light::Point(view.lights[i]), static_cast<uint32_t>(i),
                                     geometry.origin, &samples));
  }
  return Frame(camera, std::move(samples), geometry.origin, pool);
}

Frame::Frame(const Camera& camera, std::vector<LightSample> samples, Vec3d origin, ThreadPool& pool)
    : camera_(camera),
      samples_(std::move(samples)),
      rays_(camera, origin),
      pool_(&pool),
      tiles_(CutImage(camera.width, camera.height)),
      ours_(tiles_.size()),
      peer_(tiles_.size()) {
  image_.Resize(size_t{camera.width} * camera.height);
}

void Frame::DrawOurs(const IndexedGeometry& scene, Points points, const QueryOptions& options) {
  pool_->ParallelFor(tiles_.size(), 1, [&](size_t begin, size_t end) {
    for (size_t t = begin; t < end; ++t) {
      if (points == Points::kSteppedBack) {
        DrawSteppedBack(scene, options, t);
        continue;
      }
      ours_[t].shadows.lit_bits.clear();
      const absl::Status status =
          TraceTile(scene, camera_, tiles_[t], samples_, kPlacedOutputs, options, &ours_[t].result);
      SIGHTLINE_CHECK(status.ok()) << status;
    }
  });
}

void Frame::DrawSteppedBack(const IndexedGeometry& scene, const QueryOptions& options, size_t t) {
  const TileRect& tile = tiles_[t];
  OurTile& out = ours_[t];
  absl::Status status =
      TraceTile(scene, camera_, tile, {}, kSteppedBackOutputs, options, &out.result);
  SIGHTLINE_CHECK(status.ok()) << status;
  StepBack(tile, out.result.depth.data(), tile.width, &out.points);
  out.valid.assign(out.points.size(), 1);
  status = ComputeShadows(scene, {out.points, {}, out.valid}, samples_, {}, {.ordered = true},
                          {.bits = true}, options, &out.shadows);
  SIGHTLINE_CHECK(status.ok()) << status;
}

void Frame::StepBack(const TileRect& tile, const float* depth, size_t stride,
                     std::vector<Vec3f>* points) const {
  points->clear();
  const Vec3f eye = rays_.eye();
  for (uint32_t i = 0; i < kTilePixels / 4; ++i) {
    // The bits of i, from the least: which of 2×2, of 4×4 in x, in y, of a tile's in x, in y.
    const uint32_t block = i >> 6, square = i >> 2 & 15, quad = i & 3;
    const uint32_t x0 = (block % 4) * 16 + (square % 4) * 4 + quad % 2 * 2;
    const uint32_t y0 = (block / 4) * 16 + (square / 4) * 4 + quad / 2 * 2;
    if (x0 >= tile.width || y0 >= tile.height) continue;
    float dx[4], dy[4], dz[4];
    rays_.Directions(tile.x + x0, tile.y + y0, dx, dy, dz);
    for (uint32_t p = 0; p < 4; ++p) {
      const uint32_t x = x0 + p % 2, y = y0 + p / 2;
      if (x >= tile.width || y >= tile.height) continue;
      const float t = depth[y * stride + x];
      if (std::isinf(t)) continue;
      points->push_back(eye + Vec3f{dx[p], dy[p], dz[p]} * (t * (1 - kStepBack)));
    }
  }
}

void Frame::DrawPeer(const EmbreeScene& peer, PeerMode camera_mode, PeerMode shadow_mode) {
  pool_->ParallelFor(tiles_.size(), 1, [&](size_t begin, size_t end) {
    for (size_t t = begin; t < end; ++t) DrawPeerTile(peer, camera_mode, shadow_mode, t);
  });
}

void Frame::DrawPeerTile(const EmbreeScene& peer, PeerMode camera_mode, PeerMode shadow_mode,
                         size_t t) {
  const TileRect& tile = tiles_[t];
  TraceCameraTile(peer, camera_mode, rays_, tile, camera_.width, TileWrites::kUsual, &image_);
  PeerTile& out = peer_[t];
  StepBack(tile, &image_.depth[size_t{tile.y} * camera_.width + tile.x], camera_.width,
           &out.points);
  const size_t row = (out.points.size() + 7) / 8;
  out.lit_bits.resize(samples_.size() * row);
  if (shadow_mode.sorted) {
    out.order.Sort(out.points);
    out.sorted_bits.resize(row);
    std::fill(out.lit_bits.begin(), out.lit_bits.end(), uint8_t{0});
  }
  for (size_t s = 0; s < samples_.size(); ++s) {
    uint8_t* const bits = out.lit_bits.data() + s * row;
    if (!shadow_mode.sorted) {
      TracePoints(peer, shadow_mode, out.points, samples_[s], bits);
      continue;
    }
    TracePoints(peer, shadow_mode, out.order.positions(), samples_[s], out.sorted_bits.data());
    out.order.PutBack(out.sorted_bits.data(), 0, out.points.size(), bits);
  }
}

uint64_t Frame::our_lit() const {
  uint64_t lit = 0;
  for (const OurTile& tile : ours_) {
    lit += CountBits(tile.shadows.lit_bits.empty() ? tile.result.lit_bits : tile.shadows.lit_bits);
  }
  return lit;
}

uint64_t Frame::peer_lit() const {
  uint64_t lit = 0;
  for (const PeerTile& tile : peer_) lit += CountBits(tile.lit_bits);
  return lit;
}

}  // namespace sightline::bench
