// SPDX-License-Identifier: Apache-2.0
//
// A relevant triangle against all blocks of a shaft's rays: which of them it may touch, and which
// it covers.
//
// Thread safety: belongs to one walk.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_BLOCKS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_BLOCKS_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_BLOCKS_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_BLOCKS_INL_H_
#endif

#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/shaft/margins.h"
#include "core/traverse/shaft_leaf-inl.h"
#include "core/traverse/shaft_pair-inl.h"
#include "core/traverse/shaft_rays-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <bool kAny, bool kParallel, class Packet = ShaftPacket<kParallel>>
class TriangleBlocks {
 public:
  using Rays = ShaftRays<kAny, kParallel, Packet>;

  // All are kept by reference.
  HWY_INLINE TriangleBlocks(const Rays& rays, const BlockBounds& bounds, const LeafForms& forms)
      : rays_(rays), bounds_(bounds), forms_(forms) {}

  // One relevant triangle against all blocks. Returns those that it covers, a bit each, and lists
  // those that it may touch otherwise. Where no more than kFewBlocks are in its rectangle, as where
  // triangles are smaller than pixels, these are listed as they are: to ask their rays costs less
  // than to ask what they might see.
  template <int kFewBlocks = kAny ? 2 : 1>
  HWY_INLINE uint32_t List(uint32_t i, BlockPairs* touched) const {
    const ShaftD d;
    uint32_t covered = 0;
    for (size_t first = 0; first < kShaftBlocks; first += kLanes) {
      const uint8_t* open = reinterpret_cast<const uint8_t*>(&bounds_.open_blocks) + first / 8;
      M in = hn::And(
          hn::LoadMaskBits(d, open),
          hn::And(hn::And(hn::Le(hn::Load(d, bounds_.x0 + first), hn::Set(d, forms_.x1[i])),
                          hn::Ge(hn::Load(d, bounds_.x1 + first), hn::Set(d, forms_.x0[i]))),
                  hn::And(hn::Le(hn::Load(d, bounds_.y0 + first), hn::Set(d, forms_.y1[i])),
                          hn::Ge(hn::Load(d, bounds_.y1 + first), hn::Set(d, forms_.y0[i])))));
      const uint32_t pair_bits = i << kTriangleShift | static_cast<uint32_t>(first);
      const uint32_t blocks = MaskBits(d, in);
      if (std::popcount(blocks) <= kFewBlocks) {
        if constexpr (!kAny) {
          in = hn::And(in, hn::Le(hn::Set(d, forms_.nearest[i]), hn::Load(d, bounds_.far + first)));
        }
        touched->count += ListLanes(pair_bits, in, touched->pairs + touched->count);
        continue;
      }
      V most = hn::Set(d, kInfinity), least = most;  // Over the edges: of largest, least values.
      V middle, radius;
      for (const FrameForm& form : forms_.edge_form) {
        Range(form, i, first, hn::Set(d, forms_.edge_margin[i]), &middle, &radius);
        most = hn::Min(most, hn::Add(middle, radius));
        least = hn::Min(least, hn::Sub(middle, radius));
      }
      in = hn::And(in, hn::Ge(most, hn::Zero(d)));
      M cover = hn::Gt(least, hn::Zero(d));
      Range(forms_.plane_form, i, first, hn::Set(d, forms_.plane_margin[i]), &middle, &radius);
      if constexpr (kParallel) {
        // N·(A-P): some origin must lie behind the triangle; all must for a cover.
        const V z0 = hn::Load(d, bounds_.near + first), z1 = hn::Load(d, bounds_.far + first);
        const V f3 = hn::Set(d, forms_.plane_form.f[3][i]);
        const V at0 = hn::MulAdd(f3, z0, middle), at1 = hn::MulAdd(f3, z1, middle);
        in = hn::And(in, hn::Gt(hn::Add(hn::Max(at0, at1), radius), hn::Zero(d)));
        cover = hn::And(cover, hn::Gt(hn::Sub(hn::Min(at0, at1), radius), hn::Zero(d)));
      } else {
        // The rays' rate of approach to the plane, per unit of depth; and the depth along the
        // normal at which the plane stands, with rounding both ways.
        const V fastest = hn::Add(middle, radius), slowest = hn::Sub(middle, radius);
        const V far = hn::Load(d, bounds_.far + first);
        const V depth = hn::Set(d, forms_.depth[i]), bound = hn::Set(d, forms_.depth_bound[i]);
        const V plane_lo = hn::Mul(hn::Sub(depth, bound), hn::Set(d, 2.0f - kDepthScale));
        if constexpr (kAny) {
          if (rays_.segments()) {
            // Some ray must reach the plane; all must pass it for a cover.
            in = hn::And(
                in, hn::And(hn::Gt(fastest, hn::Zero(d)), hn::Ge(hn::Mul(far, fastest), plane_lo)));
            const V near =
                hn::Mul(hn::Load(d, bounds_.near + first), hn::Set(d, 2.0f - kDepthScale));
            const V plane_hi = hn::Mul(hn::Add(depth, bound), hn::Set(d, kDepthScale));
            cover = hn::And(cover, hn::And(hn::Gt(slowest, hn::Zero(d)),
                                           hn::Gt(hn::Mul(near, slowest), plane_hi)));
          }
        } else {
          // Where every ray certainly approaches, the plane quotient is good to a few float
          // roundings, and no hit on this triangle comes before plane / fastest. Elsewhere
          // (grazing) only the vertices' depths have a say.
          const M certain = hn::Gt(slowest, hn::Zero(d));
          in = hn::AndNot(hn::And(certain, hn::Lt(hn::Mul(far, fastest), plane_lo)), in);
          if (rays_.segments()) cover = hn::FirstN(d, 0);
        }
      }
      covered |= MaskBits(d, hn::And(in, cover)) << first;
      touched->count +=
          ListLanes(pair_bits, hn::AndNot(cover, in), touched->pairs + touched->count);
    }
    return covered;
  }

 private:
  using V = ShaftV;
  using M = ShaftM;

  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  static constexpr size_t kLanes = hn::MaxLanes(ShaftD());

  // Range of a form over the blocks first .. first + kLanes: middle ± (radius + `margin`).
  HWY_INLINE void Range(const FrameForm& form, uint32_t i, size_t first, V margin, V* middle,
                        V* radius) const {
    const ShaftD d;
    const V f0 = hn::Set(d, form.f[0][i]), f1 = hn::Set(d, form.f[1][i]);
    *middle = hn::MulAdd(f0, hn::Load(d, bounds_.mx + first),
                         hn::MulAdd(f1, hn::Load(d, bounds_.my + first), hn::Set(d, form.f[2][i])));
    *radius = hn::MulAdd(hn::Abs(f0), hn::Load(d, bounds_.hx + first),
                         hn::MulAdd(hn::Abs(f1), hn::Load(d, bounds_.hy + first), margin));
  }

  const Rays& rays_;
  const BlockBounds& bounds_;
  const LeafForms& forms_;
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
