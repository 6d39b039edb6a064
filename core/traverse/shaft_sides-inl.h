// SPDX-License-Identifier: Apache-2.0
//
// The planes around a shaft, and a node's boxes against them.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_SIDES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_SIDES_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_SIDES_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_SIDES_INL_H_
#endif

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "core/accel/bvh.h"
#include "core/geometry/box3.h"
#include "core/shaft/frame.h"
#include "core/shaft/wedge-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Planes with the shaft on their inner side: n·p >= local for p relative to the apex (or to R),
// n·x >= world for a stored point x.
struct ShaftSides {
  static constexpr int kMost = 8;

  int count = 0;
  alignas(32) float n[3][kMost];
  alignas(32) float local[kMost], world[kMost];
  alignas(32) int32_t face[3][kMost];  // Rows of a node's bounds where n·x is largest.

  Vec3f normal(int i) const { return {n[0][i], n[1][i], n[2][i]}; }
};

inline float Norm1(Vec3f v) { return std::abs(v.x) + std::abs(v.y) + std::abs(v.z); }

// Bounds |x|_1 over a box.
inline float FarthestNorm1(const Box3f& box) {
  float sum = 0;
  for (int k = 0; k < 3; ++k) sum += std::max(std::abs(box.lo[k]), std::abs(box.hi[k]));
  return sum;
}

// Finds `world` and `face` of what else the sides are.
HWY_INLINE void PlaceSides(Vec3f apex, ShaftSides* sides) {
  const hn::CappedTag<double, ShaftSides::kMost> d;
  const hn::Rebind<float, decltype(d)> df;
  const hn::RebindToSigned<decltype(df)> di;
  for (size_t at = 0; at < ShaftSides::kMost; at += hn::Lanes(d)) {
    auto world = hn::PromoteTo(d, hn::Load(df, sides->local + at));
    for (int k = 0; k < 3; ++k) {
      const auto n = hn::Load(df, sides->n[k] + at);
      world = hn::MulAdd(hn::PromoteTo(d, n), hn::Set(d, double{apex[k]}), world);
      const auto rises = hn::RebindMask(di, hn::Ge(n, hn::Zero(df)));
      hn::Store(hn::IfThenElse(rises, hn::Set(di, k + 3), hn::Set(di, k)), di, sides->face[k] + at);
    }
    hn::Store(hn::DemoteTo(df, world), df, sides->world + at);
  }
}

// What receivers lie on the inner side of: normal·p <= most.
struct ReceiversCap {
  Vec3f normal;
  float most;
};

// The sides of a rectangle of slopes or offsets; the start of parallel rays at `near`; the end of
// segments at `far`, and the receivers' cap, where they are given.
template <bool kParallel>
HWY_INLINE void MakeShaftSides(const ShaftFrame& frame, Vec3f apex, const FrameRectangle& held,
                               float near, const float* far, const ReceiversCap* cap,
                               ShaftSides* sides) {
  const hn::CappedTag<float, 4> d;
  const auto minus = hn::OddEven(hn::SignBit(d), hn::Zero(d));
  // Left, right, below, above.
  const auto ends =
      hn::ConcatUpperLower(d, hn::OddEven(hn::Set(d, held.above), hn::Set(d, held.below)),
                           hn::OddEven(hn::Set(d, held.right), hn::Set(d, held.left)));
  const bool has_end = kParallel || far != nullptr;
  for (int k = 0; k < 3; ++k) {
    auto n = hn::ConcatUpperLower(d, hn::Set(d, frame.v[k]), hn::Set(d, frame.u[k]));
    if constexpr (!kParallel) n = hn::Sub(n, hn::Mul(hn::Set(d, frame.w[k]), ends));
    hn::Store(hn::Xor(n, minus), d, sides->n[k]);
    const float end = kParallel ? frame.w[k] : -frame.w[k];
    const float last = cap != nullptr ? -cap->normal[k] : 0.0f;
    hn::Store(has_end ? hn::OddEven(hn::Set(d, last), hn::Set(d, end)) : hn::Set(d, last), d,
              sides->n[k] + 4);
  }
  const float end = kParallel ? near : far != nullptr ? -*far : 0.0f;
  const float last = cap != nullptr ? -cap->most : 0.0f;
  hn::Store(kParallel ? hn::Xor(ends, minus) : hn::Zero(d), d, sides->local);
  hn::Store(has_end ? hn::OddEven(hn::Set(d, last), hn::Set(d, end)) : hn::Set(d, last), d,
            sides->local + 4);
  sides->count = 4 + (has_end ? 1 : 0) + (cap != nullptr ? 1 : 0);
  PlaceSides(apex, sides);
}

// A node's eight boxes against the sides: those that are not wholly beyond one of them.
HWY_INLINE hn::Mask<hn::CappedTag<float, kBvhWidth>> MeetsSides(const BvhNode& node,
                                                                const ShaftSides& sides,
                                                                float margin) {
  const hn::CappedTag<float, kBvhWidth> d8;
  auto least = hn::Set(d8, std::numeric_limits<float>::infinity());  // Of each box's largest value.
  for (int i = 0; i < sides.count; ++i) {
    auto value = hn::MulSub(hn::Set(d8, sides.n[0][i]), hn::Load(d8, node.bounds[sides.face[0][i]]),
                            hn::Set(d8, sides.world[i]));
    for (int k = 1; k < 3; ++k) {
      value = hn::MulAdd(hn::Set(d8, sides.n[k][i]), hn::Load(d8, node.bounds[sides.face[k][i]]),
                         value);
    }
    least = hn::Min(least, value);
  }
  return hn::Ge(least, hn::Set(d8, -margin));
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
