// SPDX-License-Identifier: Apache-2.0
//
// One walk of the tree for all samples of an area light and all points of a packet: what a point
// and a triangle say of each other, they say for all samples together, mostly. A triangle misses a
// point for every sample, or blocks it for every one, by the range of its forms over the light
// (hull_leaf-inl.h); what lies between is told by two multiply-adds an edge from the same forms:
// for sixteen points and each sample that sees some of a block past all edges, or for sixteen
// samples and each point, whichever are fewer. The points' sides of a triangle's plane, which take
// doubles where points lie on that very surface, are found once for all samples.
//
// The walk is a shaft's (shaft-inl.h) with the light's centre for origin, but what nodes and
// triangles are put to is the hull of light and points (hull_cut-inl.h), as paper 002's shafts
// between two boxes are; and it begins at the points. Leaves whose triangles are small before the
// light, as the points see both, are left to shafts from one sample at a time, where these meet few
// of them: they make a cut for those samples that meet any, as does all that is left where the walk
// costs too much.
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_HULL_WALK_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_HULL_WALK_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_HULL_WALK_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_HULL_WALK_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>

#include "core/base/cancel.h"
#include "core/base/check.h"
#include "core/intersect/predicate.h"
#include "core/traverse/hull_cut-inl.h"
#include "core/traverse/hull_leaf-inl.h"
#include "core/traverse/light_hull.h"
#include "core/traverse/plane_side-inl.h"
#include "core/traverse/shaft_pair-inl.h"
#include "core/traverse/shaft_rays-inl.h"
#include "core/traverse/single-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

class HullWalk {
 public:
  // All are kept by reference. The packet's origin is the light's centre; blocked[lane] gets a bit
  // for each sample.
  HullWalk(const IndexedGeometry& scene, const LightHull& light, const HullCutMaker& hull,
           RayPacket& packet, uint32_t budget, uint16_t* blocked, WalkStats* stats)
      : scene_(scene),
        light_(light),
        hull_(hull),
        packet_(packet),
        budget_(budget),
        blocked_(blocked),
        stats_(stats),
        rays_(scene, packet),
        fetcher_(scene.bvh) {}

  // False: the rays fit no frame.
  bool Prepare() { return rays_.Prepare(); }

  // From rest->cut, where what is left to be walked sample by sample comes. REQUIRES: Prepare() was
  // true.
  void Run(HullRest* rest, const CancelToken* cancel) {
    rays_.Bound(rays_.all(), &bounds_);
    const HullBlocks blocks(light_, rays_, bounds_);
    blocks_ = &blocks;
    const auto none = static_cast<uint16_t>(~AllSamples());  // Those there are not.
    std::fill_n(blocked_, RayPacket::kMaxRays, none);
    HullLeaf leaf(light_, hull_, rays_);
    leaf_ = &leaf;
    Walk(rest->cut, cancel);
    for (int lane = 0; none != 0 && lane < packet_.count; ++lane) {
      blocked_[lane] &= static_cast<uint16_t>(~none);
    }
    hull_.Pack({rest_, rest_count_}, &rest->cut);
    rest->samples = rest_count_ > 0 ? rest_samples_ : uint16_t{0};
  }

 private:
  using V = ShaftV;
  using M = ShaftM;
  static constexpr size_t kLanes = hn::MaxLanes(ShaftD());
  static constexpr size_t kBlockVectors = kShaftBlockRays / kLanes;
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  static_assert(LightHull::kMostSamples == kShaftBlockRays, "as many vectors");

  // A row of the leaf's and a block: block | row << kTriangleShift.
  struct Pairs {
    size_t count = 0;
    // A whole vector is stored at its end.
    alignas(64) uint32_t pairs[kHullRows * kShaftBlocks + kShaftBlocks];
  };
  // What the forms of a block's points say of a row.
  struct Edges {
    alignas(64) float centre[3][kShaftBlockRays], lean[3][2][kShaftBlockRays];
    alignas(64) float bound[kShaftBlockRays];
  };

  uint16_t AllSamples() const { return static_cast<uint16_t>((1u << light_.count) - 1); }

