// SPDX-License-Identifier: Apache-2.0
//
// The rays of a shaft: in rows, in the shaft's frame, and bounded sixteen by sixteen (a block), for
// whatever subset of them is still asked about.
//
// Two kinds of shaft share everything below. Rays with one origin O (its apex) are placed in the
// frame by slopes, and what tells them apart is their direction D. Parallel rays have one direction
// and are placed by offsets of their origins P from a reference point R, which takes the apex's
// part. `own` is D or P - R: an edge form of a triangle is linear in it either way.
//
// Thread safety: a shaft's rays are one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_RAYS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_RAYS_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_RAYS_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_RAYS_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <type_traits>

#include "core/accel/indexed_geometry.h"
#include "core/base/check.h"
#include "core/base/fill-inl.h"
#include "core/geometry/box_ray.h"
#include "core/intersect/predicate-inl.h"
#include "core/shaft/axis_caps-inl.h"
#include "core/shaft/frame.h"
#include "core/shaft/margins.h"
#include "core/shaft/wedge-inl.h"
#include "core/traverse/pixel_grid-inl.h"
#include "core/traverse/point_box-inl.h"
#include "core/traverse/shaft_bounds-inl.h"
#include "core/traverse/shaft_lanes-inl.h"
#include "core/traverse/shaft_sides-inl.h"
#include "core/traverse/surface_normal-inl.h"
#include "core/traverse/trace_ray.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

static_assert(kShaftBlocks * kShaftBlockRays == RayPacket::kMaxRays);

// Rays that a frame can hold. A square that underflows fails the test, and the rays go another way;
// none overflows: directions lead no further than 2^43.
HWY_INLINE ShaftM FitsFrame(const Vec3V<ShaftV>& direction, ShaftV depth) {
  const ShaftD d;
  return hn::And(hn::Ge(depth, hn::Set(d, kLeastDepth)),
                 hn::Ge(hn::Mul(depth, depth), hn::Mul(hn::Set(d, kMinDepthShare * kMinDepthShare),
                                                       DotV(direction, direction))));
}

// What the rays of a shaft come in; or a PacketPair, of rays with one origin.
template <bool kParallel>
using ShaftPacket = std::conditional_t<kParallel, ParallelPacket, RayPacket>;

template <bool kAny, bool kParallel, class PacketType = ShaftPacket<kParallel>>
class ShaftRays {
 public:
  using Packet = PacketType;
  static constexpr int kMaxRays = Packet::kMaxRays;
  static constexpr int kRays = kMaxRays / kShaftBlocks;  // Of a block.
  static constexpr bool kPair = std::is_same_v<Packet, PacketPair>;
  using Bits = std::conditional_t<kPair, uint32_t, uint16_t>;  // One for each of a block's rays.
  using Set = BlockRays<Bits>;
  using Bounds = OpenBounds<Bits>;
  static_assert(kAny || !kParallel, "parallel rays are asked about any hit");

  ShaftRays(const IndexedGeometry& scene, Packet& packet) : packet_(packet), scene_(scene) {}

