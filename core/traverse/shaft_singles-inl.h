// SPDX-License-Identifier: Apache-2.0
//
// The rays that a shaft's walk for any hit gives up on: they are traced one by one.
//
// Thread safety: belongs to one walk.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_SINGLES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_SINGLES_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_SINGLES_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_SINGLES_INL_H_
#endif

#include <bit>
#include <cstddef>
#include <cstdint>

#include "core/accel/indexed_geometry.h"
#include "core/base/cancel.h"
#include "core/intersect/hit.h"
#include "core/traverse/shaft_rays-inl.h"
#include "core/traverse/single-inl.h"
#include "core/traverse/trace_ray.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

template <class Rays>
class ShaftSingles {
 public:
  bool empty() const { return count_ == 0; }

  // Takes those of a set that are still asked about: it asks about none any more.
  HWY_NOINLINE void Take(typename Rays::Bounds* bounds) {
    for (uint32_t b = 0; b < kShaftBlocks; ++b) {
      for (auto rest = bounds->open[b]; rest != 0; rest &= rest - 1) {
        const uint32_t r = std::countr_zero(rest);
        lanes_[count_++] = static_cast<uint16_t>(b * Rays::kRays + r);
      }
      bounds->open[b] = 0;
    }
    bounds->open_blocks = 0;
  }

  // Each from the root, all of them by turns. Adds to *lit those that are. Returns false if
  // cancelled.
  HWY_NOINLINE bool Trace(const IndexedGeometry& scene, typename Rays::Packet& packet,
                          const CancelToken* cancel, typename Rays::Set* lit, WalkStats* stats) {
    TraceRay rays[Rays::kMaxRays];
    Hit hits[Rays::kMaxRays];
    for (size_t i = 0; i < count_; ++i) rays[i] = packet.trace_ray(lanes_[i]);
    stats->shaft.singles += count_;
    if (!TraceSingle<true>(scene, {rays, count_}, hits, cancel, stats)) return false;
    for (size_t i = 0; i < count_; ++i) {
      const uint32_t lane = lanes_[i];
      if constexpr (!Rays::kPair) {
        if (packet.blocked == nullptr) packet.triangle[lane] = hits[i].triangle;
      }
      if (hits[i].triangle == kNoTriangle) {
        lit->rays[lane / Rays::kRays] |= static_cast<typename Rays::Bits>(1u << lane % Rays::kRays);
      }
      if (packet.answered_by != nullptr) packet.answered_by[lane] = AnsweredBy::kRay;
    }
    return true;
  }

 private:
  uint16_t lanes_[Rays::kMaxRays];
  size_t count_ = 0;
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
