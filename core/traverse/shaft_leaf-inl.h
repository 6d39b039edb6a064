// SPDX-License-Identifier: Apache-2.0
//
// A leaf's triangles as a shaft sees them: put to its sides by their vertices (paper 000's vertex
// culling), sixteen at a time; those left are relevant (paper 002), and their forms are kept, in
// rows, for the tests of blocks and rays.
//
// Thread safety: a leaf's forms are one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_LEAF_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_LEAF_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_LEAF_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_LEAF_INL_H_
#endif

#include "core/traverse/leaf_corners-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/shaft_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// A linear form over the frame: f[0]·x + f[1]·y + f[2] at slopes or offsets (x, y) (for the plane
// of parallel rays + f[3]·depth).
struct FrameForm {
  alignas(64) float f[4][kMaxLeafTriangles];
};

// Row i is the leaf's triangle i, turned so that its forms are positive where it is hit: the origin
// lies behind it. Rows of triangles that are not relevant hold nothing.
struct LeafForms {
  // Against a ray's own vector q (D, or P - R).
  alignas(64) float edge[3][3][kMaxLeafTriangles];
  alignas(64) float edge_offset[3][kMaxLeafTriangles];  // Parallel: e = offset - edge·q.
  // Of all three and any of the rays: above the one they are positive, below the other one is not.
  alignas(64) float edge_most[kMaxLeafTriangles], edge_least[kMaxLeafTriangles];
  alignas(64) float normal[3][kMaxLeafTriangles];
  alignas(64) float rate_bound[kMaxLeafTriangles];  // Closest: times |D|_inf.
  // Where ends are asked about: A, as stored; and for rays within the edges, normal·(P-A) above
  // the one where the plane comes before P, below the other where it does not. Parallel: of P-A
  // and the normal turned round.
  alignas(64) float corner[3][kMaxLeafTriangles];
  alignas(64) float plane_most[kMaxLeafTriangles], plane_least[kMaxLeafTriangles];
  alignas(64) uint32_t id[kMaxLeafTriangles];
  alignas(64) float turn[kMaxLeafTriangles];         // -1 where it was turned round, else 1.
  alignas(64) float depth[kMaxLeafTriangles];        // normal·(A-O), or normal·(A-R).
  alignas(64) float depth_bound[kMaxLeafTriangles];  // One origin: its error.
  alignas(64) float nearest[kMaxLeafTriangles];      // Closest: the least depth in its box.
  alignas(64) float inverse_lo[kMaxLeafTriangles];   // Closest: bounds of 1 / (normal·(A-O)).
  alignas(64) float inverse_hi[kMaxLeafTriangles];   // +inf where it cannot be trusted.
  // Against a block of rays: forms, good to their margins, and the triangle's own rectangle of
  // slopes or offsets.
  alignas(64) float x0[kMaxLeafTriangles], x1[kMaxLeafTriangles];
  alignas(64) float y0[kMaxLeafTriangles], y1[kMaxLeafTriangles];
  FrameForm edge_form[3], plane_form;
  alignas(64) float edge_margin[kMaxLeafTriangles], plane_margin[kMaxLeafTriangles];
};

// Where the float stage's relative error of normal·(A-O) is below this, bounds of its reciprocal
// are worth having.
constexpr float kTrustedDepth = 0x1p-8f;

// Settles the turns that floats leave open (`unsure`, of `chosen`; bit i for triangle first + i),
// and drops what blocks nothing: triangles whose plane holds the rays' common origin (or
// direction), and those whose object hides from rays with this mask. Returns those kept.
template <bool kParallel>
uint32_t SettleTurns(const SceneGeometry& geometry, const LeafView& leaf, uint32_t first,
                     uint32_t chosen, uint32_t unsure, uint32_t mask, Vec3f common, float* turns) {
  const bool ask = MustAskObjects(geometry, mask);
  uint32_t kept = chosen;
  for (uint32_t left = ask ? chosen : unsure; left != 0; left &= left - 1) {
    const uint32_t i = std::countr_zero(left), lane = first + i;
    int turn = turns[i] > 0 ? 1 : -1;
    if ((unsure >> i & 1) != 0) {
      const Vec3f a = leaf.corner(0, lane), b = leaf.corner(1, lane), c = leaf.corner(2, lane);
      turn = kParallel ? SideOfDirection(a, b, c, common) : -SideOfPlane(a, b, c, common);
      turns[i] = static_cast<float>(turn);
    }
    if (turn == 0 || (ask && !ObjectBlocks(geometry, leaf.id(lane), mask, -turn))) {
      kept &= ~(1u << i);
    }
  }
  return kept;
}

