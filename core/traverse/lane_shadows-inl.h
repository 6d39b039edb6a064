// SPDX-License-Identifier: Apache-2.0
//
// What blocks of sixteen of a packet's rays, and the boxes of a node, reach over on the three
// coordinate planes, and how far along the axes: where the two have nothing in common, none of a
// block's rays enters the box. Told of all blocks at once, a box at a time, before a box is put to
// the rays themselves.
//
// A ray's shadow on a plane is a number. Parallel rays P + t·D: the moment D_i·P_j - D_j·P_i about
// the plane's normal, the same at all t. Rays from an origin O: the slope d_i / |d_j|, where the
// packet's rays share the sign of d_j. A box casts an interval of them. For a single ray and all
// three planes this is the slab test; for many it says more than intervals of their slab parameters
// do, for it is taken of what the rays have on the plane, not of what they have on each axis.
//
// Conservative: moments of rays and boxes relative to a reference point R err by 6.2u of |P-R|_1
// and |box-R|_1 (three roundings of each of two products, |D|_inf < 2), and margins.h's kBoxMargin
// is taken of the scene's farthest corner. Slopes err by 4.1u of themselves, those of boxes by
// 5.1u, and underflow by 2^-149: kBoxExitScale and kBoxExitShift (core/geometry/box_ray.h) have
// room for twice as much. What lies along an axis is compared as rounded by one and the same
// subtraction.
//
// Thread safety: a packet's shadows are one walk's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_LANE_SHADOWS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_LANE_SHADOWS_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_LANE_SHADOWS_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_LANE_SHADOWS_INL_H_
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/accel/bvh.h"
#include "core/traverse/shaft_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Of a node's children.
struct BoxShadows {
  using D = hn::CappedTag<float, kBvhWidth>;

  // By plane, margins included.
  alignas(32) float least[3][kBvhWidth], most[3][kBvhWidth];
  // By axis: blocks whose own number is larger stay clear of the box.
  alignas(32) float along[3][kBvhWidth];
};

// Of one of them.
struct BoxShadow {  // Trivial: stacks of them are not initialized.
  float least[3], most[3], along[3];

  HWY_INLINE BoxShadow() = default;
  HWY_INLINE BoxShadow(const BoxShadows& boxes, int i) {
    for (int k = 0; k < 3; ++k) {
      least[k] = boxes.least[k][i];
      most[k] = boxes.most[k][i];
      along[k] = boxes.along[k][i];
    }
  }
};

// The ranges of a row's values, by block and over all; inverted where there are none.
struct RowRanges {
  alignas(64) float least[kShaftBlocks], most[kShaftBlocks];
  float all_least, all_most;
};

class LaneShadows {
 public:
  static constexpr size_t kRays = size_t{kShaftBlocks} * kShaftBlockRays;

  // Of the first `count` lanes of all rows.
  explicit LaneShadows(size_t count) : whole_(count == kRays) {
    for (size_t b = 0; b < kShaftBlocks; ++b) {
      const size_t first = b * kShaftBlockRays;
      const size_t lanes = std::min<size_t>(count - std::min(count, first), kShaftBlockRays);
      used_[b] = static_cast<uint16_t>((1u << lanes) - 1);
    }
  }

  // Lanes out of use may hold anything.
  void FindRanges(const float* row, RowRanges* ranges) const {
    const ShaftD d;
    BlockRanges<uint16_t>(row, whole_ ? nullptr : used_, ranges->least, ranges->most);
    ShaftV least = hn::Load(d, ranges->least), most = hn::Load(d, ranges->most);
    for (size_t b = kLanes; b < kShaftBlocks; b += kLanes) {
      least = hn::Min(least, hn::Load(d, ranges->least + b));
      most = hn::Max(most, hn::Load(d, ranges->most + b));
    }
    ranges->all_least = hn::GetLane(hn::MinOfLanes(d, least));
    ranges->all_most = hn::GetLane(hn::MaxOfLanes(d, most));
  }

