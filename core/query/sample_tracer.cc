// SPDX-License-Identifier: Apache-2.0
#include "core/query/sample_tracer.h"

#include <algorithm>
#include <array>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "hwy/highway.h"

namespace sightline {

void SampleTracer::SetPoints(std::span<const Vec3f> positions, std::span<const uint32_t> sources) {
  SIGHTLINE_CHECK_LE(positions.size(), static_cast<size_t>(kBlockRays));
  SIGHTLINE_CHECK_EQ(positions.size(), sources.size());
  positions_ = positions;
  sources_ = sources;
  packet_ready_ = parallel_ready_ = false;
}

// A segment's point end is moved toward the light by t_min, in double, rounded once.
void SampleTracer::LayOut(const LightSample& sample, float* x, float* y, float* z,
                          uint32_t* sources) {
  const Vec3d toward = ToDouble(sample.value);
  for (size_t i = 0; i < positions_.size(); ++i) {
    Vec3f p = positions_[i];
    if (t_min_ != 0) {
      const Vec3d d = ToDouble(p);
      p = ToFloat(d + (sample.directional ? toward : toward - d) * t_min_);
    }
    x[i] = p.x;
    y[i] = p.y;
    z[i] = p.z;
  }
  std::copy(sources_.begin(), sources_.end(), sources);
}

absl::Status SampleTracer::Trace(const LightSample& sample) {
  SIGHTLINE_CHECK(sample.valid);
  const int n = static_cast<int>(positions_.size());
  const uint32_t mask = run_.options().mask & sample.mask;
  if (!sample.directional) {
    packet_.origin = sample.value;
    packet_.segments = true;
    packet_.mask = mask;
    packet_.origin_source = sample.source_triangle;
    packet_.count = n;
    if (!packet_ready_) {
      LayOut(sample, packet_.target_x, packet_.target_y, packet_.target_z, packet_.target_source);
      packet_ready_ = t_min_ == 0;  // Else the ends depend on the sample.
    }
    triangles_ = packet_.triangle;
    return TracePacketBlock(scene_, run_, kind_, run_.options().strategy, &packet_, stats_);
  }
  if (ChooseStrategy(run_.options().strategy, RayForm::kParallel, kind_, n) != Strategy::kShaft) {
    return TraceOneByOne(sample, mask);
  }
  parallel_.direction = sample.value;
  parallel_.mask = mask;
  parallel_.direction_source = sample.source_triangle;
  parallel_.count = n;
  if (!parallel_ready_) {
    LayOut(sample, parallel_.origin_x, parallel_.origin_y, parallel_.origin_z,
           parallel_.origin_source);
    parallel_ready_ = t_min_ == 0;
  }
  triangles_ = parallel_.triangle;
  return TraceParallelBlock(scene_, run_, &parallel_, stats_);
}

absl::Status SampleTracer::TraceOneByOne(const LightSample& sample, uint32_t mask) {
  packet_ready_ = false;
  LayOut(sample, packet_.target_x, packet_.target_y, packet_.target_z, packet_.target_source);
  const size_t n = positions_.size();
  std::array<TraceRay, kBlockRays> rays;
  std::array<Hit, kBlockRays> hits;
  for (size_t i = 0; i < n; ++i) {
    rays[i] = {.ray = PredicateRay::Ray(packet_.target(static_cast<int>(i)), sample.value),
               .mask = mask,
               .from_source = sources_[i],
               .to_source = sample.source_triangle};
  }
  SL_RETURN_IF_ERROR(TraceRayBlock(scene_, run_, kind_, run_.options().strategy,
                                   std::span<const TraceRay>(rays.data(), n), hits, stats_));
  for (size_t i = 0; i < n; ++i) {
    packet_.t[i] = hits[i].t;
    packet_.triangle[i] = hits[i].triangle;
  }
  triangles_ = packet_.triangle;
  return absl::OkStatus();
}

uint64_t SampleTracer::LitBits(size_t word) const {
  namespace hn = hwy::HWY_NAMESPACE;
  const hn::CappedTag<uint32_t, 8> d;
  static_assert(hn::MaxLanes(decltype(d)()) == 8, "x86-64-v3 holds eight words in a vector");
  const size_t first = 64 * word;
  const size_t count = std::min<size_t>(64, positions_.size() - first);
  uint64_t lit = 0;
  for (size_t i = 0; i < count; i += 8) {
    const auto none = hn::Eq(hn::Load(d, triangles_ + first + i), hn::Set(d, kNoTriangle));
    uint8_t bits[8];
    hn::StoreMaskBits(d, none, bits);
    lit |= uint64_t{bits[0]} << i;
  }
  return count == 64 ? lit : lit & ((uint64_t{1} << count) - 1);
}

}  // namespace sightline