// The corners of sixteen triangles, relative to the apex (or R), along a frame's axes.
struct FrameCorners {
  Vec3V<ShaftV> at[3];

  HWY_INLINE FrameCorners(const ShaftFrame& frame, const Vec3V<ShaftV>* const (&corners)[3]) {
    const ShaftD d;
    for (int k = 0; k < 3; ++k) {
      at[k] = {DotV(Broadcast(d, frame.u.x, frame.u.y, frame.u.z), *corners[k]),
               DotV(Broadcast(d, frame.v.x, frame.v.y, frame.v.z), *corners[k]),
               DotV(Broadcast(d, frame.w.x, frame.w.y, frame.w.z), *corners[k])};
    }
  }
};

// Where a frame sees triangles, sixteen at a time, as rows first .. of *forms: slopes of their
// corners, or for parallel rays offsets, which `margin` widens. A corner that a frame could not
// hold opens its triangle wide. `norms` are the corners' 1-norms.
template <bool kParallel>
HWY_INLINE void PutRectangles(const FrameCorners& corners, const ShaftV* const (&norms)[3],
                              ShaftV margin, uint32_t first, LeafForms* forms) {
  using V = ShaftV;
  const ShaftD d;
  const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  V x0 = infinity, y0 = infinity, x1 = hn::Neg(infinity), y1 = x1;
  ShaftM held = hn::FirstN(d, hn::Lanes(d));
  for (int k = 0; k < 3; ++k) {
    V x = corners.at[k].x, y = corners.at[k].y;
    if constexpr (!kParallel) {
      const V z = corners.at[k].z;
      held = hn::And(held, hn::Ge(z, hn::Max(hn::Mul(*norms[k], hn::Set(d, kMinCornerShare)),
                                             hn::Set(d, kLeastDepth))));
      const V inverse = hn::Div(hn::Set(d, 1.0f), z);
      x = hn::Mul(x, inverse);
      y = hn::Mul(y, inverse);
    }
    x0 = hn::Min(x0, x);
    x1 = hn::Max(x1, x);
    y0 = hn::Min(y0, y);
    y1 = hn::Max(y1, y);
  }
  const V widen = kParallel ? margin : hn::Set(d, kCornerMargin);
  hn::Store(hn::IfThenElse(held, hn::Sub(x0, widen), hn::Neg(infinity)), d, forms->x0 + first);
  hn::Store(hn::IfThenElse(held, hn::Add(x1, widen), infinity), d, forms->x1 + first);
  hn::Store(hn::IfThenElse(held, hn::Sub(y0, widen), hn::Neg(infinity)), d, forms->y0 + first);
  hn::Store(hn::IfThenElse(held, hn::Add(y1, widen), infinity), d, forms->y1 + first);
}

// By component, the largest absolute value.
HWY_INLINE Vec3V<ShaftV> MostV(const Vec3V<ShaftV>& a, const Vec3V<ShaftV>& b,
                               const Vec3V<ShaftV>& c) {
  return {hn::Max(hn::Max(hn::Abs(a.x), hn::Abs(b.x)), hn::Abs(c.x)),
          hn::Max(hn::Max(hn::Abs(a.y), hn::Abs(b.y)), hn::Abs(c.y)),
          hn::Max(hn::Max(hn::Abs(a.z), hn::Abs(b.z)), hn::Abs(c.z))};
}

// How far a triangle's edges' forms ((A-O)×(B-A))·D may be off: of the most that its corners are
// from the origin, its edges are long and D leads, along each axis (predicate-inl.h).
HWY_INLINE ShaftV EdgeBound(const Vec3V<ShaftV>& corners, const Vec3V<ShaftV>& edges,
                            Vec3f directions) {
  const ShaftD d;
  return BoundAlong(d, CrossBound(d, corners, edges),
                    Broadcast(d, directions.x, directions.y, directions.z));
}

// The same of forms (A-R)·m - (P-R)·m, m = (B-A)×D, along one direction (margins.h): `extent` is
// |A-R|_1 + |P-R|_1 at the most, and `k` that, times |B-A|_1|D|_inf. What of m underflows is scaled
// by the extent, too.
HWY_INLINE ShaftV ParallelEdgeBound(ShaftV k, ShaftV extent) {
  const ShaftD d;
  const ShaftV underflow = hn::Set(d, kFloatUnderflow);
  return hn::MulAdd(hn::Set(d, kParallelUnits), k, hn::MulAdd(underflow, extent, underflow));
}