  // On plane k.
  void PutPlane(int k, const float* row) { FindRanges(row, &planes_[k]); }
  // Along axis k: of a row's numbers or, `turned`, of these with their signs turned round. A lane
  // is clear of boxes whose own is less.
  void PutAxis(int k, const RowRanges& ranges, bool turned) {
    const ShaftD d;
    for (size_t b = 0; b < kShaftBlocks; b += kLanes) {
      hn::Store(turned ? hn::Neg(hn::Load(d, ranges.most + b)) : hn::Load(d, ranges.least + b), d,
                along_[k] + b);
    }
    all_along_[k] = turned ? -ranges.all_most : ranges.all_least;
  }
  // Of which nothing is known: no box is clear of it.
  void OpenPlane(int k) {
    std::fill_n(planes_[k].least, kShaftBlocks, -kInfinity);
    std::fill_n(planes_[k].most, kShaftBlocks, kInfinity);
    planes_[k].all_least = -kInfinity;
    planes_[k].all_most = kInfinity;
  }
  void OpenAxis(int k) {
    std::fill_n(along_[k], kShaftBlocks, -kInfinity);
    all_along_[k] = -kInfinity;
  }

  // The boxes, a bit each, that some ray may enter.
  HWY_INLINE uint32_t BoxesMet(const BoxShadows& boxes) const {
    const BoxShadows::D d;
    auto met = hn::FirstN(d, kBvhWidth);
    for (int k = 0; k < 3; ++k) {
      met = hn::And(met,
                    hn::And(hn::Ge(hn::Load(d, boxes.most[k]), hn::Set(d, planes_[k].all_least)),
                            hn::Le(hn::Load(d, boxes.least[k]), hn::Set(d, planes_[k].all_most))));
      met = hn::And(met, hn::Ge(hn::Load(d, boxes.along[k]), hn::Set(d, all_along_[k])));
    }
    return MaskBits(d, met);
  }

  // The vectors of rays, a bit each, of which some ray may enter box i.
  HWY_INLINE uint32_t GroupsMet(const BoxShadows& boxes, int i) const {
    const ShaftD d;
    uint32_t met = 0;
    for (size_t b = 0; b < kShaftBlocks; b += kLanes) {
      ShaftM in = hn::FirstN(d, kLanes);
      for (int k = 0; k < 3; ++k) {
        in = hn::And(
            in, hn::And(hn::Le(hn::Load(d, planes_[k].least + b), hn::Set(d, boxes.most[k][i])),
                        hn::Ge(hn::Load(d, planes_[k].most + b), hn::Set(d, boxes.least[k][i]))));
        in = hn::And(in, hn::Le(hn::Load(d, along_[k] + b), hn::Set(d, boxes.along[k][i])));
      }
      met |= MaskBits(d, in) << b;
    }
    return GroupsOfBlocks(met);
  }

  // A bit for each vector of rays, of a bit for each block of sixteen.
  static HWY_INLINE uint32_t GroupsOfBlocks(uint32_t blocks) {
    if constexpr (kLanes == kShaftBlockRays) return blocks;
    static_assert(kLanes == kShaftBlockRays || kLanes == kShaftBlockRays / 2);
    blocks = (blocks | blocks << 8) & 0x00FF00FF;
    blocks = (blocks | blocks << 4) & 0x0F0F0F0F;
    blocks = (blocks | blocks << 2) & 0x33333333;
    blocks = (blocks | blocks << 1) & 0x55555555;
    return blocks | blocks << 1;
  }

 private:
  static constexpr size_t kLanes = hn::MaxLanes(ShaftD());
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();

  const bool whole_;
  alignas(32) uint16_t used_[kShaftBlocks];  // A bit for each lane that is in use.
  RowRanges planes_[3];
  alignas(64) float along_[3][kShaftBlocks];
  float all_along_[3];
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