  void Walk(const ShaftCut& cut, const CancelToken* cancel) {
    if (packet_.first_leaf != RayPacket::kNoLeaf) {
      const ChildRef first = ChildRef::FromBits(packet_.first_leaf);
      SIGHTLINE_DCHECK(scene_.bvh.HoldsLeaf(first)) << "first leaf " << packet_.first_leaf;
      VisitLeaf(first, /*now=*/true);
      if (bounds_.open_blocks == 0) return;
      packet_.first_leaf = RayPacket::kNoLeaf;
    }
    PendingAny stack[kStackSize];
    int depth = 0;
    // What is nearest to the points comes off the stack first: the light is small behind it.
    for (uint32_t i = 0; i < cut.node_count; ++i) depth = VisitNode(cut.nodes[i], stack, depth);
    bool cancelled = false;
    for (uint64_t visited = 1; depth > 0; ++visited) {
      cancelled |= visited % kPollInterval == 0 && cancel != nullptr && cancel->cancelled();
      // Left to others while a cut can hold it all: those that would leave much more gain nothing.
      const uint32_t left = rest_count_ + static_cast<uint32_t>(depth);
      const bool is_full = rest_count_ > 0 && left > ShaftCut::kMaxChildren - kBvhWidth;
      const bool stops = is_full || work_ > budget_ || cancelled;
      if (stops && left <= ShaftCut::kMaxChildren) {
        while (depth > 0) rest_[rest_count_++] = stack[--depth].ref();
        rest_samples_ = AllSamples();
        return;
      }
      const ChildRef ref = stack[--depth].ref();
      if (depth > 0) fetcher_.FetchAll(stack[depth - 1].ref());
      if (packet_.meanwhile != nullptr) packet_.meanwhile->Some();
      if (ref.is_inner()) {
        depth = VisitNode(scene_.bvh.nodes[ref.node()], stack, depth);
        continue;
      }
      const bool has_room = rest_count_ + static_cast<uint32_t>(depth) < ShaftCut::kMaxChildren;
      if (!VisitLeaf(ref, /*now=*/!has_room)) {
        rest_[rest_count_++] = ref;
      } else if (bounds_.open_blocks == 0) {
        rest_count_ = 0;
        packet_.first_leaf = ref.bits();
        return;
      }
    }
  }

  HWY_INLINE int VisitNode(const BvhNode& node, PendingAny* stack, int depth) {
    ++stats_->nodes;
    work_ += kNodeWork;
    const hn::CappedTag<float, kBvhWidth> d8;
    return depth + PushChildren(d8, node, hull_.Meeting(node), stack + depth);
  }

  // False: most of its triangles are small, and seen by few samples, and it is better visited
  // sample by sample; unless it has to be visited `now`.
  bool VisitLeaf(ChildRef ref, bool now) {
    ++stats_->leaves;
    const LeafView leaf(scene_, ref);
    uint32_t rows = leaf_->Prepare(leaf, bounds_, *blocks_, packet_.origin_source);
    if (!now && std::popcount(leaf_->small() & rows) * 2 > std::popcount(rows)) {
      work_ += kLeafWork;
      // A row's samples, and rows with any.
      uint32_t samples = 0, pairs = 0, reached = 0;
      for (uint32_t left = rows; left != 0; left &= left - 1) {
        const uint32_t own = ReachingSamples(std::countr_zero(left));
        samples |= own;
        pairs += static_cast<uint32_t>(std::popcount(own));
        reached |= own != 0 ? left & (0 - left) : 0;
      }
      if (reached == 0) return true;
      const auto all = static_cast<float>(light_.count) * static_cast<float>(std::popcount(rows));
      if (static_cast<float>(pairs) < kMostReach * all) {
        rest_samples_ |= static_cast<uint16_t>(samples);
        return false;
      }
      rows = reached;
    }
    Pairs touched;
    uint64_t covers = 0;
    for (uint32_t left = rows; left != 0; left &= left - 1) {
      const uint32_t row = std::countr_zero(left);
      const uint32_t covered = List(row, &touched);
      if (covered != 0) [[unlikely]] {
        covers += static_cast<uint64_t>(std::popcount(covered));
        TakeCovers(leaf, row, covered);
      }
    }
    if (packet_.answered_by != nullptr) MarkTested(leaf, touched);
    for (size_t k = 0; k < touched.count; ++k) TestPair(leaf, touched.pairs[k]);
    bounds_.open_blocks = OpenBlocks(bounds_.open);
    const auto relevant = static_cast<uint32_t>(std::popcount(rows));
    work_ += kLeafWork + relevant * kRowWork + static_cast<uint32_t>(touched.count) * kPairWork;
    stats_->shaft.triangles += leaf.count;
    stats_->shaft.relevant += relevant;
    stats_->shaft.pairs += covers + touched.count;
    stats_->shaft.covers += covers;
    return true;
  }