  // Finds the frame and places the rays in it. `alone`: in one of their own, whatever neighbours
  // have left. False: they do not fit (they spread too far around the origin, or have no
  // direction).
  bool Prepare(bool alone) {
    if constexpr (!kAny) {
      if (grid() != nullptr) {
        PrepareGrid();
        return true;
      }
    }
    const ShaftD d;
    const size_t lanes = hn::Lanes(d);
    const int count = packet_.count;
    padded_ = (count + lanes - 1) / lanes * lanes;
    for (size_t i = count; i < padded_; ++i) packet_.PadLane(i, count - 1);
    if constexpr (kParallel) {
      apex_ = packet_.origin(count / 2);
      has_cap_ = true;
    } else {
      apex_ = packet_.origin;
      has_cap_ = packet_.segments;
    }
    Box3f box;  // Around the points, where ends are asked about.
    if (has_cap_) {
      box = BoxAround(packet_);
      cap_at_ = point(count / 2);
      reach_ = FarthestFrom(box, cap_at_);
      if constexpr (kParallel) {
        spread_ = reach_.x + reach_.y + reach_.z;
      } else {
        most_own_ = FarthestFrom(box, apex_);
      }
    }
    seeded_ = !alone && HasSeedFor(box);
    if (seeded_) {
      frame_ = packet_.seed->frame;
      cap_normal_ = packet_.seed->cap_normal;
    } else {
      // Lanes 0 and 3 are neighbours in a row of a tile; points come as they come.
      const Vec3d sideways = ToDouble(point(std::min(3, count - 1))) - ToDouble(point(0));
      if (!MakeShaftFrame(Axis(), sideways, &frame_)) return false;
      if (has_cap_) TurnCap();
    }
    if (has_cap_) PlaceCap();
    if (!(has_cap_ ? Place<true>() : Place<false>())) return false;
    if (count == kMaxRays) {
      std::fill_n(all_.rays, kShaftBlocks, static_cast<Bits>(~Bits{0}));
    } else {
      for (int b = 0; b < kShaftBlocks; ++b) {
        const int left = std::clamp(count - b * kRays, 0, kRays);
        all_.rays[b] = static_cast<Bits>((uint64_t{1} << left) - 1);
      }
    }
    if constexpr (kAny) {
      for (int b = 0; packet_.unasked != nullptr && b < kShaftBlocks; ++b) {
        all_.rays[b] &= static_cast<Bits>(~packet_.unasked[b]);
      }
    }
    has_sources_ = (kParallel || segments()) && !packet_.sourceless && FindSources();
    float farthest = FarthestNorm1(scene_.bvh.bounds) + Norm1(apex_) + spread_;
    if (has_cap_) farthest += Norm1(cap_at_);
    node_margin_ = kBoxMargin * farthest + kFloatUnderflow;
    if constexpr (kAny) PlaceAxisCaps(box);
    return true;
  }

  // The pixels' grid of a camera's rays, or null.
  const PixelGrid* grid() const {
    if constexpr (kAny || kParallel) {
      return nullptr;
    } else {
      return packet_.grid;
    }
  }
  const Set& all() const { return all_; }
  size_t padded() const { return padded_; }
  const ShaftFrame& frame() const { return frame_; }
  Vec3f apex() const { return apex_; }
  float spread() const { return spread_; }  // Bounds |P - R|_1; 0 for rays with one origin.
  float node_margin() const { return node_margin_; }
  bool segments() const {
    if constexpr (kParallel) {
      return false;
    } else {
      return packet_.segments;
    }
  }
  bool has_cap() const { return has_cap_; }
  // Whether the frame is one that neighbours have made.
  bool seeded() const { return seeded_; }
  // Leaves it to them if it is not. REQUIRES: it holds the rays.
  void LeaveSeed() {
    if constexpr (kAny) {
      if (!seeded_ && has_cap_ && packet_.seed != nullptr) {
        *packet_.seed = {true, frame_, cap_normal_};
      }
    }
  }
  Vec3f cap_normal() const { return cap_normal_; }
  Vec3f cap_at() const { return cap_at_; }
  const AxisCaps& axis_caps() const { return axis_caps_; }  // Any hit.
  bool has_sources() const { return has_sources_; }
  const uint32_t* sources() const {
    if constexpr (kParallel) {
      return packet_.origin_source;
    } else {
      return packet_.target_source;
    }
  }
  // The origin, or the direction, of all.
  Vec3f common() const {
    if constexpr (kParallel) {
      return packet_.direction;
    } else {
      return packet_.origin;
    }
  }
  uint32_t common_source() const {
    if constexpr (kParallel) {
      return packet_.direction_source;
    } else {
      return packet_.origin_source;
    }
  }
  Packet& packet() { return packet_; }
  Vec3V<ShaftV> Own(size_t at) const {
    const ShaftD d;
    if constexpr (kAny) {
      // Taken in each test, not stored once: walks are faster so (EXPERIMENTS.md).
      return SubV(Rows(at), Broadcast(d, own_from_.x, own_from_.y, own_from_.z));
    } else {
      return {hn::Load(d, own_[0] + at), hn::Load(d, own_[1] + at), hn::Load(d, own_[2] + at)};
    }
  }
  // Closest hits only.
  ShaftV OwnInf(size_t at) const { return hn::Load(ShaftD(), own_inf_ + at); }
  // By axis, |D| is nowhere above it; one origin only.
  Vec3f most_own() const { return most_own_; }
  ShaftV InverseDepth(size_t at) const { return hn::Load(ShaftD(), inverse_z_ + at); }
  // Ends of segments, origins of parallel rays.
  ShaftV Point(int axis, size_t at) const { return hn::Load(ShaftD(), row(axis) + At(at)); }
  // Where a lane is in the packet's rows.
  static HWY_INLINE size_t At(size_t lane) {
    if constexpr (kPair) {
      return Packet::At(lane);
    } else {
      return lane;
    }
  }

