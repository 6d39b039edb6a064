// SPDX-License-Identifier: Apache-2.0
//
// Which of the leaves beside a packet's points are clear, and toward what (clear_leaves.h).
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_CLEAR_LEAVES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_CLEAR_LEAVES_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_CLEAR_LEAVES_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_CLEAR_LEAVES_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/accel/indexed_geometry.h"
#include "core/geometry/vec3.h"
#include "core/intersect/predicate-inl.h"
#include "core/shaft/frame.h"
#include "core/traverse/clear_leaves.h"
#include "core/traverse/leaf_corners-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/plane_side-inl.h"
#include "core/traverse/point_ground.h"
#include "core/traverse/shaft_lanes-inl.h"
#include "core/traverse/trace_ray.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Normals of a packet's points in doubles, by axis.
using PointNormals = double[3][PointGrounds::kMaxPoints];

// Squares of lengths from here on carry what underflows in them as a rounding.
constexpr float kLeastSquare = 0x1p-100f;

class ClearLeafSearch {
 public:
  using V = ShaftV;
  using M = ShaftM;
  using V3 = Vec3V<V>;

  ClearLeafSearch(const IndexedGeometry& scene, const PointGrounds& grounds,
                  const PointNormals& normals, ClearLeaves* out, WalkStats* stats)
      : scene_(scene), grounds_(grounds), normals_(normals), out_(*out), stats_(*stats) {}

  void Run() {
    out_.count = 0;
    PlaceBlocks();
    for (uint32_t k = 0; even_ != 0 && k < grounds_.leaf_count && pairs_ < kMostPairs; ++k) {
      const ChildRef ref = ChildRef::FromBits(grounds_.leaf[k]);
      ++stats_.leaves;
      if (!Place(LeafView(scene_, ref), &out_.leaves[out_.count])) continue;
      out_.leaf[out_.count++] = ref.bits();
    }
    stats_.triangle_tests += uint64_t{pairs_} * kShaftBlockRays;
  }

 private:
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  static constexpr float kSlack = 2 * kGroundSlack;
  // More than the root of what a sum of three squares loses where they underflow; and a length
  // whose square does not.
  static constexpr float kSquareUnderflow = 0x1p-72f;
  static constexpr float kLeastLength = 0x1p-60f;
  // Of |there|: up and along are at right angles but for 2^-13 then.
  static constexpr float kLeastAside = 0x1p-8f;
  // What a normal may be off by: beyond, a triangle is a sliver.
  static constexpr float kMostOff = 0x1p-8f;
  // How far up is tilted, as a tangent, before points are asked about by themselves; and at most.
  static constexpr float kLowTilt = 8;
  static constexpr float kMostTilt = 0x1p20f;
  // Pairs of a triangle and a block whose points are, at most.
  static constexpr uint32_t kMostPairs = 2048;
  // A block's normals have a mean that long, or no plane serves many of its points: then nothing is
  // clear of them.
  static constexpr double kEven = 0.9;

