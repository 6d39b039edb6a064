// SPDX-License-Identifier: Apache-2.0
//
// A leaf's triangles as all segments from an area light's samples to a packet's points see them.
//
// A triangle's edge from A along m = B-A is passed on its inner side by a segment from L to P where
//     e(L, P) = ((A-L) × m)·(P-L) = det(A-L, B-L, P-L) > 0,
// a volume, and so linear in L as it is in P. With L = C + s·a + t·b + r (light_hull.h):
//     e(L, P) = e(C, P) + s·λa(P) + t·λb(P) + (m × r)·(P-A),   λh(P) = (m × h)·(P-A).
// So three linear forms of a point say what all samples see of an edge: that of the light's centre,
// and how it leans along the light's two axes. As |s|, |t| <= 1, e lies within |λa| + |λb| of
// e(C, P) for all of them. The side of the triangle's plane that P is on does not depend on L.
//
// Error bounds: core/shaft/margins.h, "an area light's samples together".
//
// Thread safety: a leaf's forms are one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_HULL_LEAF_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_HULL_LEAF_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_HULL_LEAF_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_HULL_LEAF_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>

#include "core/intersect/predicate.h"
#include "core/shaft/margins.h"
#include "core/traverse/hull_blocks-inl.h"
#include "core/traverse/hull_cut-inl.h"
#include "core/traverse/leaf_corners-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/light_hull.h"
#include "core/traverse/plane_side-inl.h"
#include "core/traverse/shaft_leaf-inl.h"
#include "core/traverse/shaft_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// A triangle has a row, i as the leaf's triangle i; one whose plane parts the light's samples has
// another, kMaxLeafTriangles further, turned the other way round.
constexpr uint32_t kHullRows = 2 * kMaxLeafTriangles;

// f[0]·x + f[1]·y + f[2] + f[3] / depth at slopes (x, y).
struct HullForm {
  alignas(64) float f[4][kHullRows];
};

// Rows of triangles that are not relevant hold nothing. Forms are positive where a row's samples
// are blocked.
struct HullForms {
  uint16_t samples[kHullRows];  // Those behind the triangle, a bit each: the others do not see it.
  // Against a point's q: e(C, P) = edge·q, λ = lean·q + lean_form.f[3], and the bound of what is
  // added up of them, bound + bound_scale·|q|_inf.
  alignas(64) float edge[3][3][kHullRows];
  alignas(64) float lean[3][2][3][kHullRows];
  alignas(64) float bound[kHullRows], bound_scale[kHullRows];
  // Against P-A, as LeafForms'.
  alignas(64) float normal[3][kHullRows], normal_bound[3][kHullRows], turn[kHullRows];
  // Against a block of rays, good to margin + margin_inverse / depth.
  HullForm edge_form[3], lean_form[3][2], plane_form;
  alignas(64) float margin[kHullRows], margin_inverse[kHullRows], plane_margin[kHullRows];
  alignas(64) float depth[kHullRows], depth_bound[kHullRows];  // As LeafForms'.
  // Corners along the frame's axes, relative to the light's centre; no corner is farther from it.
  alignas(64) float corner[3][3][kHullRows], reach[kHullRows];
};

// A triangle whose edges lean by so many times their forms' sum is small before the light: of
// sixteen samples next to none is behind it.
constexpr float kSmallTriangle = 3;

class HullLeaf {
 public:
  // All are kept by reference. `light` is flat, its centre the rays' origin; `hull` holds its
  // samples and the rays' points.
  HullLeaf(const LightHull& light, const HullCutMaker& hull, const HullRays& rays)
      : light_(light),
        hull_(hull),
        rays_(rays),
        size_(Norm1(light.half[0]) + Norm1(light.half[1])) {}

  // The rows (bit r for row r) of triangles that may block some segment, with their forms in place.
  uint32_t Prepare(const LeafView& leaf, const ShaftBounds& bounds, const HullBlocks& blocks,
                   uint32_t source) {
    uint32_t rows = 0;
    small_ = 0;
    for (uint32_t first = 0; first < leaf.count;
         first += static_cast<uint32_t>(hn::Lanes(ShaftD()))) {
      rows |= PrepareSome(leaf, first, bounds, blocks, source);
    }
    return rows;
  }

  const HullForms& forms() const { return forms_; }
  // The rows of triangles that are small before the light, as the points see both.
  uint32_t small() const { return small_; }

 private:
  using V = ShaftV;
  using M = ShaftM;
  using V3 = Vec3V<ShaftV>;