  // Bounds the rays of `set`, all of them still asked about. Returns how many there are.
  int Bound(const Set& set, Bounds* out) const {
    const ShaftD d;
    const ShaftV infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    const ShaftV minus_infinity = hn::Neg(infinity);
    int count = 0;
    for (int b = 0; b < kShaftBlocks; ++b) {
      out->open[b] = set.rays[b];
      count += std::popcount(out->open[b]);
    }
    out->open_blocks = OpenBlocks(out->open);
    out->whole = count == kMaxRays;
    if (count == 0) return 0;
    const bool has_depths = kParallel || segments();
    if (grid() != nullptr) {
      BoundGrid(out);
    } else {
      const Bits* const open = out->whole ? nullptr : out->open;
      BlockRanges(x_, open, out->x0, out->x1);
      BlockRanges(y_, open, out->y0, out->y1);
      if (has_depths) BlockRanges(z_, open, out->near, out->far);
    }
    if (!has_depths) {
      FillRow(out->near, kShaftBlocks, 0.0f);
      FillRow(out->far, kShaftBlocks, std::numeric_limits<float>::infinity());
    }
    const float widen = kParallel ? kBoxMargin * spread_ : kSlopeMargin;
    const ShaftV margin = hn::Set(d, widen), half = hn::Set(d, 0.5f);
    ShaftV ax0 = infinity, ax1 = minus_infinity, ay0 = infinity, ay1 = minus_infinity;
    ShaftV az0 = infinity, az1 = minus_infinity;
    for (size_t b = 0; b < kShaftBlocks; b += hn::Lanes(d)) {
      const ShaftV bx0 = hn::Sub(hn::Load(d, out->x0 + b), margin);
      const ShaftV bx1 = hn::Add(hn::Load(d, out->x1 + b), margin);
      const ShaftV by0 = hn::Sub(hn::Load(d, out->y0 + b), margin);
      const ShaftV by1 = hn::Add(hn::Load(d, out->y1 + b), margin);
      const ShaftM used = hn::Le(bx0, bx1);
      hn::Store(bx0, d, out->x0 + b);
      hn::Store(bx1, d, out->x1 + b);
      hn::Store(by0, d, out->y0 + b);
      hn::Store(by1, d, out->y1 + b);
      // Half extents are taken a little large, so that middle ± half holds the rectangle after
      // rounding.
      hn::Store(hn::IfThenElseZero(used, hn::Mul(half, hn::Add(bx0, bx1))), d, out->mx + b);
      hn::Store(hn::IfThenElseZero(used, hn::Mul(half, hn::Add(by0, by1))), d, out->my + b);
      hn::Store(hn::IfThenElseZero(used, hn::MulAdd(half, hn::Sub(bx1, bx0), margin)), d,
                out->hx + b);
      hn::Store(hn::IfThenElseZero(used, hn::MulAdd(half, hn::Sub(by1, by0), margin)), d,
                out->hy + b);
      const ShaftV z0 = hn::Load(d, out->near + b);
      ShaftV z1 = hn::Load(d, out->far + b);
      if constexpr (!kParallel) z1 = hn::Mul(z1, hn::Set(d, kDepthScale));
      hn::Store(hn::IfThenElseZero(used, z0), d, out->near + b);
      hn::Store(hn::IfThenElseZero(used, z1), d, out->far + b);
      ax0 = hn::Min(ax0, bx0);
      ax1 = hn::Max(ax1, bx1);
      ay0 = hn::Min(ay0, by0);
      ay1 = hn::Max(ay1, by1);
      az0 = hn::Min(az0, hn::IfThenElse(used, z0, infinity));
      az1 = hn::Max(az1, hn::IfThenElse(used, z1, minus_infinity));
    }
    const float left = hn::GetLane(hn::MinOfLanes(d, ax0));
    const float right = hn::GetLane(hn::MaxOfLanes(d, ax1));
    const float below = hn::GetLane(hn::MinOfLanes(d, ay0));
    const float above = hn::GetLane(hn::MaxOfLanes(d, ay1));
    out->all_near = hn::GetLane(hn::MinOfLanes(d, az0));
    out->all_far = hn::GetLane(hn::MaxOfLanes(d, az1));
    out->left = left;
    out->right = right;
    out->below = below;
    out->above = above;
    out->cx = 0.5f * (left + right);
    out->cy = 0.5f * (below + above);
    out->ex = 0.5f * (right - left) + widen;
    out->ey = 0.5f * (above - below) + widen;
    MakeSides({left, right, below, above}, out);
    return count;
  }

