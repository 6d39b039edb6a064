// SPDX-License-Identifier: Apache-2.0
#include "core/query/relighting.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "absl/base/attributes.h"
#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/float_environment.h"
#include "core/base/status_macros.h"
#include "core/query/shadows.h"

namespace sightline {

HitPackets PacketsOfHits(const PreparedPoints& hits, std::span<const uint32_t> pixels,
                         uint32_t width, uint32_t height, int side) {
  SIGHTLINE_CHECK_EQ(hits.size(), pixels.size());
  SIGHTLINE_CHECK(std::find(kPacketSides.begin(), kPacketSides.end(), side) != kPacketSides.end());
  SIGHTLINE_CHECK(uint64_t{width} * height < kNoPixel);
  constexpr uint32_t kMiss = 0xFFFFFFFFu;
  std::vector<uint32_t> hit_of(size_t{width} * height, kMiss);
  for (size_t i = 0; i < pixels.size(); ++i) hit_of[pixels[i]] = static_cast<uint32_t>(i);
  HitPackets packets;
  packets.side = side;
  packets.pixel_count = hit_of.size();
  const auto step = static_cast<uint32_t>(side);
  std::vector<uint32_t> at(size_t{step} * step);  // The packet's pixels; kNoPixel beyond the edge.
  for (uint32_t y0 = 0; y0 < height; y0 += step) {
    for (uint32_t x0 = 0; x0 < width; x0 += step) {
      uint32_t first = kMiss;
      for (uint32_t i = 0; i < step * step; ++i) {
        const uint32_t x = x0 + i % step, y = y0 + i / step;
        at[i] = x < width && y < height ? y * width + x : kNoPixel;
        if (at[i] != kNoPixel && first == kMiss) first = hit_of[at[i]];
      }
      if (first == kMiss) continue;
      for (const uint32_t pixel : at) {
        const uint32_t hit = pixel == kNoPixel ? kMiss : hit_of[pixel];
        const uint32_t from = hit == kMiss ? first : hit;
        packets.points.positions.push_back(hits.positions[from]);
        packets.points.sources.push_back(hits.sources[from]);
        packets.points.valid.push_back(hits.valid[from]);
        packets.pixel.push_back(hit == kMiss ? kNoPixel : pixel);
      }
    }
  }
  return packets;
}

absl::StatusOr<Relighting> Relighting::Make(const IndexedGeometry& scene, HitPackets hits,
                                            std::span<const LightSample> samples,
                                            std::span<const double> weights,
                                            const QueryOptions& options) {
  if (samples.empty() || samples.size() != weights.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("a relit picture needs samples with a weight each, not ", samples.size(),
                     " samples and ", weights.size(), " weights"));
  }
  Relighting picture(scene, std::move(hits));
  QueryStats stats;
  for (size_t first = 0; first < samples.size();) {
    const uint32_t light = samples[first].light;
    if (light != picture.lights_.size()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "samples[", first, "].light = ", light, " where ", picture.lights_.size(),
          " comes next: lights are numbered from 0, and their samples follow one another"));
    }
    size_t end = first;
    while (end < samples.size() && samples[end].light == light) ++end;
    SL_ASSIGN_OR_RETURN(Lit lit, picture.Ask(samples.subspan(first, end - first),
                                             weights.subspan(first, end - first), options));
    picture.lights_.push_back(std::move(lit));
    stats.Add(picture.stats_);
    first = end;
  }
  picture.stats_ = stats;
  picture.base_.resize(picture.hits_.pixel_count);
  picture.chosen_ = picture.light_count() - 1;
  picture.SumBase();
  return picture;
}

absl::Status Relighting::Choose(uint32_t light) {
  if (light >= light_count()) {
    return absl::InvalidArgumentError(absl::StrCat("light ", light, " is to move, but there are ",
                                                   light_count(), ", numbered from 0"));
  }
  if (light == chosen_) return absl::OkStatus();
  chosen_ = light;
  SumBase();
  return absl::OkStatus();
}

absl::Status Relighting::Move(std::span<const LightSample> samples, std::span<const double> weights,
                              const QueryOptions& options) {
  if (samples.size() != weights.size()) {
    return absl::InvalidArgumentError(absl::StrCat("the light that moves has ", samples.size(),
                                                   " samples and ", weights.size(), " weights"));
  }
  SL_ASSIGN_OR_RETURN(lights_[chosen_], Ask(samples, weights, options));
  SumColor();
  return absl::OkStatus();
}

absl::StatusOr<Relighting::Lit> Relighting::Ask(std::span<const LightSample> samples,
                                                std::span<const double> weights,
                                                const QueryOptions& options) {
  QueryOptions asked = options;
  // Packets are the picture's squares, whatever other order might pay.
  const bool packets = asked.strategy == Strategy::kPacket;
  if (packets) asked.packet_side = hits_.side;
  ShadowResult shadows;
  SL_RETURN_IF_ERROR(
      ComputeShadows(*scene_, PointRange::Slice(hits_.points, 0, hits_.points.size()), samples, {},
                     {.ordered = packets}, {.bits = true}, asked, &shadows));
  stats_ = shadows.stats;
  return Lit{std::move(shadows.lit_bits), {weights.begin(), weights.end()}};
}

// Not inlined: float_environment.h says why.
ABSL_ATTRIBUTE_NOINLINE
void Relighting::AddTo(const Lit& lit, std::vector<double>* sums) const {
  const size_t n = hits_.points.size(), row = (n + 7) / 8;
  for (size_t s = 0; s < lit.weights.size(); ++s) {
    const double weight = lit.weights[s];
    for (size_t b = 0; b < row; ++b) {
      for (uint32_t bits = lit.bits[s * row + b]; bits != 0; bits &= bits - 1) {
        const uint32_t pixel = hits_.pixel[8 * b + static_cast<size_t>(std::countr_zero(bits))];
        if (pixel != kNoPixel) (*sums)[pixel] += weight;
      }
    }
  }
}

void Relighting::SumBase() {
  const ScopedFloatEnvironment environment;
  std::fill(base_.begin(), base_.end(), 0.0);
  for (uint32_t light = 0; light < light_count(); ++light) {
    if (light != chosen_) AddTo(lights_[light], &base_);
  }
  SumColor();
}

void Relighting::SumColor() {
  const ScopedFloatEnvironment environment;
  color_ = base_;
  AddTo(lights_[chosen_], &color_);
}

}  // namespace sightline