  // One row against all blocks. Returns those all of whose points it blocks for all its samples, a
  // bit each, and lists those that it may touch otherwise.
  HWY_INLINE uint32_t List(uint32_t row, Pairs* touched) const {
    const ShaftD d;
    const HullForms& forms = leaf_->forms();
    uint32_t covered = 0;
    for (size_t first = 0; first < kShaftBlocks; first += kLanes) {
      const uint8_t* open = reinterpret_cast<const uint8_t*>(&bounds_.open_blocks) + first / 8;
      const M met = hn::And(hn::LoadMaskBits(d, open), ReachedBlocks(row, first));
      if (hn::AllFalse(d, met)) continue;
      const V mx = hn::Load(d, bounds_.mx + first), my = hn::Load(d, bounds_.my + first);
      const V hx = hn::Load(d, bounds_.hx + first), hy = hn::Load(d, bounds_.hy + first);
      const V iz = hn::Load(d, blocks_->middle + first), ez = hn::Load(d, blocks_->extent + first);
      const V margin =
          hn::MulAdd(hn::Set(d, forms.margin_inverse[row]), hn::Load(d, blocks_->most + first),
                     hn::Set(d, forms.margin[row]));
      V most = hn::Set(d, kInfinity), least = most;  // Over the edges: of largest, least values.
      for (int e = 0; e < 3; ++e) {
        const auto& f = forms.edge_form[e].f;
        const V f0 = hn::Set(d, f[0][row]), f1 = hn::Set(d, f[1][row]);
        const V middle = hn::MulAdd(f0, mx, hn::MulAdd(f1, my, hn::Set(d, f[2][row])));
        V radius = hn::MulAdd(hn::Abs(f0), hx, hn::MulAdd(hn::Abs(f1), hy, margin));
        for (int h = 0; h < 2; ++h) {
          const auto& g = forms.lean_form[e][h].f;
          const V g0 = hn::Set(d, g[0][row]), g1 = hn::Set(d, g[1][row]);
          const V g3 = hn::Set(d, g[3][row]);
          const V lean =
              hn::MulAdd(g0, mx, hn::MulAdd(g1, my, hn::MulAdd(g3, iz, hn::Set(d, g[2][row]))));
          radius =
              hn::MulAdd(hn::Abs(g0), hx,
                         hn::MulAdd(hn::Abs(g1), hy,
                                    hn::MulAdd(hn::Abs(g3), ez, hn::Add(radius, hn::Abs(lean)))));
        }
        most = hn::Min(most, hn::Add(middle, radius));
        least = hn::Min(least, hn::Sub(middle, radius));
      }
      M in = hn::And(met, hn::Ge(most, hn::Zero(d)));
      // As a shaft's blocks (shaft_blocks-inl.h): some point beyond the plane; all for a cover.
      const auto& p = forms.plane_form.f;
      const V p0 = hn::Set(d, p[0][row]), p1 = hn::Set(d, p[1][row]);
      const V middle = hn::MulAdd(p0, mx, hn::MulAdd(p1, my, hn::Set(d, p[2][row])));
      const V radius = hn::MulAdd(hn::Abs(p0), hx,
                                  hn::MulAdd(hn::Abs(p1), hy, hn::Set(d, forms.plane_margin[row])));
      const V fastest = hn::Add(middle, radius), slowest = hn::Sub(middle, radius);
      const V depth = hn::Set(d, forms.depth[row]), bound = hn::Set(d, forms.depth_bound[row]);
      const V plane_lo = hn::Mul(hn::Sub(depth, bound), hn::Set(d, 2.0f - kDepthScale));
      const V plane_hi = hn::Mul(hn::Add(depth, bound), hn::Set(d, kDepthScale));
      const V far = hn::Load(d, bounds_.far + first);
      const V near = hn::Mul(hn::Load(d, bounds_.near + first), hn::Set(d, 2.0f - kDepthScale));
      in = hn::And(in,
                   hn::And(hn::Gt(fastest, hn::Zero(d)), hn::Ge(hn::Mul(far, fastest), plane_lo)));
      const M cover = hn::And(hn::And(hn::Gt(least, hn::Zero(d)), hn::Gt(slowest, hn::Zero(d))),
                              hn::Gt(hn::Mul(near, slowest), plane_hi));
      covered |= MaskBits(d, hn::And(in, cover)) << first;
      touched->count += ListLanes(row << kTriangleShift | static_cast<uint32_t>(first),
                                  hn::AndNot(cover, in), touched->pairs + touched->count);
    }
    return covered;
  }