  // Whether a frame can hold what was bounded, much as FitsFrame has it: of any hit's segments,
  // which Prepare asks for their depths alone.
  bool Fits(const BlockBounds& bounds) const {
    if (!kAny || kParallel || !segments()) return true;
    const float x = std::max(-bounds.left, bounds.right), y = std::max(-bounds.below, bounds.above);
    return x * x + y * y <= kMostSquaredSlopes;
  }

  // Parts the open rays at the middle of their widest extent. False: one side would be empty.
  bool Split(const Bounds& bounds, Set* halves) const {
    const ShaftD d;
    const ShaftV infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    ShaftV x0 = infinity, x1 = hn::Neg(infinity), y0 = x0, y1 = x1;
    for (size_t i = 0; i < padded_; i += hn::Lanes(d)) {
      const ShaftM open = LanesOf(bounds.open, i);
      const ShaftV x = hn::Load(d, x_ + i), y = hn::Load(d, y_ + i);
      x0 = hn::Min(x0, hn::IfThenElse(open, x, infinity));
      x1 = hn::Max(x1, hn::IfThenElse(open, x, hn::Neg(infinity)));
      y0 = hn::Min(y0, hn::IfThenElse(open, y, infinity));
      y1 = hn::Max(y1, hn::IfThenElse(open, y, hn::Neg(infinity)));
    }
    const float left = hn::GetLane(hn::MinOfLanes(d, x0));
    const float right = hn::GetLane(hn::MaxOfLanes(d, x1));
    const float below = hn::GetLane(hn::MinOfLanes(d, y0));
    const float above = hn::GetLane(hn::MaxOfLanes(d, y1));
    const bool by_x = right - left >= above - below;
    const float* const at = by_x ? x_ : y_;
    const ShaftV middle = hn::Set(d, by_x ? 0.5f * (left + right) : 0.5f * (below + above));
    halves[0] = halves[1] = Set{};
    uint32_t in[2] = {0, 0};
    for (size_t i = 0; i < padded_; i += hn::Lanes(d)) {
      const size_t b = i / kRays, first = i % kRays;
      const uint32_t lanes = MaskBits(d, LanesOf(bounds.open, i)) << first;
      const uint32_t beyond = MaskBits(d, hn::Gt(hn::Load(d, at + i), middle)) << first;
      halves[0].rays[b] |= static_cast<Bits>(lanes & ~beyond);
      halves[1].rays[b] |= static_cast<Bits>(lanes & beyond);
      in[0] |= lanes & ~beyond;
      in[1] |= lanes & beyond;
    }
    return in[0] != 0 && in[1] != 0;
  }