// How large N·(P-A) may be and yet have the wrong sign, where P's ray runs within the edges
// (margins.h). `approach` is |N·(A-O)|, or |N·D|, as computed, and `off` bounds how far that may be
// off for any point of the triangle; infinite where they are too close.
HWY_INLINE ShaftV PlaneBound(const Vec3V<ShaftV>& normal_bound, const Vec3V<ShaftV>& ab,
                             const Vec3V<ShaftV>& ca, ShaftV approach, ShaftV off) {
  const ShaftD d;
  const ShaftV own =
      BoundAlong(d, normal_bound,
                 {hn::Max(hn::Abs(ab.x), hn::Abs(ca.x)), hn::Max(hn::Abs(ab.y), hn::Abs(ca.y)),
                  hn::Max(hn::Abs(ab.z), hn::Abs(ca.z))});
  return hn::IfThenElse(hn::Ge(approach, hn::Add(off, off)), own,
                        hn::Set(d, std::numeric_limits<float>::infinity()));
}

// A form is certainly above zero where it is above *most, and below where it is below *least.
HWY_INLINE void PutBounds(ShaftV bound, uint32_t first, float* most, float* least) {
  const ShaftD d;
  hn::Store(bound, d, most + first);
  hn::Store(hn::Neg(bound), d, least + first);
}

template <bool kAny, bool kParallel, class Packet = ShaftPacket<kParallel>>
class ShaftLeaf {
 public:
  using Rays = ShaftRays<kAny, kParallel, Packet>;

  ShaftLeaf(const IndexedGeometry& scene, Rays& rays) : scene_(scene), rays_(rays) {
    const ShaftFrame& frame = rays.frame();
    for (int k = 0; k < 3; ++k) {
      axes_[0][k] = frame.u[k];
      axes_[1][k] = frame.v[k];
      axes_[2][k] = frame.w[k];
    }
  }

  // The leaf's relevant triangles (bit i for triangle i), with their forms in place. `far`: nothing
  // deeper matters (closest hits). Part of its callers, one in each walk: called, it takes some
  // hundredth of shadows' time more.
  HWY_INLINE uint32_t Prepare(const LeafView& leaf, const BlockBounds& bounds, float far) {
    uint32_t relevant = 0;
    const uint32_t lanes = static_cast<uint32_t>(hn::Lanes(ShaftD()));
    for (uint32_t first = 0; first < leaf.count; first += lanes) {
      relevant |= PrepareSome(leaf, first, bounds, far) << first;
    }
    return relevant;
  }

  const LeafForms& forms() const { return forms_; }

 private:
  using V = ShaftV;
  using V3 = Vec3V<ShaftV>;

  V Along(const float (&axis)[3], const V3& p) const {
    const ShaftD d;
    return hn::MulAdd(hn::Set(d, axis[0]), p.x,
                      hn::MulAdd(hn::Set(d, axis[1]), p.y, hn::Mul(hn::Set(d, axis[2]), p.z)));
  }