  // The blocks first .. whose hulls with the light the row's triangle may reach into.
  HWY_INLINE M ReachedBlocks(uint32_t row, size_t first) const {
    const ShaftD d;
    const HullForms& forms = leaf_->forms();
    const V margin = hn::Set(d, kBoxMargin * forms.reach[row] + kFloatUnderflow);
    V z[3];
    for (int c = 0; c < 3; ++c) z[c] = hn::Set(d, forms.corner[c][2][row]);
    M in = hn::FirstN(d, hn::Lanes(d));
    for (int axis = 0; axis < 2; ++axis) {
      for (int end = 0; end < 2; ++end) {
        const V lean = hn::Load(d, blocks_->lean[2 * axis + end] + first);
        V least = hn::Set(d, kInfinity);
        for (int c = 0; c < 3; ++c) {
          const float x = forms.corner[c][axis][row];
          least = hn::Min(least, hn::NegMulAdd(lean, z[c], hn::Set(d, end == 0 ? x : -x)));
        }
        const V side = hn::Load(d, blocks_->side[2 * axis + end] + first);
        in = hn::And(in, hn::Le(hn::Sub(least, margin), side));
      }
    }
    return in;
  }

  // The points of block b that triangle `id` may block, and that some sample still sees.
  HWY_INLINE uint32_t Asked(uint32_t b, uint32_t id) const {
    return AskedOf(rays_, bounds_, b, id);
  }

  // Takes note that `samples` see none of a block's `points`.
  HWY_INLINE void Block(uint32_t b, uint32_t points, uint16_t samples) {
    const hn::CappedTag<uint16_t, kShaftBlockRays> d;
    uint16_t* const row = blocked_ + size_t{b} * kShaftBlockRays;
    const uint8_t bits[8] = {static_cast<uint8_t>(points), static_cast<uint8_t>(points >> 8)};
    const auto now = hn::Load(d, row);
    const auto all =
        hn::IfThenElse(hn::LoadMaskBits(d, bits), hn::Or(now, hn::Set(d, samples)), now);
    hn::Store(all, d, row);
    CloseSeen(b);
  }
  // Drops the points of block b that no sample sees any more.
  HWY_INLINE void CloseSeen(uint32_t b) {
    const hn::CappedTag<uint16_t, kShaftBlockRays> d;
    const auto now = hn::Load(d, blocked_ + size_t{b} * kShaftBlockRays);
    bounds_.open[b] &=
        static_cast<uint16_t>(MaskBits(d, hn::Ne(now, hn::Set(d, uint16_t{0xFFFF}))));
  }

  HWY_NOINLINE void TakeCovers(const LeafView& leaf, uint32_t row, uint32_t covered) {
    for (; covered != 0; covered &= covered - 1) {
      const uint32_t b = std::countr_zero(covered);
      Block(b, Asked(b, leaf.id(row % kMaxLeafTriangles)), leaf_->forms().samples[row]);
    }
    bounds_.open_blocks = OpenBlocks(bounds_.open);
  }

  HWY_NOINLINE void MarkTested(const LeafView& leaf, const Pairs& touched) {
    for (size_t k = 0; k < touched.count; ++k) {
      const uint32_t b = BlockOf(touched.pairs[k]);
      const uint32_t id = leaf.id(TriangleOf(touched.pairs[k]) % kMaxLeafTriangles);
      for (uint32_t rest = Asked(b, id); rest != 0; rest &= rest - 1) {
        packet_.answered_by[b * kShaftBlockRays + std::countr_zero(rest)] = AnsweredBy::kTriangles;
      }
    }
  }