 private:
  // Of a grid's pixels nothing is projected.
  void PrepareGrid() {
    if constexpr (!kAny) {
      SIGHTLINE_DCHECK(packet_.count == kMaxRays && !packet_.segments);
      padded_ = kMaxRays;
      apex_ = packet_.origin;
      frame_ = grid()->frame;
      for (int k = 0; k < 3; ++k) own_[k] = row(k);
      const float most = grid()->norm_inf;
      most_own_ = {most, most, most};
      FillRow(own_inf_, kMaxRays, most);
      std::fill_n(all_.rays, kShaftBlocks, static_cast<Bits>(~Bits{0}));
      node_margin_ =
          kBoxMargin * (FarthestNorm1(scene_.bvh.bounds) + Norm1(apex_)) + kFloatUnderflow;
    }
  }
  HWY_INLINE void BoundGrid(BlockBounds* out) const {
    if constexpr (!kAny) {
      BoundBlocks(*grid(), packet_.grid_column, packet_.grid_row, out->x0, out->x1, out->y0,
                  out->y1, out->depth);
    }
  }

  const float* row(int axis) const {
    if constexpr (kParallel) {
      return axis == 0 ? packet_.origin_x : axis == 1 ? packet_.origin_y : packet_.origin_z;
    } else {
      return axis == 0 ? packet_.target_x : axis == 1 ? packet_.target_y : packet_.target_z;
    }
  }
  Vec3f point(int lane) const {
    const size_t at = At(static_cast<size_t>(lane));
    return {row(0)[at], row(1)[at], row(2)[at]};
  }
  Vec3V<ShaftV> Rows(size_t lane) const {
    const ShaftD d;
    const size_t at = At(lane);
    return {hn::Load(d, row(0) + at), hn::Load(d, row(1) + at), hn::Load(d, row(2) + at)};
  }

  // Whether some lane has a source.
  bool FindSources() const {
    static_assert(kNoTriangle == 0xFFFFFFFFu, "all bits, so that And keeps it");
    const hn::RebindToUnsigned<ShaftD> du;
    auto all = hn::Set(du, kNoTriangle);
    for (size_t i = 0; i < padded_; i += hn::Lanes(du)) {
      all = hn::And(all, hn::Load(du, sources() + At(i)));
    }
    return !hn::AllTrue(du, hn::Eq(all, hn::Set(du, kNoTriangle)));
  }

  // Where the rays lead: to the middle of their points, or of the rays.
  Vec3d Axis() const {
    if constexpr (kParallel) {
      return ToDouble(packet_.direction);
    } else {
      if constexpr (kAny) {
        if (const Box3f* box = packet_.point_box; box != nullptr && segments()) {
          return (ToDouble(box->lo) + ToDouble(box->hi)) * 0.5 - ToDouble(apex_);
        }
      }
      const ShaftD d;
      const Vec3V<ShaftV> o = Broadcast(d, apex_.x, apex_.y, apex_.z);
      Vec3V<ShaftV> sum = {hn::Zero(d), hn::Zero(d), hn::Zero(d)};
      // Blocks 0, 5, 10 and 15, the diagonal of a square of them, stand for all.
      for (size_t b = 0; b < kShaftBlocks; b += 5) {
        const size_t end = std::min((b + 1) * kShaftBlockRays, padded_);
        for (size_t i = b * kShaftBlockRays; i < end; i += hn::Lanes(d)) {
          const Vec3V<ShaftV> own = segments() ? SubV(Rows(i), o) : Rows(i);
          const ShaftV scale = hn::Div(hn::Set(d, 1.0f), NormInfV(own));
          sum.x = hn::MulAdd(own.x, scale, sum.x);
          sum.y = hn::MulAdd(own.y, scale, sum.y);
          sum.z = hn::MulAdd(own.z, scale, sum.z);
        }
      }
      return {hn::GetLane(hn::SumOfLanes(d, sum.x)), hn::GetLane(hn::SumOfLanes(d, sum.y)),
              hn::GetLane(hn::SumOfLanes(d, sum.z))};
    }
  }

