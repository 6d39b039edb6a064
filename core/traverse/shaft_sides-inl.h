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

// A plane with the shaft on its inner side: n·p >= local for p relative to the apex (or to R),
// n·x >= world for a stored point x.
struct ShaftSide {
  float n[3];
  float local, world;
  int face[3];  // Rows of a node's bounds where n·x is largest.
};

inline float Norm1(Vec3f v) { return std::abs(v.x) + std::abs(v.y) + std::abs(v.z); }

// Bounds |x|_1 over a box.
inline float FarthestNorm1(const Box3f& box) {
  float sum = 0;
  for (int k = 0; k < 3; ++k) sum += std::max(std::abs(box.lo[k]), std::abs(box.hi[k]));
  return sum;
}

inline void SetSide(Vec3f n, float local, Vec3f apex, ShaftSide* side) {
  side->local = local;
  double world = local;
  for (int k = 0; k < 3; ++k) {
    side->n[k] = n[k];
    side->face[k] = n[k] >= 0 ? k + 3 : k;
    world += static_cast<double>(n[k]) * apex[k];
  }
  side->world = static_cast<float>(world);
}

// The sides of a rectangle of slopes or offsets, the start of parallel rays at `near`, and the end
// of segments at `far`, if given. Returns how many.
template <bool kParallel>
int MakeShaftSides(const ShaftFrame& frame, Vec3f apex, const FrameRectangle& held, float near,
                   const float* far, ShaftSide* sides) {
  const Vec3f u = frame.u, v = frame.v, w = frame.w;
  const auto [left, right, below, above] = held;
  int count = 4;
  if constexpr (kParallel) {
    SetSide(u, left, apex, &sides[0]);
    SetSide(-u, -right, apex, &sides[1]);
    SetSide(v, below, apex, &sides[2]);
    SetSide(-v, -above, apex, &sides[3]);
    SetSide(w, near, apex, &sides[count++]);
  } else {
    SetSide(u - w * left, 0, apex, &sides[0]);
    SetSide(w * right - u, 0, apex, &sides[1]);
    SetSide(v - w * below, 0, apex, &sides[2]);
    SetSide(w * above - v, 0, apex, &sides[3]);
    if (far != nullptr) SetSide(-w, -*far, apex, &sides[count++]);
  }
  return count;
}

// A node's eight boxes against the sides: those that are not wholly beyond one of them.
HWY_INLINE hn::Mask<hn::CappedTag<float, kBvhWidth>> MeetsSides(const BvhNode& node,
                                                                const ShaftSide* sides, int count,
                                                                float margin) {
  const hn::CappedTag<float, kBvhWidth> d8;
  auto least = hn::Set(d8, std::numeric_limits<float>::infinity());  // Of each box's largest value.
  for (int i = 0; i < count; ++i) {
    const ShaftSide& side = sides[i];
    auto value = hn::MulSub(hn::Set(d8, side.n[0]), hn::Load(d8, node.bounds[side.face[0]]),
                            hn::Set(d8, side.world));
    value = hn::MulAdd(hn::Set(d8, side.n[1]), hn::Load(d8, node.bounds[side.face[1]]), value);
    value = hn::MulAdd(hn::Set(d8, side.n[2]), hn::Load(d8, node.bounds[side.face[2]]), value);
    least = hn::Min(least, value);
  }
  return hn::Ge(least, hn::Set(d8, -margin));
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