  HWY_INLINE void TestPair(const LeafView& leaf, uint32_t pair) {
    const ShaftD d;
    const HullForms& forms = leaf_->forms();
    const uint32_t b = BlockOf(pair), row = TriangleOf(pair), i = row % kMaxLeafTriangles;
    const size_t at = size_t{b} * kShaftBlockRays;
    uint32_t asked = Asked(b, leaf.id(i));

    // The side of the plane, from the triangle's own corner: as ShaftTest's.
    const Vec3f corner = leaf.corner(0, i);
    const Vec3V<V> a = Broadcast(d, corner.x, corner.y, corner.z);
    const Vec3V<V> normal = Row(forms.normal, row);
    const V normal_bound = hn::Set(d, forms.normal_bound[row]);
    uint32_t beyond = 0, before = 0;
    for (size_t k = 0; k < kBlockVectors; ++k) {
      const Vec3V<V> p = SubV(Points(at + k * kLanes), a);
      const V side = DotV(normal, p);
      const V off = hn::MulAdd(normal_bound, NormInfV(p), hn::Set(d, kFloatUnderflow));
      beyond |= MaskBits(d, hn::Gt(side, off)) << (k * kLanes);
      before |= MaskBits(d, hn::Lt(side, hn::Neg(off))) << (k * kLanes);
    }
    asked &= ~before;
    if (asked == 0) return;

    // The edges, for all samples.
    Edges edges;
    uint32_t some = 0, all = 0;
    for (size_t k = 0; k < kBlockVectors; ++k) {
      const size_t to = k * kLanes;
      const Vec3V<V> q = rays_.Own(at + to);
      const V bound = hn::MulAdd(hn::Set(d, forms.bound_scale[row]), rays_.OwnInf(at + to),
                                 hn::Set(d, forms.bound[row]));
      hn::Store(bound, d, edges.bound + to);
      V most = hn::Set(d, kInfinity), least = most;
      for (int e = 0; e < 3; ++e) {
        const V centre = DotV(Row(forms.edge[e], row), q);
        V lean[2];
        for (int h = 0; h < 2; ++h) {
          const Vec3V<V> n = Row(forms.lean[e][h], row);
          lean[h] = hn::MulAdd(
              n.x, q.x,
              hn::MulAdd(n.y, q.y,
                         hn::MulAdd(n.z, q.z, hn::Set(d, forms.lean_form[e][h].f[3][row]))));
          hn::Store(lean[h], d, edges.lean[e][h] + to);
        }
        hn::Store(centre, d, edges.centre[e] + to);
        const V radius = hn::Add(hn::Abs(lean[0]), hn::Abs(lean[1]));
        most = hn::Min(most, hn::Add(centre, radius));
        least = hn::Min(least, hn::Sub(centre, radius));
      }
      some |= MaskBits(d, hn::Ge(hn::Add(most, bound), hn::Zero(d))) << to;
      all |= MaskBits(d, hn::Gt(hn::Sub(least, bound), hn::Zero(d))) << to;
    }
    asked &= some;
    if ((asked & ~beyond) != 0) beyond |= SettlePlane(leaf, row, at, asked & ~beyond);
    asked &= beyond;
    if (asked == 0) return;
    if ((asked & all) != 0) Block(b, asked & all, forms.samples[row]);
    const uint32_t parted = asked & ~all;
    if (parted == 0) return;
    const int points = std::popcount(parted);
    const uint32_t samples =
        points < kFewPoints ? uint32_t{forms.samples[row]} : ReachingSamples(row, b);
    const int origins = std::popcount(samples);
    stats_->triangle_tests += static_cast<uint64_t>(points) * static_cast<uint64_t>(origins);
    work_ += static_cast<uint32_t>(std::min(points, origins)) * kPointWork;
    if (points < origins) {
      TestPoints(leaf, row, at, parted, samples, edges);
    } else {
      TestSamples(leaf, row, at, parted, samples, edges);
    }
    CloseSeen(b);
  }