  // Places the rays in the frame; kCap: along the cap, too. False: they do not fit the frame, but
  // for what Fits asks.
  template <bool kCap>
  bool Place() {
    constexpr bool kAsks = !kParallel && !(kAny && kCap);
    const ShaftD d;
    if constexpr (!kAny) {
      for (int k = 0; k < 3; ++k) own_[k] = own_rows_[k];
    }
    own_from_ = kParallel || segments() ? apex_ : Vec3f{0, 0, 0};
    ShaftV cap_most = hn::Set(d, -std::numeric_limits<float>::infinity());
    const Vec3V<ShaftV> o = Broadcast(d, apex_.x, apex_.y, apex_.z);
    const Vec3V<ShaftV> u = Broadcast(d, frame_.u.x, frame_.u.y, frame_.u.z);
    const Vec3V<ShaftV> v = Broadcast(d, frame_.v.x, frame_.v.y, frame_.v.z);
    const Vec3V<ShaftV> w = Broadcast(d, frame_.w.x, frame_.w.y, frame_.w.z);
    const Vec3V<ShaftV> g = Broadcast(d, cap_normal_.x, cap_normal_.y, cap_normal_.z);
    const Vec3V<ShaftV> cap_at = Broadcast(d, cap_at_.x, cap_at_.y, cap_at_.z);
    ShaftV widest = hn::Zero(d);
    ShaftM fits = hn::FirstN(d, hn::Lanes(d));
    for (size_t i = 0; i < padded_; i += hn::Lanes(d)) {
      const Vec3V<ShaftV> p = Rows(i);
      const Vec3V<ShaftV> own = kParallel || segments() ? SubV(p, o) : p;
      if constexpr (kCap) {
        // Parallel: C is R.
        cap_most = hn::Max(cap_most, DotV(g, kParallel ? own : SubV(p, cap_at)));
      }
      if constexpr (!kAny) {
        hn::Store(own.x, d, own_rows_[0] + i);
        hn::Store(own.y, d, own_rows_[1] + i);
        hn::Store(own.z, d, own_rows_[2] + i);
      }
      const ShaftV x = DotV(u, own), y = DotV(v, own), z = DotV(w, own);
      hn::Store(z, d, z_ + i);
      if constexpr (kParallel) {
        hn::Store(x, d, x_ + i);
        hn::Store(y, d, y_ + i);
      } else {
        if constexpr (!kAsks) {
          fits = hn::And(fits, hn::Ge(z, hn::Set(d, kLeastDepth)));
        } else {
          const ShaftV inf = NormInfV(own);
          widest = hn::Max(widest, inf);
          if constexpr (!kAny) hn::Store(inf, d, own_inf_ + i);
          fits = hn::And(fits, FitsFrame(own, z));
        }
        const ShaftV inverse = kAny ? InverseOf(z) : hn::Div(hn::Set(d, 1.0f), z);
        if constexpr (!kAny) hn::Store(inverse, d, inverse_z_ + i);
        hn::Store(hn::Mul(x, inverse), d, x_ + i);
        hn::Store(hn::Mul(y, inverse), d, y_ + i);
      }
    }
    if constexpr (kAsks) {
      const float most = hn::GetLane(hn::MaxOfLanes(d, widest));
      most_own_ = {most, most, most};
    }
    if constexpr (kCap) cap_most_ = hn::GetLane(hn::MaxOfLanes(d, cap_most));
    return hn::AllTrue(d, fits);
  }

  void PlaceAxisCaps(const Box3f& box) {
    if (!kParallel && !segments()) return;
    for (int k = 0; k < 3; ++k) {
      const float from = common()[k];
      if constexpr (kParallel) {
        axis_caps_.CapRays(k, LeastIn(box, k, from > 0), from);
      } else {
        const bool up = from >= point(packet_.count / 2)[k];
        axis_caps_.CapSegments(k, up, LeastIn(box, k, up), up ? from : -from);
      }
    }
  }

  // Whether neighbours have left a frame that may hold what is in this box.
  bool HasSeedFor(const Box3f& box) const {
    if (!kAny || !has_cap_ || packet_.seed == nullptr || !packet_.seed->made) return false;
    return kParallel || packet_.seed->LeadsTo((box.lo + box.hi) * 0.5f - apex_);
  }