  void PlaceBlocks() {
    const ShaftD d;
    HWY_ALIGN float lo[3][kShaftBlocks], hi[3][kShaftBlocks], sum[3][kShaftBlocks];
    const float* const points[3] = {grounds_.x, grounds_.y, grounds_.z};
    const float* const normals[3] = {grounds_.normal_x, grounds_.normal_y, grounds_.normal_z};
    for (int k = 0; k < 3; ++k) {
      const float* const row = normals[k];
      ReduceBlocks([](V a, V b) HWY_ATTR { return hn::Add(a, b); },
                   [row](size_t at) HWY_ATTR { return hn::Load(ShaftD(), row + at); }, sum[k]);
      BlockRanges<uint16_t>(points[k], nullptr, lo[k], hi[k]);
    }
    const auto blocks =
        static_cast<uint32_t>((grounds_.count + kShaftBlockRays - 1) / kShaftBlockRays);
    even_ = 0;
    for (uint32_t b = 0; b < kShaftBlocks; ++b) {
      const Vec3d all = {double{sum[0][b]}, double{sum[1][b]}, double{sum[2][b]}};
      const double length = Length(all);
      const bool even = b < blocks && length >= kEven * kShaftBlockRays;
      const Vec3f up = even ? ToFloat(all * (1 / length)) : Vec3f{0, 0, 0};
      even_ |= (even ? 1u : 0u) << b;
      Vec3f centre;
      for (int k = 0; k < 3; ++k) {
        centre[k] = static_cast<float>(0.5 * (double{lo[k][b]} + double{hi[k][b]}));
      }
      V farthest = hn::Zero(d), lowest = hn::Zero(d);
      const V3 own_up = Broadcast(d, up.x, up.y, up.z);
      const V3 middle = Broadcast(d, centre.x, centre.y, centre.z);
      const size_t first = size_t{b} * kShaftBlockRays;
      for (size_t at = first; at < first + kShaftBlockRays; at += hn::Lanes(d)) {
        const V3 from = SubV(Points(at), middle);
        farthest = hn::Max(farthest, DotV(from, from));
        lowest = hn::Min(lowest, DotV(own_up, from));
      }
      const float reach = std::sqrt(hn::GetLane(hn::MaxOfLanes(d, farthest))) * (1 + kGroundSlack) +
                          kSquareUnderflow;
      out_.up_x[b] = up.x;
      out_.up_y[b] = up.y;
      out_.up_z[b] = up.z;
      out_.centre_x[b] = centre.x;
      out_.centre_y[b] = centre.y;
      out_.centre_z[b] = centre.z;
      out_.reach[b] = reach;
      below_[b] = kSlack * reach - hn::GetLane(hn::MinOfLanes(d, lowest));
      ShaftFrame frame;
      const bool has_frame = even && MakeShaftFrame(ToDouble(up), {0, 0, 0}, &frame);
      across_[b][0] = has_frame ? frame.u : Vec3f{0, 0, 0};
      across_[b][1] = has_frame ? frame.v : Vec3f{0, 0, 0};
    }
    double square = 0;
    for (int k = 0; k < 3; ++k) {
      const double least = double{*std::min_element(lo[k], lo[k] + blocks)};
      const double most = double{*std::max_element(hi[k], hi[k] + blocks)};
      const auto middle = static_cast<float>(0.5 * (least + most));
      out_.centre[k] = middle;
      const double far = std::max(most - double{middle}, double{middle} - least);
      square += far * far;
    }
    out_.radius = static_cast<float>(std::sqrt(square)) * (1 + kGroundSlack) + kFloatUnderflow;
  }

  // What the leaf asks for. False: it is clear of no block.
  bool Place(const LeafView& leaf, ClearLeaves::Leaf* out) {
    const ShaftD d;
    std::fill_n(out->plane_x, kShaftBlocks, 0.0f);
    std::fill_n(out->plane_y, kShaftBlocks, 0.0f);
    std::fill_n(out->plane_z, kShaftBlocks, 0.0f);
    std::fill_n(out->own_tilt, kShaftBlocks, -kInfinity);
    std::fill_n(out->before, kShaftBlocks, uint16_t{0});
    std::fill_n(out->behind, kShaftBlocks, uint16_t{0});
    out->sides = false;
    V3 sum = {hn::Zero(d), hn::Zero(d), hn::Zero(d)};
    for (uint32_t first = 0; first < leaf.count; first += static_cast<uint32_t>(hn::Lanes(d))) {
      const V3 corners[3] = {LeafCorner(leaf, 0, first), LeafCorner(leaf, 1, first),
                             LeafCorner(leaf, 2, first)};
      PlaceNormals(corners, first, out);
      const M in_use = hn::FirstN(d, leaf.count - first);
      for (const V3& corner : corners) {
        sum = {hn::Add(sum.x, hn::IfThenElseZero(in_use, corner.x)),
               hn::Add(sum.y, hn::IfThenElseZero(in_use, corner.y)),
               hn::Add(sum.z, hn::IfThenElseZero(in_use, corner.z))};
      }
    }
    const float share = 1.0f / (3.0f * static_cast<float>(leaf.count));
    const Vec3f centre = {share * hn::GetLane(hn::SumOfLanes(d, sum.x)),
                          share * hn::GetLane(hn::SumOfLanes(d, sum.y)),
                          share * hn::GetLane(hn::SumOfLanes(d, sum.z))};
    bool some = false;
    for (uint32_t left = even_; left != 0; left &= left - 1) {
      some |= PlacePlane(leaf, centre, static_cast<uint32_t>(std::countr_zero(left)), out);
    }
    return some;
  }