  // Those of the row's samples from which some point of block b may be seen through the triangle:
  // the forms of a sample are the centre's and their leanings, added up.
  HWY_INLINE uint32_t ReachingSamples(uint32_t row, uint32_t b) const {
    return ReachingSamples(row, {bounds_.mx[b], bounds_.my[b], bounds_.hx[b], bounds_.hy[b],
                                 blocks_->middle[b], blocks_->extent[b], blocks_->most[b]});
  }
  // The same of all points.
  HWY_INLINE uint32_t ReachingSamples(uint32_t row) const {
    return ReachingSamples(row, {bounds_.cx, bounds_.cy, bounds_.ex, bounds_.ey,
                                 blocks_->all_middle, blocks_->all_extent, blocks_->all_most});
  }
  // A range of slopes and of inverse depths.
  struct Extent {
    float mx, my, hx, hy, middle, half, most;
  };
  HWY_INLINE uint32_t ReachingSamples(uint32_t row, const Extent& of_points) const {
    const ShaftD d;
    const HullForms& forms = leaf_->forms();
    const V mx = hn::Set(d, of_points.mx), my = hn::Set(d, of_points.my);
    const V hx = hn::Set(d, of_points.hx), hy = hn::Set(d, of_points.hy);
    const V iz = hn::Set(d, of_points.middle), ez = hn::Set(d, of_points.half);
    const V margin = hn::Set(d, forms.margin_inverse[row] * of_points.most + forms.margin[row]);
    uint32_t reaching = 0;
    for (size_t k = 0; k < kBlockVectors; ++k) {
      const V s = hn::Load(d, light_.along[0] + k * kLanes);
      const V t = hn::Load(d, light_.along[1] + k * kLanes);
      V most = hn::Set(d, kInfinity);
      for (int e = 0; e < 3; ++e) {
        const auto of = [&](int n, V centre) HWY_ATTR {
          return hn::MulAdd(s, hn::Set(d, forms.lean_form[e][0].f[n][row]),
                            hn::MulAdd(t, hn::Set(d, forms.lean_form[e][1].f[n][row]), centre));
        };
        const auto& f = forms.edge_form[e].f;
        const V f0 = of(0, hn::Set(d, f[0][row])), f1 = of(1, hn::Set(d, f[1][row]));
        const V f2 = of(2, hn::Set(d, f[2][row])), f3 = of(3, hn::Zero(d));
        const V middle = hn::MulAdd(f0, mx, hn::MulAdd(f1, my, hn::MulAdd(f3, iz, f2)));
        const V radius = hn::MulAdd(
            hn::Abs(f0), hx, hn::MulAdd(hn::Abs(f1), hy, hn::MulAdd(hn::Abs(f3), ez, margin)));
        most = hn::Min(most, hn::Add(middle, radius));
      }
      reaching |= MaskBits(d, hn::Ge(most, hn::Zero(d))) << (k * kLanes);
    }
    return reaching & forms.samples[row];
  }

  // Which of the points `parted` each of the `samples` does not see: a vector of points at a time.
  HWY_INLINE void TestSamples(const LeafView& leaf, uint32_t row, size_t at, uint32_t parted,
                              uint32_t samples, const Edges& edges) {
    const ShaftD d;
    const hn::CappedTag<uint16_t, kShaftBlockRays> d16;
    auto blocked = hn::Load(d16, blocked_ + at);
    uint16_t doubts[LightHull::kMostSamples];
    uint32_t some_doubt = 0;
    for (uint32_t left = samples; left != 0; left &= left - 1) {
      const uint32_t k = std::countr_zero(left);
      const V s = hn::Set(d, light_.along[0][k]), t = hn::Set(d, light_.along[1][k]);
      uint32_t hit = 0, open = 0;
      for (size_t v = 0; v < kBlockVectors; ++v) {
        const size_t to = v * kLanes;
        const V bound = hn::Load(d, edges.bound + to);
        V inner = hn::Set(d, kInfinity);
        for (int e = 0; e < 3; ++e) {
          const V value = hn::MulAdd(
              s, hn::Load(d, edges.lean[e][0] + to),
              hn::MulAdd(t, hn::Load(d, edges.lean[e][1] + to), hn::Load(d, edges.centre[e] + to)));
          inner = hn::Min(inner, value);
        }
        hit |= MaskBits(d, hn::Gt(inner, bound)) << to;
        open |= MaskBits(d, hn::Ge(inner, hn::Neg(bound))) << to;
      }
      hit &= parted;
      doubts[k] = static_cast<uint16_t>(open & parted & ~hit);
      some_doubt |= doubts[k];
      const uint8_t bits[8] = {static_cast<uint8_t>(hit), static_cast<uint8_t>(hit >> 8)};
      const auto own = hn::Set(d16, static_cast<uint16_t>(1u << k));
      blocked = hn::IfThenElse(hn::LoadMaskBits(d16, bits), hn::Or(blocked, own), blocked);
    }
    hn::Store(blocked, d16, blocked_ + at);
    if (some_doubt == 0) [[likely]]
      return;
    for (uint32_t left = samples; left != 0; left &= left - 1) {
      const uint32_t k = std::countr_zero(left);
      for (uint32_t doubt = doubts[k]; doubt != 0; doubt &= doubt - 1) {
        uint16_t& seen = blocked_[at + std::countr_zero(doubt)];
        if ((seen >> k & 1) != 0) continue;
        seen = static_cast<uint16_t>(
            seen | SettleSamples(leaf, row, at + std::countr_zero(doubt), 1u << k));
      }
    }
  }

