// SPDX-License-Identifier: Apache-2.0
#include "core/query/group_hulls.h"

#include <algorithm>
#include <utility>

namespace sightline {
namespace {

// What a walk for all samples may cost, a packet (TraceHullFn): as much as sixteen walks sample by
// sample through dense foliage.
constexpr uint32_t kMostWork = 100'000;
// Its tests of a triangle, a point and a sample that cost as much as a shaft's one: a vector of
// these is a test, but a few of its lanes are counted.
constexpr uint64_t kTestsOfOne = 3;

}  // namespace

bool GroupHulls::Find(size_t s, bool alone) {
  if (s < begin_ || s >= end_) {
    const LightSample& first = samples_[s];
    const auto belongs = [&](size_t i) {
      const LightSample& own = samples_[i];
      return own.valid && !own.directional && own.light == first.light && own.mask == first.mask &&
             own.source_triangle == first.source_triangle;
    };
    begin_ = s;
    const size_t most = std::min(samples_.size(), s + (alone ? 1 : LightHull::kMostSamples));
    for (end_ = s; end_ < most && belongs(end_); ++end_) {
    }
    states_.assign(blocks(), State::kNew);
    begun_ = false;
  }
  return end_ - begin_ >= kLeastSamples;
}

void GroupHulls::Begin(std::span<const RayPacket> packets) {
  if (std::exchange(begun_, true)) return;
  if (fitted_begin_ != begin_ || fitted_end_ != end_) {
    Vec3f values[LightHull::kMostSamples];
    for (size_t i = begin_; i < end_; ++i) values[i - begin_] = samples_[i].value;
    light_ = FitLightHull({values, end_ - begin_});
    fitted_begin_ = begin_;
    fitted_end_ = end_;
  }
  const std::span<const Vec3f> origins(light_.samples, light_.count);
  const bool has_cut =
      packets.size() > 1 && run_.kernels().cut_hull(scene_, origins, packets, nullptr, &cut_);
  group_cut_ = has_cut ? &cut_ : nullptr;
  rests_.resize(packets.size());
  blocked_.resize(packets.size() * kBlockRays);
  shares_.resize(packets.size());
}

bool GroupHulls::Trace(size_t b, bool by_shaft, RayPacket* packet, WalkStats* stats) {
  const uint32_t budget = by_shaft && kind_ == HitKind::kAny ? kMostWork : 0;
  const WalkStats before = *stats;
  if (packet->answered_by != nullptr) {
    std::fill_n(packet->answered_by, packet->count, AnsweredBy::kShaft);
  }
  const bool has_cut =
      run_.kernels().trace_hull(scene_, light_, *packet, group_cut_, budget, &rests_[b],
                                blocked_.data() + b * kBlockRays, run_.cancel(), stats);
  states_[b] = !has_cut ? State::kRoot : rests_[b].samples == 0 ? State::kAnswered : State::kCut;
  const uint64_t samples = end_ - begin_;
  shares_[b] = {
      .nodes = (stats->nodes - before.nodes) / samples,
      .leaves = (stats->leaves - before.leaves) / samples,
      .triangle_tests = (stats->triangle_tests - before.triangle_tests) / (kTestsOfOne * samples)};
  if (packet->answered_by != nullptr) {
    answered_by_.resize(blocks() * kBlockRays);
    std::copy_n(packet->answered_by, packet->count, answered_by_.data() + b * kBlockRays);
  }
  return has_cut && budget != 0;
}

size_t GroupHulls::Bits(size_t s, size_t b, uint16_t* bits) const {
  const size_t first = b * kBlockRays;
  const size_t count = std::min<size_t>(kBlockRays, points_ - first);
  if (count < kBlockRays) std::fill_n(bits, kBlockRays / 16, uint16_t{0});
  return rows_.flag_bits({blocked_.data() + first, count}, static_cast<uint32_t>(s - begin_), bits);
}

}  // namespace sightline