  static V3 BroadcastV(Vec3f v) { return Broadcast(ShaftD(), v.x, v.y, v.z); }

  // The rows of triangles first .. of a leaf.
  uint32_t PrepareSome(const LeafView& leaf, uint32_t first, const ShaftBounds& bounds,
                       const HullBlocks& blocks, uint32_t source) {
    const ShaftD d;
    const hn::RebindToUnsigned<ShaftD> du;
    uint32_t relevant = MaskBits(d, hull_.Meeting(leaf, first));
    if (source != kNoTriangle) {
      const auto ids =
          hn::LoadU(du, reinterpret_cast<const uint32_t*>(leaf.rows + 9 * leaf.stride + first));
      relevant &= ~MaskBits(du, hn::Eq(ids, hn::Set(du, source)));
    }
    if (relevant == 0) return 0;

    const V3 o = BroadcastV(light_.centre);
    const V3 a = LeafCorner(leaf, 0, first), b = LeafCorner(leaf, 1, first),
             c = LeafCorner(leaf, 2, first);
    const V3 corner[3] = {SubV(a, o), SubV(b, o), SubV(c, o)};
    const V3 along[3] = {SubV(b, a), SubV(c, b), SubV(a, c)};
    const V3 half[2] = {BroadcastV(light_.half[0]), BroadcastV(light_.half[1])};
    const V along1[2] = {Norm1V(along[0]), Norm1V(along[1])};
    const V longest = hn::Max(hn::Max(along1[0], along1[1]), Norm1V(along[2]));
    const V reach = hn::Max(hn::Max(Norm1V(corner[0]), Norm1V(corner[1])), Norm1V(corner[2]));
    const V underflow = hn::Set(d, kFloatUnderflow);
    const float size = size_, rest = light_.rest * kRestScale;

    // Whether all samples are on one side of the plane, and on which.
    const V3 normal = CrossV(along[0], along[1]);
    const V normal_k = hn::Mul(along1[0], along1[1]);
    const V3 normal_bound = CrossBound(d, along[0], along[1]);
    const V depth = DotV(normal, corner[0]);
    const V depth_bound = BoundAlong(d, normal_bound, corner[0]);
    const V spread = hn::Add(hn::Abs(DotV(normal, half[0])), hn::Abs(DotV(normal, half[1])));
    const V sides_bound =
        hn::MulAdd(normal_k, hn::Set(d, kLeanUnits * size + rest), hn::Add(depth_bound, spread));
    const uint32_t sure = MaskBits(d, hn::Gt(hn::Abs(depth), sides_bound));

    // Forms, and all of them against the whole shaft.
    const V cx = hn::Set(d, bounds.cx), cy = hn::Set(d, bounds.cy);
    const V ex = hn::Set(d, bounds.ex), ey = hn::Set(d, bounds.ey);
    const V iz = hn::Set(d, blocks.all_middle), ez = hn::Set(d, blocks.all_extent);
    const V edge_k = hn::Mul(longest, reach);
    const V slack = hn::Mul(longest, hn::Set(d, kEdgeMargin * size + 2 * rest));
    const V margin =
        hn::MulAdd(hn::Set(d, kEdgeMargin), edge_k,
                   hn::MulAdd(slack, hn::Set(d, kRestPerDepth), hn::Set(d, kEdgeUnderflow)));
    // What leans lose where they underflow is scaled like them.
    const V margin_inverse = hn::Mul(hn::Add(slack, underflow), reach);
    const V margin_all = hn::MulAdd(margin_inverse, hn::Set(d, blocks.all_most), margin);
    const Vec3f axes[3] = {rays_.frame().u, rays_.frame().v, rays_.frame().w};
    const V3 axis[3] = {BroadcastV(axes[0]), BroadcastV(axes[1]), BroadcastV(axes[2])};
    M front = hn::FirstN(d, hn::Lanes(d)), back = front;
    V leaning = hn::Zero(d), area = hn::Zero(d);
    V3 edge[3], lean[3][2];
    V edge_frame[3][3], lean_frame[3][2][3], lean_offset[3][2];
    for (int e = 0; e < 3; ++e) {
      edge[e] = CrossV(corner[e], along[e]);
      for (int k = 0; k < 3; ++k) edge_frame[e][k] = DotV(axis[k], edge[e]);
      const V middle =
          hn::MulAdd(edge_frame[e][0], cx, hn::MulAdd(edge_frame[e][1], cy, edge_frame[e][2]));
      area = hn::Add(area, middle);
      V radius = hn::MulAdd(hn::Abs(edge_frame[e][0]), ex,
                            hn::MulAdd(hn::Abs(edge_frame[e][1]), ey, margin_all));
      for (int h = 0; h < 2; ++h) {
        lean[e][h] = CrossV(along[e], half[h]);
        lean_offset[e][h] = hn::Neg(DotV(lean[e][h], corner[e]));
        V* const f = lean_frame[e][h];
        for (int k = 0; k < 3; ++k) f[k] = DotV(axis[k], lean[e][h]);
        const V off = lean_offset[e][h];
        const V at_centre =
            hn::Abs(hn::MulAdd(f[0], cx, hn::MulAdd(f[1], cy, hn::MulAdd(off, iz, f[2]))));
        leaning = hn::Max(leaning, at_centre);
        radius = hn::Add(radius, at_centre);
        radius = hn::MulAdd(hn::Abs(f[0]), ex,
                            hn::MulAdd(hn::Abs(f[1]), ey, hn::MulAdd(hn::Abs(off), ez, radius)));
      }
      front = hn::And(front, hn::Ge(hn::Add(middle, radius), hn::Zero(d)));
      back = hn::And(back, hn::Le(hn::Sub(middle, radius), hn::Zero(d)));
    }
    const uint32_t behind = MaskBits(d, hn::Gt(depth, hn::Zero(d)));
    const uint32_t met[2] = {MaskBits(d, front), MaskBits(d, back)};
    relevant &= (sure & behind & met[0]) | (sure & ~behind & met[1]) | (~sure & (met[0] | met[1]));
    if (relevant == 0) return 0;

    // An edge leans by the triangle's size times the light's, and the three edges' forms add up to
    // twice the triangle's area: all as the points see them.
    small_ |= MaskBits(d, hn::Gt(leaning, hn::Mul(hn::Abs(area), hn::Set(d, kSmallTriangle))))
              << first;
    small_ |= (small_ & 0xFFFF) << kMaxLeafTriangles;
    // Turned, where their turn is sure; as they are, else.
    const V flip = hn::IfThenElseZero(
        hn::And(hn::Gt(hn::Abs(depth), sides_bound), hn::Lt(depth, hn::Zero(d))), hn::SignBit(d));
    for (int e = 0; e < 3; ++e) {
      Put(edge[e], flip, first, forms_.edge[e]);
      for (int k = 0; k < 3; ++k) Put(edge_frame[e][k], flip, first, forms_.edge_form[e].f[k]);
      for (int h = 0; h < 2; ++h) {
        Put(lean[e][h], flip, first, forms_.lean[e][h]);
        for (int k = 0; k < 3; ++k) {
          Put(lean_frame[e][h][k], flip, first, forms_.lean_form[e][h].f[k]);
        }
        Put(lean_offset[e][h], flip, first, forms_.lean_form[e][h].f[3]);
      }
    }
    const V zero = hn::Zero(d);
    const V lean_slack = hn::Mul(longest, hn::Set(d, kLeanUnits * size + rest));
    Put(hn::MulAdd(hn::Add(lean_slack, underflow), reach, underflow), zero, first, forms_.bound);
    Put(hn::MulAdd(hn::Set(d, kCentreUnits), edge_k,
                   hn::MulAdd(lean_slack, hn::Set(d, 3.0f), underflow)),
        zero, first, forms_.bound_scale);
    Put(margin, zero, first, forms_.margin);
    Put(margin_inverse, zero, first, forms_.margin_inverse);
    Put(normal, flip, first, forms_.normal);
    Put(normal_bound, zero, first, forms_.normal_bound);
    Put(hn::Set(d, 1.0f), flip, first, forms_.turn);
    for (int k = 0; k < 3; ++k) Put(DotV(axis[k], normal), flip, first, forms_.plane_form.f[k]);
    Put(hn::MulAdd(hn::Set(d, kEdgeMargin), normal_k, hn::Set(d, kEdgeUnderflow)), zero, first,
        forms_.plane_margin);
    const V3* const corner_of[3] = {&corner[0], &corner[1], &corner[2]};
    const FrameCorners along_frame(rays_.frame(), corner_of);
    for (int c = 0; c < 3; ++c) Put(along_frame.at[c], zero, first, forms_.corner[c]);
    Put(reach, zero, first, forms_.reach);
    Put(depth, flip, first, forms_.depth);
    Put(depth_bound, zero, first, forms_.depth_bound);
    const auto all = static_cast<uint16_t>((1u << light_.count) - 1);
    std::fill_n(forms_.samples + first, hn::Lanes(d), all);
    uint32_t rows = relevant << first;
    for (uint32_t left = relevant & ~sure; left != 0; left &= left - 1) {
      Part(leaf, first + std::countr_zero(left), &rows);
    }
    return rows;
  }