  // The leaf's plane for block b: up, tilted away from the leaf's middle. False: it is not clear of
  // the block.
  HWY_INLINE bool PlacePlane(const LeafView& leaf, Vec3f centre, uint32_t b,
                             ClearLeaves::Leaf* out) {
    const ShaftD d;
    const Vec3f up = {out_.up_x[b], out_.up_y[b], out_.up_z[b]};
    const Vec3f middle = {out_.centre_x[b], out_.centre_y[b], out_.centre_z[b]};
    // Of a leaf straight above or below, what is left across up is roundings, and may lead up, too.
    const Vec3f there = centre - middle;
    Vec3f along = there - up * Dot(up, there);
    const float length = std::sqrt(Dot(along, along));
    const bool aside = length > std::max(kLeastLength, kLeastAside * std::sqrt(Dot(there, there)));
    along = aside ? along * (1 / length) : Vec3f{0, 0, 0};
    const V3 upward = Broadcast(d, up.x, up.y, up.z);
    const V3 toward = Broadcast(d, along.x, along.y, along.z);
    const V3 origin = Broadcast(d, middle.x, middle.y, middle.z);
    V farthest = hn::Set(d, -kInfinity);
    const size_t at = size_t{b} * kShaftBlockRays;
    for (size_t i = at; i < at + kShaftBlockRays; i += hn::Lanes(d)) {
      farthest = hn::Max(farthest, DotV(toward, SubV(Points(i), origin)));
    }
    const V ahead = hn::Set(
        d, hn::GetLane(hn::MaxOfLanes(d, farthest)) + kSlack * out_.reach[b] + kFloatUnderflow);
    const V below = hn::Set(d, below_[b] + kFloatUnderflow);
    float tilt = 0;
    for (uint32_t first = 0; first < leaf.count; first += static_cast<uint32_t>(hn::Lanes(d))) {
      V highest = hn::Set(d, -kInfinity), nearest = hn::Set(d, kInfinity), tilts = hn::Zero(d);
      for (int k = 0; k < 3; ++k) {
        const V3 from = SubV(LeafCorner(leaf, k, first), origin);
        const V lost = hn::Mul(Norm1V(from), hn::Set(d, kSlack));
        const V high = hn::Add(hn::Add(DotV(upward, from), below), lost);
        const V far = hn::Sub(hn::Sub(DotV(toward, from), ahead), lost);
        highest = hn::Max(highest, high);
        nearest = hn::Min(nearest, far);
        tilts = hn::Max(tilts, hn::Div(high, far));
      }
      tilts = hn::IfThenElse(hn::Gt(nearest, hn::Zero(d)), tilts, hn::Set(d, kInfinity));
      tilts = hn::IfThenElse(hn::Le(highest, hn::Zero(d)), hn::Zero(d), tilts);
      tilts = hn::IfThenElseZero(hn::FirstN(d, leaf.count - first), tilts);
      const M steep = hn::Gt(tilts, hn::Set(d, kLowTilt));
      const V low = hn::IfThenElse(steep, hn::Zero(d), tilts);
      tilt = std::max(tilt, hn::GetLane(hn::MaxOfLanes(d, low)));
      uint32_t left = MaskBits(d, steep);
      if (left == 0) continue;
      HWY_ALIGN float each[kMaxLeafTriangles];
      hn::Store(tilts, d, each);
      for (; left != 0; left &= left - 1) {
        const auto i = static_cast<uint32_t>(std::countr_zero(left));
        const float own = PointsTilt(leaf, first + i, b, out);
        if (own < kMostClearTilt) {
          out->own_tilt[b] = std::max(out->own_tilt[b], own);
        } else if (each[i] < kMostTilt) {
          tilt = std::max(tilt, each[i]);
        } else {
          return false;
        }
      }
    }
    const Vec3f tilted = up - along * tilt;
    const Vec3f plane = tilted * (1 / std::sqrt(Dot(tilted, tilted)));
    out->plane_x[b] = plane.x;
    out->plane_y[b] = plane.y;
    out->plane_z[b] = plane.z;
    return true;
  }