  HWY_INLINE uint32_t PrepareSome(const LeafView& leaf, uint32_t first, const BlockBounds& bounds,
                                  float far) {
    const ShaftD d;
    const Vec3f apex = rays_.apex();
    const V3 o = Broadcast(d, apex.x, apex.y, apex.z);
    const V3 a = LeafCorner(leaf, 0, first), b = LeafCorner(leaf, 1, first),
             c = LeafCorner(leaf, 2, first);
    const V3 oa = SubV(a, o), ob = SubV(b, o), oc = SubV(c, o);
    const V3* corner_of[3] = {&oa, &ob, &oc};
    const FrameCorners frame_corners(rays_.frame(), corner_of);
    const V least = InnerSide(frame_corners, bounds);
    const uint32_t in_use = leaf.count - first >= hn::Lanes(d) ? (1u << hn::Lanes(d)) - 1
                                                               : (1u << (leaf.count - first)) - 1;
    // A node's margin holds for any triangle, and spares those that end here their norms.
    ShaftM in = hn::Ge(hn::Add(least, hn::Set(d, rays_.node_margin())), hn::Zero(d));
    if constexpr (!kAny) {
      // A closest hit's distance may leave an ill-conditioned triangle, but not its box (hit.h).
      V nearest = hn::Zero(d), corner_reach = hn::Zero(d);
      const auto axis = [&](float w, V p, V q, V r) HWY_ATTR {
        const V lo = hn::Min(hn::Min(p, q), r), hi = hn::Max(hn::Max(p, q), r);
        nearest = hn::MulAdd(hn::Set(d, w), w >= 0 ? lo : hi, nearest);
        corner_reach = hn::Add(corner_reach, hn::Max(hn::Abs(lo), hn::Abs(hi)));
      };
      axis(axes_[2][0], oa.x, ob.x, oc.x);
      axis(axes_[2][1], oa.y, ob.y, oc.y);
      axis(axes_[2][2], oa.z, ob.z, oc.z);
      nearest = hn::Sub(hn::NegMulAdd(corner_reach, hn::Set(d, kBoxMargin), nearest),
                        hn::Set(d, kFloatUnderflow));
      in = hn::And(in, hn::Le(nearest, hn::Set(d, far)));
      Put(nearest, first, forms_.nearest);
    }
    uint32_t relevant = MaskBits(d, in) & in_use;
    if (relevant == 0) return 0;
    if (rays_.has_cap()) {
      relevant &= MaskBits(d, WithinCap(a, b, c, bounds.cap_most));
      if (relevant == 0) return 0;
    }

    const V oa1 = Norm1V(oa), ob1 = Norm1V(ob), oc1 = Norm1V(oc);
    const V reach = hn::Max(hn::Max(oa1, ob1), oc1);
    const V margin = hn::MulAdd(hn::Add(reach, hn::Set(d, rays_.spread())), hn::Set(d, kBoxMargin),
                                hn::Set(d, kFloatUnderflow));
    const V3 ab = SubV(b, a), bc = SubV(c, b), ca = SubV(a, c);
    const V ab1 = Norm1V(ab), bc1 = Norm1V(bc), ca1 = Norm1V(ca);
    const V3 normal = CrossV(ab, bc), normal_bound = CrossBound(d, ab, bc);
    const V normal_k = hn::Mul(ab1, bc1);
    V depth = DotV(normal, oa);
    // Which way the triangle is to be turned: by the side the origin is on, or where D leads.
    V turn, turn_bound;
    V3 common = o;
    if constexpr (kParallel) {
      const Vec3f direction = rays_.packet().direction;
      common = Broadcast(d, direction.x, direction.y, direction.z);
      turn = DotV(normal, common);
      turn_bound = BoundAlong(d, normal_bound, common);
    } else {
      turn = depth;
      turn_bound = BoundAlong(d, normal_bound, oa);
    }
    const V approach = hn::Abs(turn);  // Before a turn that is settled takes its place.
    const hn::RebindToUnsigned<ShaftD> du;
    if (rays_.common_source() != kNoTriangle) {
      relevant &= ~MaskBits(du, hn::Eq(LeafIds(leaf, first), hn::Set(du, rays_.common_source())));
    }
    const uint32_t unsure = relevant & MaskBits(d, hn::Le(hn::Abs(turn), turn_bound));
    const uint32_t mask = rays_.packet().mask;
    if (unsure != 0 || MustAskObjects(scene_.geometry, mask)) {
      HWY_ALIGN float turns[kMaxLeafTriangles];
      hn::Store(turn, d, turns);
      relevant = SettleTurns<kParallel>(scene_.geometry, leaf, first, relevant, unsure, mask,
                                        rays_.common(), turns);
      turn = hn::Load(d, turns);
    }
    if (relevant == 0) return 0;
    const V flip = hn::And(turn, hn::SignBit(d));
    const auto turned = [flip](const V3& v) HWY_ATTR -> V3 {
      return {hn::Xor(v.x, flip), hn::Xor(v.y, flip), hn::Xor(v.z, flip)};
    };

    // Forms, and all of them against the whole shaft's rectangle: positive somewhere in it?
    V3 edge[3];
    V edge_offset[3];
    const V* corner_1[3] = {&oa1, &ob1, &oc1};
    const V3* along[3] = {&ab, &bc, &ca};
    // One bound for the three, of the farthest corner and the longest edge.
    V edge_k = hn::Max(hn::Max(ab1, bc1), ca1);
    [[maybe_unused]] const V extent = hn::Add(reach, hn::Set(d, rays_.spread()));
    if constexpr (kParallel) {
      edge_k = hn::Mul(hn::Mul(edge_k, hn::Set(d, MaxAbs(rays_.packet().direction))), extent);
    } else {
      edge_k = hn::Mul(edge_k, reach);
    }
    const V edge_units = hn::Set(d, kEdgeMargin), edge_underflow = hn::Set(d, kEdgeUnderflow);
    const V edge_margin = hn::MulAdd(edge_units, edge_k, edge_underflow);
    const V cx = hn::Set(d, bounds.cx), cy = hn::Set(d, bounds.cy);
    const V ex = hn::Set(d, bounds.ex), ey = hn::Set(d, bounds.ey);
    ShaftM met = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(&relevant));
    V frame[3][4];
    for (int e = 0; e < 3; ++e) {
      if constexpr (kParallel) {
        edge[e] = turned(CrossV(*along[e], common));
        edge_offset[e] = DotV(edge[e], *corner_of[e]);
        frame[e][0] = hn::Neg(Along(axes_[0], edge[e]));
        frame[e][1] = hn::Neg(Along(axes_[1], edge[e]));
        frame[e][2] = edge_offset[e];
      } else {
        edge[e] = turned(CrossV(*corner_of[e], *along[e]));
        for (int j = 0; j < 3; ++j) frame[e][j] = Along(axes_[j], edge[e]);
      }
      const V middle = hn::MulAdd(frame[e][0], cx, hn::MulAdd(frame[e][1], cy, frame[e][2]));
      const V radius =
          hn::MulAdd(hn::Abs(frame[e][0]), ex, hn::MulAdd(hn::Abs(frame[e][1]), ey, edge_margin));
      met = hn::And(met, hn::Ge(hn::Add(middle, radius), hn::Zero(d)));
    }
    relevant = MaskBits(d, met);
    if (relevant == 0) return 0;