  // Puts triangle i, which floats do not see on one side of all samples, into one row or two, or
  // takes it off *rows.
  HWY_NOINLINE void Part(const LeafView& leaf, uint32_t i, uint32_t* rows) {
    const Vec3f a = leaf.corner(0, i), b = leaf.corner(1, i), c = leaf.corner(2, i);
    const ShaftD d;
    const uint32_t all = (1u << light_.count) - 1;
    uint32_t behind = 0, before = 0;  // Samples that the triangle, as it is, is in front of.
    for (size_t k = 0; k < LightHull::kMostSamples; k += hn::Lanes(d)) {
      const V3 samples = {hn::Load(d, light_.rows[0] + k), hn::Load(d, light_.rows[1] + k),
                          hn::Load(d, light_.rows[2] + k)};
      const V side = SideInDoubles(ToDouble(b) - ToDouble(a), ToDouble(c) - ToDouble(a),
                                   /*sign=*/1, &a, samples);
      behind |= (MaskBits(d, hn::Lt(side, hn::Zero(d))) << k) & all;
      before |= (MaskBits(d, hn::Gt(side, hn::Zero(d))) << k) & all;
    }
    for (uint32_t left = all & ~(behind | before); left != 0; left &= left - 1) {
      const uint32_t k = std::countr_zero(left);
      const int side = SideOfPlane(a, b, c, light_.samples[k]);
      behind |= side < 0 ? 1u << k : 0;
      before |= side > 0 ? 1u << k : 0;
    }
    // Nothing is told of its plane by blocks.
    for (int k = 0; k < 3; ++k) forms_.plane_form.f[k][i] = 0;
    forms_.plane_margin[i] = 1;
    forms_.depth[i] = -std::numeric_limits<float>::infinity();
    forms_.depth_bound[i] = 0;
    const uint32_t other = i + kMaxLeafTriangles;
    if (before != 0) {
      Turn(i, other);
      forms_.samples[other] = static_cast<uint16_t>(before);
      *rows |= 1u << other;
    }
    forms_.samples[i] = static_cast<uint16_t>(behind);
    if (behind == 0) *rows &= ~(1u << i);
  }