  // Slivers have none, nor has what is so small that its square underflows: zero, which nothing is
  // before.
  HWY_INLINE void PlaceNormals(const V3 (&corners)[3], uint32_t first,
                               ClearLeaves::Leaf* out) const {
    const ShaftD d;
    const V3 ab = SubV(corners[1], corners[0]), bc = SubV(corners[2], corners[1]);
    const V3 normal = CrossV(ab, bc);
    const V square = DotV(normal, normal);
    const V inverse = hn::Div(hn::Set(d, 1.0f), hn::Sqrt(square));
    const V bound = hn::Mul(hn::MulAdd(hn::Set(d, kFloatUnits), hn::Mul(Norm1V(ab), Norm1V(bc)),
                                       hn::Set(d, kFloatUnderflow)),
                            inverse);
    const M sound =
        hn::And(hn::Ge(square, hn::Set(d, kLeastSquare)), hn::Lt(bound, hn::Set(d, kMostOff)));
    hn::Store(hn::IfThenElseZero(sound, hn::Mul(normal.x, inverse)), d, out->normal_x + first);
    hn::Store(hn::IfThenElseZero(sound, hn::Mul(normal.y, inverse)), d, out->normal_y + first);
    hn::Store(hn::IfThenElseZero(sound, hn::Mul(normal.z, inverse)), d, out->normal_z + first);
    hn::Store(hn::IfThenElse(sound, hn::Add(bound, hn::Set(d, kGroundSlack)), hn::Set(d, 4.0f)), d,
              out->off + first);
  }

  // Of triangle i and each of a block's points by itself, from its own normal. Those that are on
  // the upper side of the triangle's plane need no tilt; a wall has two such sides.
  HWY_NOINLINE float PointsTilt(const LeafView& leaf, uint32_t i, uint32_t b,
                                ClearLeaves::Leaf* out) {
    const ShaftD d;
    if (++pairs_ >= kMostPairs) return kInfinity;
    const Vec3f corners[3] = {leaf.corner(0, i), leaf.corner(1, i), leaf.corner(2, i)};
    const Vec3f n = {out->normal_x[i], out->normal_y[i], out->normal_z[i]};
    const float rises = n.x * out_.up_x[b] + n.y * out_.up_y[b] + n.z * out_.up_z[b];
    const auto bit = static_cast<uint16_t>(1u << i);
    float worst = 0;
    const size_t first = size_t{b} * kShaftBlockRays;
    for (size_t at = first; at < first + kShaftBlockRays; at += hn::Lanes(d)) {
      M rest = Above(corners, at);
      if (hn::AllFalse(d, rest)) continue;
      const V side = SideOfPlane(corners, n, out->off[i], at, rest);
      const M before = hn::And(rest, hn::Gt(side, hn::Zero(d)));
      const M behind = hn::And(rest, hn::Lt(side, hn::Zero(d)));
      const M upper = rises > 0 ? before : behind, lower = rises > 0 ? behind : before;
      uint16_t* const own = rises > 0 ? out->before : out->behind;
      uint16_t* const other = rises > 0 ? out->behind : out->before;
      if (!hn::AllFalse(d, upper)) {
        own[b] |= bit;
        out->sides = true;
        rest = hn::AndNot(upper, rest);
        if (hn::AllFalse(d, rest)) continue;
      }
      rest = hn::And(rest, AboveInDoubles(corners, at));
      if (hn::AllFalse(d, rest)) continue;
      const V tilt = hn::IfThenElseZero(rest, Tilt(corners, b, at));
      const float most = hn::GetLane(hn::MaxOfLanes(d, tilt));
      if (!(most < kMostClearTilt) && std::abs(rises) < 0.5f &&
          hn::AllFalse(d, hn::AndNot(lower, rest))) {
        other[b] |= bit;
        out->sides = true;
        continue;
      }
      worst = std::max(worst, most);
    }
    return worst;
  }

