// SPDX-License-Identifier: Apache-2.0
//
// A shaft's shadows on the three coordinate planes: each is a wedge with its point at the apex, or
// for parallel rays a strip, between two lines. A box that is larger than a shaft is thick reaches
// over all of the shaft's sides in corners that no ray passes; the box's own shadow, a rectangle,
// is then told from the wedge by one corner for each line. For a single ray this is the slab test.
//
// Thread safety: pure functions and plain values.

#if defined(SIGHTLINE_CORE_SHAFT_WEDGE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_SHAFT_WEDGE_INL_H_
#undef SIGHTLINE_CORE_SHAFT_WEDGE_INL_H_
#else
#define SIGHTLINE_CORE_SHAFT_WEDGE_INL_H_
#endif

#include <cmath>
#include <limits>

#include "core/geometry/vec3.h"
#include "core/shaft/frame.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// The shaft keeps to n[0]·x[axis 0] + n[1]·x[axis 1] >= world, for stored points x.
struct WedgeLine {
  float n[2];
  float world;  // Margin included.
  int face[2];  // Rows of a box (least x, y, z, largest x, y, z) where the sum is largest.
};

// Two lines for each plane. Those of a plane on which the shaft spreads too far let all pass.
struct ShaftWedges {
  WedgeLine line[6];
};

// What slopes, or offsets, are held between, their margins included.
struct FrameRectangle {
  float left, right, below, above;
};

// The two axes of each coordinate plane.
constexpr int kWedgeAxes[3][2] = {{1, 2}, {0, 2}, {0, 1}};
// A corner's shadow that leads less along the axis' own leaves a wedge too wide to part anything.
// From here on its direction, a quotient of doubles, is good to some 2^-40, far below a float's
// rounding.
constexpr double kLeastShadow = 0x1p-10;

using WedgeD = hn::CappedTag<double, 4>;
static_assert(hn::MaxLanes(WedgeD()) == 4, "a lane for each corner of a rectangle");
using WedgeV = hn::Vec<WedgeD>;

// The rectangle's corners at `depth`, from the apex (or the reference point), by axis.
HWY_INLINE void WedgeCorners(const ShaftFrame& frame, const FrameRectangle& at, double depth,
                             WedgeV (&corners)[3]) {
  const WedgeD d;
  HWY_ALIGN const double x[4] = {at.left, at.right, at.left, at.right};
  HWY_ALIGN const double y[4] = {at.below, at.below, at.above, at.above};
  const WedgeV xs = hn::Load(d, x), ys = hn::Load(d, y);
  for (int k = 0; k < 3; ++k) {
    corners[k] = hn::MulAdd(
        hn::Set(d, double{frame.u[k]}), xs,
        hn::MulAdd(hn::Set(d, double{frame.v[k]}), ys, hn::Set(d, double{frame.w[k]} * depth)));
  }
}

// n·(x - from) >= local - margin·|n|_1.
HWY_INLINE WedgeLine MakeWedgeLine(const int (&axes)[2], double n0, double n1, double local,
                                   Vec3f from, double margin) {
  WedgeLine line;
  line.n[0] = static_cast<float>(n0);
  line.n[1] = static_cast<float>(n1);
  line.world = static_cast<float>(local + n0 * from[axes[0]] + n1 * from[axes[1]] -
                                  margin * (std::abs(n0) + std::abs(n1)));
  line.face[0] = axes[0] + (n0 >= 0 ? 3 : 0);
  line.face[1] = axes[1] + (n1 >= 0 ? 3 : 0);
  return line;
}

HWY_INLINE void LetAllPass(WedgeLine* pair) {
  pair[0] = pair[1] = {.n = {0, 0}, .world = -std::numeric_limits<float>::max(), .face = {0, 0}};
}

// Of rays from `apex` with slopes within the rectangle. `margin`: kBoxMargin of the scene's
// farthest corner (margins.h).
HWY_INLINE void MakeApexWedges(const ShaftFrame& frame, Vec3f apex, const FrameRectangle& slopes,
                               float margin, ShaftWedges* wedges) {
  const WedgeD d;
  WedgeV corners[3];
  WedgeCorners(frame, slopes, 1, corners);
  for (int plane = 0; plane < 3; ++plane) {
    const int(&axes)[2] = kWedgeAxes[plane];
    WedgeLine* const pair = &wedges->line[2 * plane];
    const double a = frame.w[axes[0]], b = frame.w[axes[1]];
    const WedgeV c0 = corners[axes[0]], c1 = corners[axes[1]];
    const WedgeV along = hn::MulAdd(hn::Set(d, a), c0, hn::Mul(hn::Set(d, b), c1));
    if (!hn::AllTrue(d, hn::Gt(along, hn::Set(d, kLeastShadow)))) {
      LetAllPass(pair);
      continue;
    }
    // Each corner's shadow leads along (a, b) + t·(-b, a).
    const WedgeV t = hn::Div(hn::MulSub(hn::Set(d, a), c1, hn::Mul(hn::Set(d, b), c0)), along);
    const double t0 = hn::GetLane(hn::MinOfLanes(d, t)), t1 = hn::GetLane(hn::MaxOfLanes(d, t));
    pair[0] = MakeWedgeLine(axes, -(b + a * t0), a - b * t0, 0, apex, margin);
    pair[1] = MakeWedgeLine(axes, b + a * t1, b * t1 - a, 0, apex, margin);
  }
}

// Of rays along `direction` (frame.w, but for length and rounding) with offsets from `reference`
// within the rectangle.
HWY_INLINE void MakeParallelWedges(const ShaftFrame& frame, Vec3f direction, Vec3f reference,
                                   const FrameRectangle& offsets, float margin,
                                   ShaftWedges* wedges) {
  const WedgeD d;
  WedgeV corners[3];
  WedgeCorners(frame, offsets, 0, corners);
  const double size = MaxAbs(direction);
  for (int plane = 0; plane < 3; ++plane) {
    const int(&axes)[2] = kWedgeAxes[plane];
    WedgeLine* const pair = &wedges->line[2 * plane];
    const double a = direction[axes[0]], b = direction[axes[1]];
    const double length = std::abs(a) + std::abs(b);
    if (!(length > kLeastShadow * size)) {
      LetAllPass(pair);
      continue;
    }
    const double n0 = -b / length, n1 = a / length;
    const WedgeV at =
        hn::MulAdd(hn::Set(d, n0), corners[axes[0]], hn::Mul(hn::Set(d, n1), corners[axes[1]]));
    const double least = hn::GetLane(hn::MinOfLanes(d, at));
    const double most = hn::GetLane(hn::MaxOfLanes(d, at));
    pair[0] = MakeWedgeLine(axes, n0, n1, least, reference, margin);
    pair[1] = MakeWedgeLine(axes, -n0, -n1, -most, reference, margin);
  }
}

// How far boxes reach to the inner side of all lines, at least: negative where one is wholly beyond
// a line. `faces` has a row for each face, as WedgeLine counts them, with a lane for each box.
template <class D>
HWY_INLINE hn::Vec<D> WithinWedges(D d, const ShaftWedges& wedges,
                                   const float (*faces)[hn::MaxLanes(D())]) {
  auto least = hn::Set(d, std::numeric_limits<float>::infinity());
  for (const WedgeLine& line : wedges.line) {
    const auto sum = hn::MulAdd(hn::Set(d, line.n[0]), hn::Load(d, faces[line.face[0]]),
                                hn::MulSub(hn::Set(d, line.n[1]), hn::Load(d, faces[line.face[1]]),
                                           hn::Set(d, line.world)));
    least = hn::Min(least, sum);
  }
  return least;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