  // Row `to` is row `from` seen from the other side.
  void Turn(uint32_t from, uint32_t to) {
    const auto turned = [&](float* row) { row[to] = -row[from]; };
    const auto same = [&](float* row) { row[to] = row[from]; };
    for (int e = 0; e < 3; ++e) {
      for (int k = 0; k < 3; ++k) {
        turned(forms_.edge[e][k]);
        turned(forms_.edge_form[e].f[k]);
      }
      for (int h = 0; h < 2; ++h) {
        for (int k = 0; k < 3; ++k) turned(forms_.lean[e][h][k]);
        for (auto& row : forms_.lean_form[e][h].f) turned(row);
      }
    }
    for (int k = 0; k < 3; ++k) {
      turned(forms_.normal[k]);
      same(forms_.normal_bound[k]);
      same(forms_.plane_form.f[k]);
    }
    turned(forms_.turn);
    for (float* const row : {forms_.bound, forms_.bound_scale, forms_.margin, forms_.margin_inverse,
                             forms_.plane_margin, forms_.depth, forms_.depth_bound, forms_.reach}) {
      same(row);
    }
    for (auto& corner : forms_.corner) {
      for (float* const row : corner) same(row);
    }
  }

  static void Put(V v, V flip, uint32_t first, float* row) {
    hn::Store(hn::Xor(v, flip), ShaftD(), row + first);
  }
  static void Put(const V3& v, V flip, uint32_t first, float (*rows)[kHullRows]) {
    Put(v.x, flip, first, rows[0]);
    Put(v.y, flip, first, rows[1]);
    Put(v.z, flip, first, rows[2]);
  }

  const LightHull& light_;
  const HullCutMaker& hull_;
  const HullRays& rays_;
  const float size_;  // |a|_1 + |b|_1.
  HullForms forms_;
  uint32_t small_ = 0;
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