  // Those points that floats do not see the triangle to be below.
  HWY_INLINE M Above(const Vec3f (&corners)[3], size_t at) const {
    const ShaftD d;
    const V3 p = Points(at), up = Up(at);
    V highest = hn::Set(d, -kInfinity);
    for (const Vec3f& corner : corners) {
      const V3 to = SubV(Broadcast(d, corner.x, corner.y, corner.z), p);
      const V lost =
          hn::MulAdd(Norm1V(to), hn::Set(d, 0.5f * kGroundSlack), hn::Set(d, kFloatUnderflow));
      highest = hn::Max(highest, hn::Add(DotV(up, to), lost));
    }
    return hn::Gt(highest, hn::Zero(d));
  }

  // The side of a triangle's plane that points are on, as its normal has it: 1, -1, or 0 where
  // doubles cannot tell, or nobody asks.
  HWY_INLINE V SideOfPlane(const Vec3f (&corners)[3], Vec3f n, float off, size_t at,
                           M asked) const {
    const ShaftD d;
    const V3 p = Points(at);
    const V3 from = SubV(p, Broadcast(d, corners[0].x, corners[0].y, corners[0].z));
    const V height = DotV(Broadcast(d, n.x, n.y, n.z), from);
    const V lost = hn::MulAdd(hn::Set(d, off), Norm1V(from), hn::Set(d, kFloatUnderflow));
    const V zero = hn::Zero(d), one = hn::Set(d, 1.0f);
    const V side = hn::IfThenElse(hn::Gt(height, lost), one,
                                  hn::IfThenElseZero(hn::Lt(height, hn::Neg(lost)), hn::Neg(one)));
    if (off > 1 || hn::AllFalse(d, hn::And(asked, hn::Eq(side, zero)))) return side;
    const Vec3d a = ToDouble(corners[0]), b = ToDouble(corners[1]), c = ToDouble(corners[2]);
    return SideInDoubles(b - a, c - b, 1.0f, &corners[0], p);
  }

  // Those points that the triangle may not lie below.
  HWY_INLINE M AboveInDoubles(const Vec3f (&corners)[3], size_t at) const {
    const hn::Half<ShaftD> df;
    const hn::Rebind<double, decltype(df)> d;
    const size_t width = hn::Lanes(d);
    uint32_t bits[2] = {0};  // LoadMaskBits may read as many.
    for (size_t i = 0; i < hn::Lanes(ShaftD()); i += width) {
      const auto point = [&](const float* row)
                             HWY_ATTR { return hn::PromoteTo(d, hn::Load(df, row + at + i)); };
      const auto x = point(grounds_.x), y = point(grounds_.y), z = point(grounds_.z);
      const auto up_x = hn::Load(d, normals_[0] + at + i), up_y = hn::Load(d, normals_[1] + at + i),
                 up_z = hn::Load(d, normals_[2] + at + i);
      auto highest = hn::Set(d, -std::numeric_limits<double>::infinity());
      for (const Vec3f& corner : corners) {
        const auto to_x = hn::Sub(hn::Set(d, double{corner.x}), x);
        const auto to_y = hn::Sub(hn::Set(d, double{corner.y}), y);
        const auto to_z = hn::Sub(hn::Set(d, double{corner.z}), z);
        const auto size = hn::Add(hn::Add(hn::Abs(to_x), hn::Abs(to_y)), hn::Abs(to_z));
        const auto value = hn::MulAdd(up_x, to_x, hn::MulAdd(up_y, to_y, hn::Mul(up_z, to_z)));
        highest = hn::Max(highest, hn::MulAdd(size, hn::Set(d, kDoubleUnits), value));
      }
      bits[0] |= MaskBits(d, hn::Gt(highest, hn::Zero(d))) << i;
    }
    return hn::LoadMaskBits(ShaftD(), reinterpret_cast<const uint8_t*>(bits));
  }