  // The same, a vector of samples at a time.
  HWY_INLINE void TestPoints(const LeafView& leaf, uint32_t row, size_t at, uint32_t parted,
                             uint32_t samples, const Edges& edges) {
    const ShaftD d;
    for (; parted != 0; parted &= parted - 1) {
      const uint32_t lane = std::countr_zero(parted);
      const V bound = hn::Set(d, edges.bound[lane]);
      uint32_t hit = 0, open = 0;
      for (size_t k = 0; k < kBlockVectors; ++k) {
        const V s = hn::Load(d, light_.along[0] + k * kLanes);
        const V t = hn::Load(d, light_.along[1] + k * kLanes);
        V inner = hn::Set(d, kInfinity);
        for (int e = 0; e < 3; ++e) {
          const V value = hn::MulAdd(
              s, hn::Set(d, edges.lean[e][0][lane]),
              hn::MulAdd(t, hn::Set(d, edges.lean[e][1][lane]), hn::Set(d, edges.centre[e][lane])));
          inner = hn::Min(inner, value);
        }
        hit |= MaskBits(d, hn::Gt(inner, bound)) << (k * kLanes);
        open |= MaskBits(d, hn::Ge(inner, hn::Neg(bound))) << (k * kLanes);
      }
      uint16_t& blocked = blocked_[at + lane];
      hit &= samples;
      const uint32_t doubt = open & samples & ~hit & ~blocked;
      blocked = static_cast<uint16_t>(blocked | hit);
      if (doubt != 0) [[unlikely]] {
        blocked = static_cast<uint16_t>(blocked | SettleSamples(leaf, row, at + lane, doubt));
      }
    }
  }

  // Which of the samples `doubt` do not see a point, for certain.
  HWY_NOINLINE uint32_t SettleSamples(const LeafView& leaf, uint32_t row, size_t lane,
                                      uint32_t doubt) {
    const uint32_t i = row % kMaxLeafTriangles;
    const Vec3f corners[3] = {leaf.corner(0, i), leaf.corner(1, i), leaf.corner(2, i)};
    const Vec3f p = packet_.target(static_cast<int>(lane));
    stats_->doubt_double += static_cast<uint64_t>(std::popcount(doubt));
    work_ += kDoubtWork;
    // e(L, P) is (P-A)×(B-A)·(L-A): an edge's side is that of the plane through it and the point.
    const ShaftD d;
    uint32_t inside = doubt, outside = 0;
    for (int e = 0; e < 3; ++e) {
      const Vec3f from = corners[e];
      const Vec3d to_point = ToDouble(p) - ToDouble(from);
      const Vec3d edge = ToDouble(corners[(e + 1) % 3]) - ToDouble(from);
      uint32_t in = 0;
      for (size_t k = 0; k < kBlockVectors; ++k) {
        const Vec3V<V> samples = {hn::Load(d, light_.rows[0] + k * kLanes),
                                  hn::Load(d, light_.rows[1] + k * kLanes),
                                  hn::Load(d, light_.rows[2] + k * kLanes)};
        const V side = SideInDoubles(to_point, edge, leaf_->forms().turn[row], &from, samples);
        in |= MaskBits(d, hn::Gt(side, hn::Zero(d))) << (k * kLanes);
        outside |= MaskBits(d, hn::Lt(side, hn::Zero(d))) << (k * kLanes);
      }
      inside &= in;
    }
    uint32_t hit = inside;
    for (uint32_t left = doubt & ~(inside | outside); left != 0; left &= left - 1) {
      const uint32_t k = std::countr_zero(left);
      PredicateStage stage;
      const PredicateRay ray = PredicateRay::Segment(light_.samples[k], p);
      if (Blocks(ray, corners[0], corners[1], corners[2], &stage)) hit |= 1u << k;
      stats_->doubt_exact += stage == PredicateStage::kExact;
      work_ += kDoubtWork;
    }
    return hit;
  }

