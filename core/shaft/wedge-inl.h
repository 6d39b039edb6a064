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

#include <cstdint>
#include <limits>

#include "core/geometry/vec3.h"
#include "core/shaft/frame.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Lines that the shaft keeps to the inner side of: n[0]·x[axis 0] + n[1]·x[axis 1] >= world, for
// stored points x. Two for each plane, by lane: plane p's are p and p + 4, the other two lanes are
// none. Those of a plane on which the shaft spreads too far let all pass.
struct ShaftWedges {
  static constexpr int kLanes = 8;
  static constexpr int kLines[] = {0, 1, 2, 4, 5, 6};

  alignas(32) float n[2][kLanes];
  alignas(32) float world[kLanes];  // Margin included.
  // Rows of a box (least x, y, z, largest x, y, z) where the sum is largest.
  alignas(32) int32_t face[2][kLanes];
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
static_assert(hn::MaxLanes(WedgeD()) == 4, "a lane for each corner of a rectangle, or each plane");
using WedgeV = hn::Vec<WedgeD>;

// The rectangle's corners at `depth`, from the apex (or the reference point), by axis.
HWY_INLINE void WedgeCorners(const ShaftFrame& frame, const FrameRectangle& at, double depth,
                             WedgeV (&corners)[3]) {
  const WedgeD d;
  const WedgeV xs = hn::OddEven(hn::Set(d, double{at.right}), hn::Set(d, double{at.left}));
  const WedgeV ys =
      hn::ConcatUpperLower(d, hn::Set(d, double{at.above}), hn::Set(d, double{at.below}));
  for (int k = 0; k < 3; ++k) {
    corners[k] = hn::MulAdd(
        hn::Set(d, double{frame.u[k]}), xs,
        hn::MulAdd(hn::Set(d, double{frame.v[k]}), ys, hn::Set(d, double{frame.w[k]} * depth)));
  }
}

// A vector's component along the first, or the second, axis of each plane (kWedgeAxes), by lane.
HWY_INLINE WedgeV AlongFirst(Vec3f v) {
  const WedgeD d;
  return hn::IfThenElse(hn::FirstN(d, 1), hn::Set(d, double{v.y}), hn::Set(d, double{v.x}));
}
HWY_INLINE WedgeV AlongSecond(Vec3f v) {
  const WedgeD d;
  return hn::IfThenElse(hn::FirstN(d, 2), hn::Set(d, double{v.z}), hn::Set(d, double{v.y}));
}

// op over the lanes of each of three vectors, by vector.
template <class Op>
HWY_INLINE WedgeV OverLanes(const Op& op, const WedgeV (&v)[3]) {
  const WedgeD d;
  const WedgeV first = op(hn::InterleaveLower(d, v[0], v[1]), hn::InterleaveUpper(d, v[0], v[1]));
  const WedgeV second = op(hn::InterleaveLower(d, v[2], v[2]), hn::InterleaveUpper(d, v[2], v[2]));
  return op(hn::ConcatLowerLower(d, second, first), hn::ConcatUpperUpper(d, second, first));
}
HWY_INLINE WedgeV LeastOfLanes(const WedgeV (&v)[3]) {
  return OverLanes([](WedgeV a, WedgeV b) HWY_ATTR { return hn::Min(a, b); }, v);
}
HWY_INLINE WedgeV MostOfLanes(const WedgeV (&v)[3]) {
  return OverLanes([](WedgeV a, WedgeV b) HWY_ATTR { return hn::Max(a, b); }, v);
}

// One line of each plane, as lanes `first` .. of *wedges: n·(x - from) >= local - margin·|n|_1; of
// planes that are not `held`, one that lets all pass.
HWY_INLINE void PutWedgeLines(WedgeV n0, WedgeV n1, WedgeV local, Vec3f from, double margin,
                              hn::Mask<WedgeD> held, int first, ShaftWedges* wedges) {
  const WedgeD d;
  const hn::Rebind<float, WedgeD> df;
  const hn::RebindToSigned<decltype(df)> di;
  n0 = hn::IfThenElseZero(held, n0);
  n1 = hn::IfThenElseZero(held, n1);
  WedgeV world = hn::MulAdd(n0, AlongFirst(from), local);
  world = hn::MulAdd(n1, AlongSecond(from), world);
  world = hn::NegMulAdd(hn::Set(d, margin), hn::Add(hn::Abs(n0), hn::Abs(n1)), world);
  world = hn::IfThenElse(held, world, hn::Set(d, -double{std::numeric_limits<float>::max()}));
  hn::Store(hn::DemoteTo(df, world), df, wedges->world + first);
  alignas(16) static constexpr int32_t kAxes[2][4] = {
      {kWedgeAxes[0][0], kWedgeAxes[1][0], kWedgeAxes[2][0]},
      {kWedgeAxes[0][1], kWedgeAxes[1][1], kWedgeAxes[2][1]}};
  const WedgeV* const n[2] = {&n0, &n1};
  for (int i = 0; i < 2; ++i) {
    const auto along = hn::DemoteTo(df, *n[i]);
    hn::Store(along, df, wedges->n[i] + first);
    const auto rises = hn::RebindMask(di, hn::Ge(along, hn::Zero(df)));
    hn::Store(hn::Add(hn::Load(di, kAxes[i]), hn::IfThenElseZero(rises, hn::Set(di, 3))), di,
              wedges->face[i] + first);
  }
}

// Of rays from `apex` with slopes within the rectangle. `margin`: kBoxMargin of the scene's
// farthest corner (margins.h).
HWY_INLINE void MakeApexWedges(const ShaftFrame& frame, Vec3f apex, const FrameRectangle& slopes,
                               float margin, ShaftWedges* wedges) {
  const WedgeD d;
  WedgeV c[3];
  WedgeCorners(frame, slopes, 1, c);
  const WedgeV axis[3] = {hn::Set(d, double{frame.w.x}), hn::Set(d, double{frame.w.y}),
                          hn::Set(d, double{frame.w.z})};
  // Each corner's shadow leads along (a, b) + t·(-b, a), where the axis' own leads along (a, b).
  WedgeV along[3], t[3];
  for (int plane = 0; plane < 3; ++plane) {
    const auto [i, j] = kWedgeAxes[plane];
    const WedgeV all = hn::MulAdd(axis[i], c[i], hn::Mul(axis[j], c[j]));
    along[plane] = hn::IfThenElseZero(hn::Gt(all, hn::Set(d, kLeastShadow)), all);
    t[plane] = hn::Div(hn::MulSub(axis[i], c[j], hn::Mul(axis[j], c[i])), all);
  }
  const auto held = hn::Gt(LeastOfLanes(along), hn::Zero(d));
  const WedgeV a = AlongFirst(frame.w), b = AlongSecond(frame.w);
  const WedgeV t0 = LeastOfLanes(t), t1 = MostOfLanes(t), zero = hn::Zero(d);
  PutWedgeLines(hn::NegMulSub(a, t0, b), hn::NegMulAdd(b, t0, a), zero, apex, margin, held, 0,
                wedges);
  PutWedgeLines(hn::MulAdd(a, t1, b), hn::MulSub(b, t1, a), zero, apex, margin, held, 4, wedges);
}

// Of rays along `direction` (frame.w, but for length and rounding) with offsets from `reference`
// within the rectangle.
HWY_INLINE void MakeParallelWedges(const ShaftFrame& frame, Vec3f direction, Vec3f reference,
                                   const FrameRectangle& offsets, float margin,
                                   ShaftWedges* wedges) {
  const WedgeD d;
  WedgeV c[3];
  WedgeCorners(frame, offsets, 0, c);
  const WedgeV axis[3] = {hn::Set(d, double{direction.x}), hn::Set(d, double{direction.y}),
                          hn::Set(d, double{direction.z})};
  WedgeV across[3];  // Times |(a, b)|_1, where the direction's shadow leads along (a, b).
  for (int plane = 0; plane < 3; ++plane) {
    const auto [i, j] = kWedgeAxes[plane];
    across[plane] = hn::MulSub(axis[i], c[j], hn::Mul(axis[j], c[i]));
  }
  const WedgeV a = AlongFirst(direction), b = AlongSecond(direction);
  const WedgeV length = hn::Add(hn::Abs(a), hn::Abs(b));
  const auto held = hn::Gt(length, hn::Set(d, kLeastShadow * MaxAbs(direction)));
  const WedgeV inverse = hn::Div(hn::Set(d, 1.0), length);
  const WedgeV n0 = hn::Neg(hn::Mul(b, inverse)), n1 = hn::Mul(a, inverse);
  PutWedgeLines(n0, n1, hn::Mul(LeastOfLanes(across), inverse), reference, margin, held, 0, wedges);
  PutWedgeLines(hn::Neg(n0), hn::Neg(n1), hn::Neg(hn::Mul(MostOfLanes(across), inverse)), reference,
                margin, held, 4, wedges);
}

// How far boxes reach to the inner side of all lines, at least: negative where one is wholly beyond
// a line. `faces` has a row for each face, as ShaftWedges counts them, with a lane for each box.
template <class D>
HWY_INLINE hn::Vec<D> WithinWedges(D d, const ShaftWedges& wedges,
                                   const float (*faces)[hn::MaxLanes(D())]) {
  auto least = hn::Set(d, std::numeric_limits<float>::infinity());
  for (const int i : ShaftWedges::kLines) {
    const auto sum =
        hn::MulAdd(hn::Set(d, wedges.n[0][i]), hn::Load(d, faces[wedges.face[0][i]]),
                   hn::MulSub(hn::Set(d, wedges.n[1][i]), hn::Load(d, faces[wedges.face[1][i]]),
                              hn::Set(d, wedges.world[i])));
    least = hn::Min(least, sum);
  }
  return least;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