  // The receivers' cap: along the mean of some of their sources' normals, so that it lies on their
  // surface where that is flat; along the axis if no source is known.
  void TurnCap() {
    const float* const rows[3] = {row(0), row(1), row(2)};
    const uint32_t* const known = packet_.sourceless ? nullptr : sources();
    // Of a pair the first packet's stand for all.
    const int count = std::min<int>(packet_.count, RayPacket::kMaxRays);
    const Vec3d sum = SumOfNormals(scene_.geometry, known, rows, count,
                                   ToDouble(kParallel ? -frame_.w : frame_.w));
    cap_normal_ = MaxAbs(sum) > kFlat ? ToFloat(sum) : kParallel ? -frame_.w : frame_.w;
  }
  // None for parallel rays that climb out of it.
  void PlaceCap() {
    const Vec3f g_abs = {std::abs(cap_normal_.x), std::abs(cap_normal_.y), std::abs(cap_normal_.z)};
    cap_margin_ = kCapMargin * Dot(g_abs, reach_);
    cap_of_apex_ = -std::numeric_limits<float>::infinity();
    if constexpr (kParallel) {
      const Vec3d g = ToDouble(cap_normal_), d = ToDouble(common());
      const double size = MaxAbs(g) * MaxAbs(d);
      has_cap_ = Dot(g, d) < -0x1p-40 * size;
    } else {
      const Vec3f p = apex_ - cap_at_;
      cap_of_apex_ = Dot(cap_normal_, p) +
                     kCapMargin * (std::abs(cap_normal_.x * p.x) + std::abs(cap_normal_.y * p.y) +
                                   std::abs(cap_normal_.z * p.z));
    }
  }

  // The most of G·(P - C) of the points `open` alone.
  HWY_NOINLINE float CapMost(const Bits* open) const {
    const ShaftD d;
    const Vec3V<ShaftV> g = Broadcast(d, cap_normal_.x, cap_normal_.y, cap_normal_.z);
    const Vec3V<ShaftV> cap_at = Broadcast(d, cap_at_.x, cap_at_.y, cap_at_.z);
    ShaftV most = hn::Set(d, -std::numeric_limits<float>::infinity());
    for (size_t i = 0; i < padded_; i += hn::Lanes(d)) {
      most = hn::IfThenElse(LanesOf(open, i), hn::Max(most, DotV(g, SubV(Rows(i), cap_at))), most);
    }
    return hn::GetLane(hn::MaxOfLanes(d, most));
  }

  void MakeSides(const FrameRectangle& held, Bounds* out) const {
    ReceiversCap cap;
    out->cap_most = std::numeric_limits<float>::infinity();
    if (has_cap_) {
      const float most = out->whole ? cap_most_ : CapMost(out->open);
      out->cap_most = std::max(most + cap_margin_, cap_of_apex_);
      // A node is put to it as to any other side; triangles by their own, narrower margin.
      cap = {cap_normal_, out->cap_most + Dot(cap_normal_, cap_at_ - apex_)};
    }
    const bool ends = kAny && segments();
    MakeShaftSides<kParallel>(frame_, apex_, held, out->all_near, ends ? &out->all_far : nullptr,
                              has_cap_ ? &cap : nullptr, &out->sides);
    if constexpr (kParallel) {
      MakeParallelWedges(frame_, common(), apex_, held, node_margin_, &out->wedges);
    } else {
      MakeApexWedges(frame_, apex_, held, node_margin_, &out->wedges);
    }
  }

  Packet& packet_;
  const IndexedGeometry& scene_;
  ShaftFrame frame_;
  Vec3f apex_;
  float spread_ = 0;
  Vec3f most_own_;
  float node_margin_ = 0;
  size_t padded_ = 0;
  bool has_cap_ = false, has_sources_ = false, seeded_ = false;
  Vec3f cap_normal_, cap_at_;
  float cap_most_ = 0;  // The most of G·(P - C).
  Vec3f own_from_;      // What `own` is taken from the packet's rows by; any hit.
  Vec3f reach_;         // How far the points are from C along each axis.
  float cap_of_apex_ = 0, cap_margin_ = 0;
  AxisCaps axis_caps_;
  Set all_;
  // By axis: own_rows_, or the packet's, where those are what is wanted. Closest hits only.
  const float* own_[3];
  alignas(64) float own_rows_[3][kMaxRays];
  alignas(64) float own_inf_[kMaxRays];                        // |D|_inf; closest hits only.
  alignas(64) float x_[kMaxRays], y_[kMaxRays], z_[kMaxRays];  // Slopes or offsets, and depths.
  alignas(64) float inverse_z_[kMaxRays];                      // Closest hits only.
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