  // Which of the points `open` of a block are beyond the row's plane, for certain.
  HWY_NOINLINE uint32_t SettlePlane(const LeafView& leaf, uint32_t row, size_t at, uint32_t open) {
    const ShaftD d;
    const uint32_t i = row % kMaxLeafTriangles;
    const Vec3f a = leaf.corner(0, i), b = leaf.corner(1, i), c = leaf.corner(2, i);
    const float turn = leaf_->forms().turn[row];
    uint32_t beyond = 0, unknown = 0;
    for (size_t k = 0; k < kBlockVectors; ++k) {
      const V side = SideInDoubles(ToDouble(b) - ToDouble(a), ToDouble(c) - ToDouble(a), turn, &a,
                                   Points(at + k * kLanes));
      beyond |= MaskBits(d, hn::Gt(side, hn::Zero(d))) << (k * kLanes);
      unknown |= MaskBits(d, hn::Eq(side, hn::Zero(d))) << (k * kLanes);
    }
    beyond &= open;
    stats_->doubt_double += static_cast<uint64_t>(std::popcount(open));
    for (uint32_t left = unknown & open; left != 0; left &= left - 1) {
      const uint32_t lane = std::countr_zero(left);
      const int side = SideOfPlane(a, b, c, packet_.target(static_cast<int>(at + lane)));
      if (static_cast<float>(side) * turn > 0) beyond |= 1u << lane;
      ++stats_->doubt_exact;
    }
    return beyond;
  }

  Vec3V<V> Points(size_t at) const {
    return {rays_.Point(0, at), rays_.Point(1, at), rays_.Point(2, at)};
  }
  static HWY_INLINE Vec3V<V> Row(const float (&rows)[3][kHullRows], uint32_t row) {
    return Broadcast(ShaftD(), rows[0][row], rows[1][row], rows[2][row]);
  }

  // So much of a leaf's triangles and samples, if the points see most of them together, is put to
  // the points at once, though they are small.
  static constexpr float kMostReach = 0.9f;
  // So many points are put to all samples, without a look at which they are seen from.
  static constexpr int kFewPoints = 5;
  // Work, some ten instructions each.
  static constexpr uint32_t kNodeWork = 4, kLeafWork = 40, kRowWork = 8, kPairWork = 8,
                            kPointWork = 2, kDoubtWork = 8;
  static constexpr size_t kStackSize = kBvhStackSize + ShaftCut::kMaxChildren + kBvhWidth;

  const IndexedGeometry& scene_;
  const LightHull& light_;
  const HullCutMaker& hull_;
  RayPacket& packet_;
  const uint32_t budget_;
  uint16_t* const blocked_;
  WalkStats* const stats_;
  HullRays rays_;
  const VisitFetcher fetcher_;
  HullLeaf* leaf_ = nullptr;
  uint32_t work_ = 0;
  ChildRef rest_[ShaftCut::kMaxChildren];
  uint32_t rest_count_ = 0;
  uint16_t rest_samples_ = 0;
  ShaftBounds bounds_;
  const HullBlocks* blocks_ = nullptr;
};

// As TraceHullFn says.
inline bool TraceHull(const IndexedGeometry& scene, const LightHull& light, RayPacket& packet,
                      const ShaftCut* from, uint32_t budget, HullRest* rest, uint16_t* blocked,
                      const CancelToken* cancel, WalkStats* stats) {
  SIGHTLINE_DCHECK(packet.segments && packet.count > 0);
  std::fill_n(blocked, packet.count, uint16_t{0});
  if (scene.bvh.empty()) return false;
  const std::span<const Vec3f> origins(light.samples, light.count);
  HullCutMaker hull(scene, origins, {&packet, 1});
  if (!hull.Make(from, &rest->cut)) return false;
  rest->samples = rest->cut.node_count > 0 ? 0xFFFF : 0;
  if (budget == 0 || rest->samples == 0 || !light.flat() ||
      MustAskObjects(scene.geometry, packet.mask)) {
    return true;
  }
  packet.origin = light.centre;
  HullWalk walk(scene, light, hull, packet, budget, blocked, stats);
  if (walk.Prepare()) walk.Run(rest, cancel);
  return true;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
