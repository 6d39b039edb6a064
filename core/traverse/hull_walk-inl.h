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
#include "core/traverse/hull_cut-inl.h"
#include "core/traverse/hull_leaf-inl.h"
#include "core/traverse/hull_test-inl.h"
#include "core/traverse/light_hull.h"
#include "core/traverse/shaft_pair-inl.h"
#include "core/traverse/shaft_rays-inl.h"
#include "core/traverse/single-inl.h"
#include "core/traverse/visit_fetcher-inl.h"

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
  bool Prepare() {
    if (!rays_.Prepare(/*alone=*/true)) return false;
    if (rays_.Bound(rays_.all(), &bounds_) != 0 && !rays_.Fits(bounds_)) return false;
    rays_.LeaveSeed();
    return true;
  }

  // From rest->cut, where what is left to be walked sample by sample comes. REQUIRES: Prepare() was
  // true.
  void Run(HullRest* rest, const CancelToken* cancel) {
    const HullBlocks blocks(light_, rays_, bounds_);
    blocks_ = &blocks;
    const auto none = static_cast<uint16_t>(~AllSamples());  // Those there are not.
    std::fill_n(blocked_, RayPacket::kMaxRays, none);
    HullLeaf leaf(light_, hull_, rays_);
    leaf_ = &leaf;
    HullTest test(light_, rays_, packet_, leaf.forms(), blocks, &bounds_, blocked_, stats_);
    test_ = &test;
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
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();

  // A row of the leaf's and a block: block | row << kTriangleShift.
  struct Pairs {
    size_t count = 0;
    // A whole vector is stored at its end.
    alignas(64) uint32_t pairs[kHullRows * kShaftBlocks + kShaftBlocks];
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
      const bool stops = is_full || work_ + test_->work() > budget_ || cancelled;
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
        const uint32_t own = test_->ReachingSamples(std::countr_zero(left));
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
    for (size_t k = 0; k < touched.count; ++k) {
      test_->Test(leaf, TriangleOf(touched.pairs[k]), BlockOf(touched.pairs[k]));
    }
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

  HWY_NOINLINE void TakeCovers(const LeafView& leaf, uint32_t row, uint32_t covered) {
    for (; covered != 0; covered &= covered - 1) {
      const uint32_t b = std::countr_zero(covered);
      test_->Block(b, test_->Asked(b, leaf.id(row % kMaxLeafTriangles)),
                   leaf_->forms().samples[row]);
    }
    bounds_.open_blocks = OpenBlocks(bounds_.open);
  }

  HWY_NOINLINE void MarkTested(const LeafView& leaf, const Pairs& touched) {
    for (size_t k = 0; k < touched.count; ++k) {
      const uint32_t b = BlockOf(touched.pairs[k]);
      const uint32_t id = leaf.id(TriangleOf(touched.pairs[k]) % kMaxLeafTriangles);
      for (uint32_t rest = test_->Asked(b, id); rest != 0; rest &= rest - 1) {
        packet_.answered_by[b * kShaftBlockRays + std::countr_zero(rest)] = AnsweredBy::kTriangles;
      }
    }
  }

  // So much of a leaf's triangles and samples, if the points see most of them together, is put to
  // the points at once, though they are small.
  static constexpr float kMostReach = 0.9f;
  // Work, some ten instructions each.
  static constexpr uint32_t kNodeWork = 4, kLeafWork = 40, kRowWork = 8, kPairWork = 8;
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
  HullTest* test_ = nullptr;
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