    PutRectangles<kParallel>(frame_corners, corner_1, margin, first, &forms_);
    const V3 n = turned(normal);
    depth = hn::Xor(depth, flip);
    for (int e = 0; e < 3; ++e) {
      Put(edge[e], first, forms_.edge[e]);
      if constexpr (kParallel) Put(edge_offset[e], first, forms_.edge_offset[e]);
      for (int j = 0; j < 3; ++j) Put(frame[e][j], first, forms_.edge_form[e].f[j]);
    }
    [[maybe_unused]] const V3 farthest = MostV(oa, ob, oc);
    if constexpr (kParallel) {
      PutBounds(ParallelEdgeBound(edge_k, extent), first, forms_.edge_most, forms_.edge_least);
    } else {
      PutBounds(EdgeBound(farthest, MostV(ab, bc, ca), rays_.most_own()), first, forms_.edge_most,
                forms_.edge_least);
    }
    Put(edge_margin, first, forms_.edge_margin);
    if constexpr (kParallel) {
      Put({hn::Neg(n.x), hn::Neg(n.y), hn::Neg(n.z)}, first, forms_.normal);
    } else {
      Put(n, first, forms_.normal);
    }
    if (kParallel || rays_.segments()) {
      Put(a, first, forms_.corner);
      const V off = kParallel ? turn_bound : BoundAlong(d, normal_bound, farthest);
      PutBounds(PlaneBound(normal_bound, ab, ca, approach, off), first, forms_.plane_most,
                forms_.plane_least);
    }
    hn::Store(LeafIds(leaf, first), du, forms_.id + first);
    Put(depth, first, forms_.depth);
    if constexpr (!kAny) {
      Put(hn::Add(hn::Add(normal_bound.x, normal_bound.y), normal_bound.z), first,
          forms_.rate_bound);
    }
    Put(hn::Xor(hn::Set(d, 1.0f), flip), first, forms_.turn);
    if constexpr (kParallel) {
      // With what offsets next to nothing are off by, which n scales (margins.h).
      const float least = rays_.spread() + kLeastOffset;
      const V k = hn::Mul(normal_k, hn::Add(oa1, hn::Set(d, least)));
      Put(hn::Neg(Along(axes_[0], n)), first, forms_.plane_form.f[0]);
      Put(hn::Neg(Along(axes_[1], n)), first, forms_.plane_form.f[1]);
      Put(depth, first, forms_.plane_form.f[2]);
      Put(hn::Neg(Along(axes_[2], n)), first, forms_.plane_form.f[3]);
      Put(hn::MulAdd(edge_units, k, edge_underflow), first, forms_.plane_margin);
    } else {
      Put(turn_bound, first, forms_.depth_bound);
      for (int j = 0; j < 3; ++j) Put(Along(axes_[j], n), first, forms_.plane_form.f[j]);
      Put(hn::MulAdd(edge_units, normal_k, edge_underflow), first, forms_.plane_margin);
      if constexpr (!kAny) {
        const V inverse = hn::Div(hn::Set(d, 1.0f), depth);
        const V share = hn::Mul(turn_bound, inverse);
        const ShaftM trusted =
            hn::And(hn::Ge(share, hn::Zero(d)), hn::Le(share, hn::Set(d, kTrustedDepth)));
        // 1 / (1 ± e) lies within 1 ± 2e; kInverseMargin for the rest.
        const V off = hn::MulAdd(share, hn::Set(d, 2.0f), hn::Set(d, kInverseMargin));
        Put(hn::IfThenElseZero(trusted, hn::NegMulAdd(inverse, off, inverse)), first,
            forms_.inverse_lo);
        Put(hn::IfThenElse(trusted, hn::MulAdd(inverse, off, inverse),
                           hn::Set(d, std::numeric_limits<float>::infinity())),
            first, forms_.inverse_hi);
      }
    }
    return relevant;
  }

  // How far the triangles reach, at least, to the inner side of the shaft's sides.
  HWY_INLINE V InnerSide(const FrameCorners& corners, const BlockBounds& bounds) const {
    const ShaftD d;
    const V left = hn::Set(d, bounds.left), right = hn::Set(d, bounds.right);
    const V below = hn::Set(d, bounds.below), above = hn::Set(d, bounds.above);
    V most[4];  // Of the three corners.
    V depth = corners.at[0].z;
    for (int k = 0; k < 3; ++k) {
      const V3& p = corners.at[k];
      // Slopes' ends are planes through the apex.
      const V in[4] = {kParallel ? hn::Sub(p.x, left) : hn::NegMulAdd(left, p.z, p.x),
                       kParallel ? hn::Sub(right, p.x) : hn::MulSub(right, p.z, p.x),
                       kParallel ? hn::Sub(p.y, below) : hn::NegMulAdd(below, p.z, p.y),
                       kParallel ? hn::Sub(above, p.y) : hn::MulSub(above, p.z, p.y)};
      for (int i = 0; i < 4; ++i) most[i] = k == 0 ? in[i] : hn::Max(most[i], in[i]);
      depth = kParallel ? hn::Max(depth, p.z) : hn::Min(depth, p.z);
    }
    V least = hn::Min(hn::Min(most[0], most[1]), hn::Min(most[2], most[3]));
    if constexpr (kParallel) {
      least = hn::Min(least, hn::Sub(depth, hn::Set(d, bounds.all_near)));
    } else if (kAny && rays_.segments()) {
      least = hn::Min(least, hn::Sub(hn::Set(d, bounds.all_far), depth));
    }
    return least;
  }

  // Some corner on the inner side of the receivers' cap.
  ShaftM WithinCap(const V3& a, const V3& b, const V3& c, float most) const {
    const ShaftD d;
    const Vec3f at = rays_.cap_at(), g = rays_.cap_normal();
    const V3 centre = Broadcast(d, at.x, at.y, at.z), n = Broadcast(d, g.x, g.y, g.z);
    const V3 n_abs = {hn::Abs(n.x), hn::Abs(n.y), hn::Abs(n.z)};
    const V margin = hn::Set(d, kCapMargin);
    const auto low = [&](const V3& corner) HWY_ATTR {
      const V3 p = SubV(corner, centre);
      const V3 p_abs = {hn::Abs(p.x), hn::Abs(p.y), hn::Abs(p.z)};
      return hn::NegMulAdd(DotV(n_abs, p_abs), margin, DotV(n, p));
    };
    return hn::Le(hn::Min(hn::Min(low(a), low(b)), low(c)), hn::Set(d, most + kFloatUnderflow));
  }

  static void Put(V v, uint32_t first, float* row) { hn::Store(v, ShaftD(), row + first); }
  static void Put(const V3& v, uint32_t first, float (*rows)[kMaxLeafTriangles]) {
    Put(v.x, first, rows[0]);
    Put(v.y, first, rows[1]);
    Put(v.z, first, rows[2]);
  }

  const IndexedGeometry& scene_;
  Rays& rays_;
  float axes_[3][3];
  LeafForms forms_;
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
