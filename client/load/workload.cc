// SPDX-License-Identifier: Apache-2.0
#include "client/load/workload.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "client/load/random.h"

namespace sightline::load {
namespace {

// Of a mix. Weights that are no numbers of people's any more add up to infinity.
constexpr double kHeaviest = 1e6;

size_t Index(Kind kind) { return static_cast<size_t>(kind); }

uint64_t SampleCount(const std::vector<client::Light>& lights) {
  return std::accumulate(
      lights.begin(), lights.end(), uint64_t{0},
      [](uint64_t sum, const client::Light& l) { return sum + l.SampleCount(); });
}

// Row by row through the image.
void AddTiles(const client::Camera& camera, size_t index, uint32_t side,
              std::vector<TileWork>* tiles) {
  for (uint32_t y = 0; y < camera.height; y += side) {
    for (uint32_t x = 0; x < camera.width; x += side) {
      tiles->push_back(
          {index, {x, y, std::min(side, camera.width - x), std::min(side, camera.height - y)}});
    }
  }
}

// `count` rows drawn from those of `surface`, in no order.
void Draw(const std::vector<double>& surface, uint64_t count, Random* random,
          std::vector<double>* out) {
  for (uint64_t i = 0; i < count; ++i) {
    const auto row = static_cast<ptrdiff_t>(3 * random->Below(surface.size() / 3));
    out->insert(out->end(), surface.begin() + row, surface.begin() + row + 3);
  }
}

}  // namespace

absl::StatusOr<Mix> ParseMix(absl::string_view text) {
  Mix mix{};
  std::array<bool, kKinds> named{};
  for (absl::string_view part : absl::StrSplit(text, ',')) {
    const std::pair<absl::string_view, absl::string_view> words =
        absl::StrSplit(part, absl::MaxSplits('=', 1));
    const auto found = std::find(kKindNames.begin(), kKindNames.end(), words.first);
    const auto kind = static_cast<size_t>(found - kKindNames.begin());
    if (found == kKindNames.end() || named[kind] || !absl::SimpleAtod(words.second, &mix[kind]) ||
        !(mix[kind] >= 0 && mix[kind] <= kHeaviest)) {
      return absl::InvalidArgumentError(
          absl::StrCat("'", part,
                       "': wants tiles=, points= or segments= once, with a weight from 0 to "
                       "1000000"));
    }
    named[kind] = true;
  }
  if (std::accumulate(mix.begin(), mix.end(), 0.0) <= 0) {
    return absl::InvalidArgumentError("wants at least one weight above 0");
  }
  return mix;
}

absl::StatusOr<Workload> Workload::Make(const WorkloadSpec& spec, std::vector<double> surface) {
  Workload workload;
  const double sum = std::accumulate(spec.mix.begin(), spec.mix.end(), 0.0);
  if (!(sum > 0)) return absl::InvalidArgumentError("the workload asks nothing: every weight is 0");
  if (spec.cameras.empty()) return absl::InvalidArgumentError("the path has no camera");
  for (size_t i = 0; i < kKinds; ++i) workload.mix_[i] = spec.mix[i] / sum;
  workload.seed_ = spec.seed;
  workload.items_ = spec.distinct_items;
  const client::QueryOptions options{.statistics = true};
  if (spec.mix[Index(Kind::kTiles)] > 0) {
    for (size_t i = 0; i < spec.cameras.size(); ++i) {
      workload.tile_queries_.push_back({.scene = spec.scene,
                                        .camera = spec.cameras[i],
                                        .lights = spec.lights,
                                        .outputs = {.ids = true, .depths = true, .lit = true},
                                        .options = options,
                                        .tile_size = spec.tile_size});
      AddTiles(spec.cameras[i], i, spec.tile_size, &workload.tiles_);
    }
  }
  Random random(spec.seed);
  const bool points = spec.mix[Index(Kind::kPoints)] > 0;
  const bool segments = spec.mix[Index(Kind::kSegments)] > 0;
  if ((points || segments) && surface.empty()) {
    return absl::InvalidArgumentError(
        "the cameras of the path see nothing of the scene; give another --path");
  }
  if (points) {
    if (spec.lights.empty()) {
      return absl::InvalidArgumentError("points want at least one light; give --light");
    }
    Draw(surface, uint64_t{spec.points_per_item} * spec.distinct_items, &random, &workload.points_);
  }
  if (segments) {
    Draw(surface, uint64_t{2} * spec.segments_per_item * spec.distinct_items, &random,
         &workload.segments_);
  }
  workload.shadow_query_ = {.scene = spec.scene,
                            .lights = spec.lights,
                            .points = {.positions = workload.points_},
                            .options = options,
                            .points_per_item = spec.points_per_item};
  workload.segment_query_ = {.scene = spec.scene,
                             .segments = workload.segments_,
                             .blockers = true,
                             .options = options,
                             .segments_per_item = spec.segments_per_item};
  return workload;
}

Work Workload::Pick(uint64_t number) const {
  // A generator of its own for every number: nothing is shared by the threads that ask.
  double share = Random(seed_ * 0x9E3779B97F4A7C15u + number).Uniform();
  Kind kind = Kind::kTiles;
  for (size_t i = 0; i < kKinds; ++i) {
    if (mix_[i] <= 0) continue;
    kind = static_cast<Kind>(i);
    if (share < mix_[i]) break;
    share -= mix_[i];
  }
  return {.kind = kind, .item = static_cast<size_t>(number % ItemCount(kind))};
}

size_t Workload::ItemCount(Kind kind) const {
  return kind == Kind::kTiles ? tiles_.size() : items_;
}

size_t Workload::StreamCount(Kind kind) const {
  if (mix_[Index(kind)] <= 0) return 0;
  return kind == Kind::kTiles ? tile_queries_.size() : 1;
}

size_t Workload::StreamOf(const Work& work) const {
  return work.kind == Kind::kTiles ? tiles_[work.item].camera : 0;
}

size_t Workload::ConnectionOf(const Request& request, size_t connections) const {
  // After so many requests the same items meet the same connections again.
  const uint64_t round = std::lcm<uint64_t>(ItemCount(request.work.kind), connections);
  return static_cast<size_t>((request.number + request.number / round) % connections);
}

uint64_t Workload::Rays(const Work& work) const {
  switch (work.kind) {
    case Kind::kTiles: {
      const TileWork& tile = tiles_[work.item];
      return uint64_t{tile.rect.width} * tile.rect.height *
             (1 + SampleCount(tile_queries_[tile.camera].lights));
    }
    case Kind::kPoints:
      return points(work.item).count * SampleCount(shadow_query_.lights);
    case Kind::kSegments:
      break;
  }
  return segments(work.item).count;
}

std::string Workload::Describe(const Work& work) const {
  if (work.kind == Kind::kTiles) {
    const TileWork& tile = tiles_[work.item];
    return absl::StrCat("the tile at x ", tile.rect.x, ", y ", tile.rect.y, " of camera ",
                        tile.camera);
  }
  const ItemRange range = work.kind == Kind::kPoints ? points(work.item) : segments(work.item);
  return absl::StrCat(KindName(work.kind), " ", range.begin, " to ", range.begin + range.count - 1);
}

}  // namespace sightline::load