  // The least |w|, across the block's up, with (n_P - w)·(V - P) <= 0 for each corner; +inf where
  // there is none below 1. It is what one corner asks for, or two.
  HWY_INLINE V Tilt(const Vec3f (&corners)[3], uint32_t b, size_t at) const {
    const ShaftD d;
    const V3 p = Points(at), up = Up(at);
    const Vec3f u = across_[b][0], v = across_[b][1];
    const V3 e0 = Broadcast(d, u.x, u.y, u.z), e1 = Broadcast(d, v.x, v.y, v.z);
    // w·(x, y) >= high is aimed at, and holds if it is found to be at least `least`.
    V x[3], y[3], least[3], high[3];
    for (int k = 0; k < 3; ++k) {
      const V3 to = SubV(Broadcast(d, corners[k].x, corners[k].y, corners[k].z), p);
      x[k] = DotV(e0, to);
      y[k] = DotV(e1, to);
      const V lost = hn::MulAdd(Norm1V(to), hn::Set(d, kGroundSlack), hn::Set(d, kFloatUnderflow));
      least[k] = hn::Add(DotV(up, to), lost);
      high[k] = hn::Add(least[k], lost);
    }
    V best = hn::Set(d, kInfinity);
    const auto offer = [&](V wx, V wy) HWY_ATTR {
      const V square = hn::MulAdd(wx, wx, hn::Mul(wy, wy));
      M holds = hn::Lt(square, hn::Set(d, kMostClearTilt * kMostClearTilt));
      for (int k = 0; k < 3; ++k) {
        holds = hn::And(holds, hn::Ge(hn::MulAdd(wx, x[k], hn::Mul(wy, y[k])), least[k]));
      }
      best = hn::IfThenElse(holds, hn::Min(best, square), best);
    };
    for (int k = 0; k < 3; ++k) {
      const int l = (k + 1) % 3;
      const V scale = hn::Div(high[k], hn::MulAdd(x[k], x[k], hn::Mul(y[k], y[k])));
      offer(hn::Mul(scale, x[k]), hn::Mul(scale, y[k]));
      const V inverse = hn::Div(hn::Set(d, 1.0f), hn::MulSub(x[k], y[l], hn::Mul(x[l], y[k])));
      offer(hn::Mul(inverse, hn::MulSub(high[k], y[l], hn::Mul(high[l], y[k]))),
            hn::Mul(inverse, hn::MulSub(x[k], high[l], hn::Mul(x[l], high[k]))));
    }
    return hn::Sqrt(best);
  }

  V3 Points(size_t at) const {
    const ShaftD d;
    return {hn::Load(d, grounds_.x + at), hn::Load(d, grounds_.y + at),
            hn::Load(d, grounds_.z + at)};
  }
  V3 Up(size_t at) const {
    const ShaftD d;
    return {hn::Load(d, grounds_.normal_x + at), hn::Load(d, grounds_.normal_y + at),
            hn::Load(d, grounds_.normal_z + at)};
  }

  const IndexedGeometry& scene_;
  const PointGrounds& grounds_;
  const PointNormals& normals_;
  ClearLeaves& out_;
  WalkStats& stats_;
  uint32_t even_ = 0;  // Blocks whose normals are much the same, a bit each.
  uint32_t pairs_ = 0;
  float below_[kShaftBlocks];      // How far points lie below their centre, at most, along up.
  Vec3f across_[kShaftBlocks][2];  // Tangents of each block.
};

