// SPDX-License-Identifier: Apache-2.0
#include "core/query/touch_candidates.h"

#include <algorithm>
#include <cmath>

#include "core/base/check.h"
#include "core/query/box_walk.h"
#include "core/query/id_lanes.h"
#include "core/traverse/leaf_view.h"

namespace sightline {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Four = hn::CappedTag<double, 4>;
static_assert(hn::MaxLanes(Four()) == 4, "x86-64-v3 holds four doubles in a vector");

}  // namespace

bool TouchCandidates::Gather(const IndexedGeometry& scene, const Box3f& box, double norm_one,
                             uint32_t most) {
  SIGHTLINE_DCHECK(most <= kMost);
  count_ = 0;
  norm_one_ = norm_one;
  bool fits = true;
  const bool may_repeat = scene.kd_tree_alone();
  ForEachMeeting(scene, box, [&](const LeafView& leaf, uint32_t lane) {
    if (may_repeat && std::find(ids_, ids_ + count_, leaf.id(lane)) != ids_ + count_) return true;
    if (count_ == most) return fits = false;
    auto& [a, b, c] = corners_[count_];
    a = leaf.corner(0, lane), b = leaf.corner(1, lane), c = leaf.corner(2, lane);
    for (int axis = 0; axis < 3; ++axis) {
      lo_[axis][count_] = std::min(std::min(a[axis], b[axis]), c[axis]);
      hi_[axis][count_] = std::max(std::max(a[axis], b[axis]), c[axis]);
    }
    has_planes_[count_] = false;
    ids_[count_++] = leaf.id(lane);
    return true;
  });
  if (!fits) count_ = 0;
  return fits;
}

// Bit k: candidate first + k has a box that meets `within`.
uint32_t TouchCandidates::Meeting(uint32_t first, const Box3f& within) const {
  const box_walk::Eight d;
  box_walk::V lo[3], hi[3];
  for (int axis = 0; axis < 3; ++axis) {
    lo[axis] = hn::Load(d, lo_[axis] + first);
    hi[axis] = hn::Load(d, hi_[axis] + first);
  }
  const uint32_t used = std::min(count_ - first, 8u);
  return box_walk::Bits(box_walk::Meets(lo, hi, within)) & ((1u << used) - 1);
}

// The margin. A point farther than d outside a plane that has the whole triangle on its other side
// is farther than d from it, whatever the plane's normal; the offsets are taken over all three
// corners, so a normal that is bad in doubles makes a plane useless, not wrong. What is to be shown
// is more: that Touches, which computes in doubles, would not find the point near.
//  * s and the offsets lose less than 2^-49·D, where D = |x|₁ + max|V|₁ >= |x - A|.
//  * A closest point on an edge lies on it but for 2^-50·D.
//  * One within the triangle is the foot on its plane, which the tests for being inside may let
//    through though it lies outside: by 2^-49·D·κ from an edge's line, where κ = L²/|N| (the
//    longest edge squared by twice the area) tells how much worse than one rounding N is; where two
//    edges meet at an angle whose sine is at least 1/κ, by 2·κ times that from the triangle. And it
//    lies off the plane by 2^-49·D·κ.
// Together below 2^-46·D·κ², as κ >= 1. Four times that is added to the radius, and the radius
// itself is doubled.
TouchPlanes TouchCandidates::PlanesOf(uint32_t k, double per_vertex) const {
  constexpr double kLost = 0x1p-44;
  const Four d;
  const Vec3d a = ToDouble(corners_[k][0]), b = ToDouble(corners_[k][1]),
              c = ToDouble(corners_[k][2]);
  const Vec3d ab = b - a, bc = c - b, ca = a - c;
  const Vec3d n = Cross(ab, bc);
  const Vec3d out[4] = {n, Cross(ab, n), Cross(bc, n), Cross(ca, n)};
  TouchPlanes planes;
  for (int lane = 0; lane < 4; ++lane) {
    planes.x[lane] = out[lane].x;
    planes.y[lane] = out[lane].y;
    planes.z[lane] = out[lane].z;
  }
  auto x = hn::Load(d, planes.x), y = hn::Load(d, planes.y), z = hn::Load(d, planes.z);
  const auto length = hn::Sqrt(hn::MulAdd(x, x, hn::MulAdd(y, y, hn::Mul(z, z))));
  const auto scale = hn::Div(hn::Set(d, 1.0), length);  // No length: NaN, which parts nothing.
  x = hn::Mul(x, scale), y = hn::Mul(y, scale), z = hn::Mul(z, scale);
  const auto along = [&](Vec3d v) {
    return hn::MulAdd(x, hn::Set(d, v.x),
                      hn::MulAdd(y, hn::Set(d, v.y), hn::Mul(z, hn::Set(d, v.z))));
  };
  const auto at_a = along(a), at_b = along(b), at_c = along(c);
  const auto highest = hn::Max(hn::Max(at_a, at_b), at_c);
  const auto lowest = hn::Min(hn::Min(at_a, at_b), at_c);
  const double longest = std::max({Dot(ab, ab), Dot(bc, bc), Dot(ca, ca)});
  const double conditioning = longest / Length(n);
  const double largest = std::max({NormOne(a), NormOne(b), NormOne(c)});
  const double margin =
      2 * per_vertex * largest + kLost * (norm_one_ + largest) * (conditioning * conditioning);
  const auto first = hn::FirstN(d, 1);
  hn::Store(x, d, planes.x);
  hn::Store(y, d, planes.y);
  hn::Store(z, d, planes.z);
  hn::Store(highest, d, planes.offset);
  // Below the highest corner the triangle's plane has the others: to both sides by the same reach.
  hn::Store(hn::Add(hn::IfThenElseZero(first, hn::Sub(highest, lowest)), hn::Set(d, margin)), d,
            planes.reach);
  return planes;
}

// Bit i: point i may touch candidate k.
uint32_t TouchCandidates::NotApart(uint32_t k, const TouchPoints& points) {
  const uint32_t others =
      points.used & ~(WhereIs(ids_[k], points.source) | WhereIs(ids_[k], points.source + 8) << 8);
  if (others == 0) return 0;
  if (!has_planes_[k]) {
    planes_[k] = PlanesOf(k, points.per_vertex);
    has_planes_[k] = true;
  }
  return kernels_.not_apart(planes_[k], points) & others;
}

}  // namespace sightline