// As ChooseClearFn says.
template <bool kParallel>
void ChooseClear(const ClearLeaves& clear, Vec3f common, const float* rises, ClearToward* toward) {
  using V = ShaftV;
  using M = ShaftM;
  const ShaftD d;
  constexpr size_t kLanes = hn::MaxLanes(d), kVectors = kShaftBlocks / kLanes;
  const V slack = hn::Set(d, 2 * kGroundSlack), underflow = hn::Set(d, kFloatUnderflow);
  toward->count = 0;
  // By block: D, by how much it must lead up, and how far the points' own normals may be tilted.
  Vec3V<V> way[kVectors];
  V least[kVectors], own_most[kVectors];
  uint32_t up = 0, asked = 0;
  for (size_t k = 0; k < kVectors; ++k) {
    const size_t b = k * kLanes;
    Vec3V<V> q = Broadcast(d, common.x, common.y, common.z);
    V reach = hn::Zero(d);
    if constexpr (!kParallel) {
      q = SubV(q, {hn::Load(d, clear.centre_x + b), hn::Load(d, clear.centre_y + b),
                   hn::Load(d, clear.centre_z + b)});
      reach = hn::Load(d, clear.reach + b);
    }
    const V along = DotV(q, Vec3V<V>{hn::Load(d, clear.up_x + b), hn::Load(d, clear.up_y + b),
                                     hn::Load(d, clear.up_z + b)});
    const V lost = hn::MulAdd(hn::Add(Norm1V(q), reach), slack, underflow);
    const V square = DotV(q, q);  // Below that |Q|_1 will do.
    const V length =
        hn::IfThenElse(hn::Ge(square, hn::Set(d, kLeastSquare)), hn::Sqrt(square), Norm1V(q));
    const V far = hn::Add(hn::Add(length, reach), lost);
    const V rise = hn::Load(d, rises + b);
    way[k] = q;
    least[k] = hn::Add(reach, lost);
    own_most[k] = hn::Sub(hn::Div(hn::Sub(rise, lost), far), slack);
    up |= MaskBits(d, hn::Gt(along, least[k])) << b;
    asked |= MaskBits(d, hn::Lt(rise, hn::Set(d, std::numeric_limits<float>::infinity()))) << b;
  }
  up &= asked;
  if (up == 0) return;
  const Vec3f own = kParallel ? common : common - clear.centre;
  const Vec3V<V> q = Broadcast(d, own.x, own.y, own.z);
  const V radius = hn::Set(d, kParallel ? 0.0f : clear.radius);
  // N·D for all points, at least and at most; of length `far` at most.
  const V far = hn::Add(Norm1V(q), radius);
  const hn::CappedTag<uint16_t, kShaftBlocks> d16;
  for (uint32_t i = 0; i < clear.count; ++i) {
    const ClearLeaves::Leaf& leaf = clear.leaves[i];
    uint32_t blocks = 0;
    for (size_t k = 0; k < kVectors; ++k) {
      const size_t b = k * kLanes;
      const V rise =
          DotV(way[k], Vec3V<V>{hn::Load(d, leaf.plane_x + b), hn::Load(d, leaf.plane_y + b),
                                hn::Load(d, leaf.plane_z + b)});
      const M leads_up =
          hn::And(hn::Gt(rise, least[k]), hn::Lt(hn::Load(d, leaf.own_tilt + b), own_most[k]));
      blocks |= MaskBits(d, leads_up) << b;
    }
    blocks &= up;
    if (leaf.sides && blocks != 0) {
      uint32_t away = 0, against = 0;
      for (size_t k = 0; k < kMaxLeafTriangles; k += kLanes) {
        const V along =
            DotV(q, Vec3V<V>{hn::Load(d, leaf.normal_x + k), hn::Load(d, leaf.normal_y + k),
                             hn::Load(d, leaf.normal_z + k)});
        const V lost = hn::Add(hn::MulAdd(hn::Load(d, leaf.off + k), far, radius), underflow);
        away |= MaskBits(d, hn::Gt(along, lost)) << k;
        against |= MaskBits(d, hn::Lt(along, hn::Neg(lost))) << k;
      }
      const auto open = hn::Or(
          hn::AndNot(hn::Set(d16, static_cast<uint16_t>(away)), hn::Load(d16, leaf.before)),
          hn::AndNot(hn::Set(d16, static_cast<uint16_t>(against)), hn::Load(d16, leaf.behind)));
      blocks &= MaskBits(d16, hn::Eq(open, hn::Zero(d16)));
    }
    toward->leaf[toward->count] = clear.leaf[i];
    toward->blocks[toward->count] = static_cast<uint16_t>(blocks);
    toward->count += blocks != 0 ? 1 : 0;
  }
  const hn::RebindToUnsigned<ShaftD> du;
  hn::StoreU(hn::Set(du, RayPacket::kNoLeaf), du, toward->leaf + toward->count);
}

// The blocks that a leaf is clear of.
HWY_INLINE uint32_t ClearBlocks(const ClearToward* toward, uint32_t leaf) {
  if (toward == nullptr) return 0;
  const hn::RebindToUnsigned<ShaftD> du;
  const ShaftD d;
  for (uint32_t i = 0; i < toward->count; i += static_cast<uint32_t>(hn::Lanes(du))) {
    const auto same = hn::Eq(hn::Load(du, toward->leaf + i), hn::Set(du, leaf));
    const uint32_t bits = MaskBits(d, hn::RebindMask(d, same));
    if (bits != 0) return toward->blocks[i + std::countr_zero(bits)];
  }
  return 0;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
