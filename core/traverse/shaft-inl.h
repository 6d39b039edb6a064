// SPDX-License-Identifier: Apache-2.0
//
// The shaft walk: up to 256 rays with one origin, or one direction, or the 512 of two packets, are
// one convex shaft, and one walk of the tree answers them all (paper 002 for shafts and relevant
// triangles; paper 000 for vertex culling). Unlike a packet's, a node's cost does not depend on the
// number of rays.
//
//  1. A node's eight boxes are put to the shaft's sides, its shadows, its end and the receivers'
//     caps: one along their surface, one across each axis.
//  2. A leaf's sixteen triangles are put to the same planes by their vertices, and their forms to
//     the whole shaft (shaft_leaf-inl.h); those left are relevant.
//  3. A relevant triangle is put to sixteen blocks of sixteen rays (of two packets, 32) at once,
//     each with its own rectangle and range of depths, one block per SIMD lane: blocks it misses
//     drop out; blocks it covers whole and stands before are blocked whatever a test would say; the
//     rest take the exact test, ray by ray (shaft_test-inl.h).
//  4. When any hit will do and a walk has cost too much, its rays are split at the middle of their
//     widest extent, and both halves go on with what is left on the stack.
//  5. Closest hits are ordered by bounds of their inverse distance; only two whose bounds overlap
//     are compared exactly, and only winners get an exact distance (finish-inl.h).
//
// Culls carry the margins of core/shaft/margins.h; what is kept the exact predicate decides.
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_INL_H_
#endif

#include "core/base/cancel.h"
#include "core/base/check.h"
#include "core/base/fill-inl.h"
#include "core/base/masked_store-inl.h"
#include "core/intersect/box_ray-inl.h"
#include "core/intersect/hit.h"
#include "core/traverse/clear_leaves-inl.h"
#include "core/traverse/finish-inl.h"
#include "core/traverse/shaft_blocks-inl.h"
#include "core/traverse/shaft_cut-inl.h"
#include "core/traverse/shaft_leaf-inl.h"
#include "core/traverse/shaft_node-inl.h"
#include "core/traverse/shaft_pair-inl.h"
#include "core/traverse/shaft_rays-inl.h"
#include "core/traverse/shaft_singles-inl.h"
#include "core/traverse/shaft_test-inl.h"
#include "core/traverse/visit_fetcher-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Work (nodes + 2·leaves + relevant triangles) after which a walk's rays are split in two.
constexpr uint32_t kSplitBudget = 80;
// Sets this small are not split: their walk costs about what two halves would.
constexpr int kLeastSplitRays = 6;
// Splits of a packet: where each takes off a ray, those within others would fill a thread's stack.
constexpr int kMostSplits = 64;
// Work per ray after which the rays of a small set are traced one by one: they are spread too far,
// or too far from their reference, for a shaft to cull anything.
constexpr uint32_t kSingleWork = 16;
// Inverse distances above this are compared exactly: their products might overflow.
constexpr float kLargestInverse = 0x1p100f;
// A segment's hit is not beyond its end: the inverse of kSegmentEnd, rounding included.
constexpr float kEndInverse = 1.0f - 0x1p-19f;
static_assert(double{kEndInverse} * double{kSegmentEnd} < 1);

template <bool kAny, bool kParallel, class PacketType = ShaftPacket<kParallel>>
class ShaftWalk {
 public:
  using Packet = PacketType;

  ShaftWalk(const IndexedGeometry& scene, Packet& packet, WalkStats* stats)
      : scene_(scene),
        packet_(packet),
        stats_(stats),
        rays_(scene, packet),
        ready_(MakeReady()),
        fetcher_(scene.bvh) {}

  // False: the rays fit no frame.
  bool Prepare() {
    // They may fit one of their own where they do not fit their neighbours'.
    if (!Place(/*alone=*/false) && !(rays_.seeded() && Place(/*alone=*/true))) return false;
    if constexpr (!Rays::kPair) {
      if (!kAny || packet_.blocked == nullptr) {
        FillRow(packet_.triangle, rays_.padded(), kNoTriangle);
      }
    }
    return true;
  }

  // From `cut`, or from the root if it is null. Returns false if `cancel` fired. REQUIRES:
  // Prepare() was true.
  bool Run(const ShaftCut* cut, const CancelToken* cancel) {
    cancel_ = cancel;
    if constexpr (!kAny) {
      FillRow(best_lo_, rays_.padded(), -kInfinity);
      FillRow(best_hi_, rays_.padded(), -kInfinity);
      ray_count_ = Take(rays_.all());
    }
    if constexpr (kAny) lit_ = {};
    if (!scene_.bvh.empty()) {
      Leaf leaf(scene_, rays_);
      leaf_ = &leaf;
      Pending stack[kStackSize];
      if (!Walk(ray_count_, cut, stack, 0)) return false;
      if constexpr (kAny) {
        if (!singles_.empty() && !singles_.Trace(scene_, packet_, cancel_, &lit_, stats_)) {
          return false;
        }
        SayBlocked();
      }
    } else if constexpr (kAny) {
      lit_ = rays_.all();
      SayBlocked();
    }
    if constexpr (!kAny) FinishHits(ready_, packet_);
    return true;
  }

 private:
  using V = ShaftV;
  using M = ShaftM;
  using Rays = ShaftRays<kAny, kParallel, Packet>;
  using Leaf = ShaftLeaf<kAny, kParallel, Packet>;
  using Test = ShaftTest<kAny, kParallel, Rays>;
  using Set = typename Rays::Set;
  using Bits = typename Rays::Bits;
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  static constexpr size_t kLanes = hn::MaxLanes(ShaftD());
  static constexpr size_t kBlockVectors = Rays::kRays / kLanes;
  // Nodes visited together where any hit will do, as long as few are pending: beyond, a depth-first
  // walk adds no more than kBvhStackSize.
  static constexpr uint32_t kNodesAtOnce = 4;
  static constexpr int kManyPending = static_cast<int>(kBvhStackSize + ShaftCut::kMaxChildren);
  // What a walk can have pending; a whole vector of children is stored at its end.
  static constexpr size_t kStackSize =
      kManyPending + kNodesAtOnce * kBvhWidth + kBvhStackSize + kBvhWidth;

  // For closest hits `entry` is the depth that nothing in the child comes before.
  using Pending = std::conditional_t<kAny, PendingAny, PendingClosest>;

  // Has the rays placed; for any hit takes them up. False: they fit no frame, or not this one.
  bool Place(bool alone) {
    if (!rays_.Prepare(alone)) return false;
    if constexpr (kAny) {
      ray_count_ = Take(rays_.all());
      if (ray_count_ != 0 && !rays_.Fits(bounds_)) return false;
      rays_.LeaveSeed();
    }
    return true;
  }

  // Takes up the rays of a set. Returns how many there are.
  HWY_INLINE int Take(const Set& set) {
    FetchMeanwhile();
    const int rays = rays_.Bound(set, &bounds_);
    FetchMeanwhile();
    if constexpr (!kAny) UpdateFar();
    return rays;
  }

  // The rays that were taken up, of which there are `rays`. `depth` entries are on the stack; if
  // there are none, begins at `cut` or the root. Returns false if cancelled.
  bool Walk(int rays, const ShaftCut* cut, Pending* stack, int depth) {
    if (rays == 0) return true;
    if (depth == 0) {
      if constexpr (kAny) {
        if (packet_.first_leaf != RayPacket::kNoLeaf) {
          const ChildRef first = ChildRef::FromBits(packet_.first_leaf);
          SIGHTLINE_DCHECK(scene_.bvh.HoldsLeaf(first)) << "first leaf " << packet_.first_leaf;
          if (LookAway(first)) VisitLeaf(first);
          if (bounds_.open_blocks == 0) return true;
          packet_.first_leaf = RayPacket::kNoLeaf;
        }
      }
    }
    // Those to visit now, the last one first; several at a time, so that none waits for what the
    // others push. Visited in one place: walks are as long as an instruction cache holds.
    const BvhNode* nodes[std::max(ShaftCut::kMaxNodes, kNodesAtOnce)];
    uint32_t count = 0;
    if (depth == 0) {
      if (cut == nullptr) nodes[count++] = scene_.bvh.nodes.data();
      for (uint32_t i = 0; cut != nullptr && i < cut->node_count; ++i)
        nodes[count++] = &cut->nodes[i];
    }
    uint32_t work = 0, limit = kSplitBudget;
    for (;;) {
      while (count > 0) depth = VisitNode(*nodes[--count], stack, depth);
      if (kAny && work > limit && depth > 0) {
        Set halves[2];
        // Where all are in one place, parting them gains nothing.
        if (rays >= 2 * kLeastSplitRays && splits_ < kMostSplits && rays_.Split(bounds_, halves)) {
          return WalkHalves(halves, stack, depth);
        }
        if (limit > kSplitBudget) {
          singles_.Take(&bounds_);
          return true;
        }
        limit = std::max<uint32_t>(kSplitBudget, kSingleWork * rays) + 1;
      }
      if (depth == 0) {
        if constexpr (kAny) KeepLit();
        return true;
      }
      const Pending pending = stack[--depth];
      if (pending.after(bounds_.all_far)) continue;
      if (++visited_ % kPollInterval == 0 && cancel_ != nullptr && cancel_->cancelled())
        return false;
      if (depth > 0) fetcher_.FetchAll(stack[depth - 1].ref());
      FetchMeanwhile();
      const ChildRef ref = pending.ref();
      if (ref.is_leaf()) {
        if (!LookAway(ref)) continue;
        work += 2 + VisitLeaf(ref);
        if (bounds_.open_blocks == 0) {
          if constexpr (kAny) packet_.first_leaf = ref.bits();
          return true;
        }
        continue;
      }
      nodes[count++] = &scene_.bvh.nodes[ref.node()];
      if constexpr (kAny) {
        while (count < kNodesAtOnce && depth > 0 && depth < kManyPending &&
               stack[depth - 1].ref().is_inner()) {
          nodes[count++] = &scene_.bvh.nodes[stack[--depth].ref().node()];
        }
      }
      work += count;
    }
  }

  HWY_INLINE void FetchMeanwhile() {
    if constexpr (kAny) {
      if (packet_.meanwhile == nullptr) return;
      packet_.meanwhile->Some();
      if constexpr (Rays::kPair) packet_.meanwhile->Some();  // Of which a ray has half as many.
    }
  }

  // Both halves of a set, each with what is left on the stack.
  HWY_NOINLINE bool WalkHalves(const Set (&halves)[2], Pending* stack, int depth) {
    ++stats_->shaft.splits;
    ++splits_;
    Pending copy[kStackSize];
    std::copy_n(stack, depth, copy);
    if (!Walk(Take(halves[0]), nullptr, copy, depth)) return false;
    packet_.first_leaf = RayPacket::kNoLeaf;  // Only what ends the last set is left behind.
    return Walk(Take(halves[1]), nullptr, stack, depth);
  }

  // Of the present set, whose walk is over, those still asked about are lit.
  HWY_INLINE void KeepLit() {
    const hn::CappedTag<Bits, kShaftBlocks> d;
    hn::Store(hn::Or(hn::Load(d, lit_.rays), hn::Load(d, bounds_.open)), d, lit_.rays);
  }
  // What is left of all rays is blocked.
  HWY_INLINE void SayBlocked() {
    if (packet_.blocked == nullptr) return;
    const hn::CappedTag<Bits, kShaftBlocks> d;
    hn::StoreU(hn::AndNot(hn::Load(d, lit_.rays), hn::LoadU(d, rays_.all().rays)), d,
               packet_.blocked);
  }

  // Pushes the boxes that the shaft may meet, for closest hits the nearest on top. Returns the new
  // depth.
  HWY_INLINE int VisitNode(const BvhNode& node, Pending* stack, int depth) {
    ++stats_->nodes;
    const ShaftNodeD d8;
    using V8 = hn::Vec<ShaftNodeD>;
    auto met = MayMeet(node, bounds_, rays_);
    if constexpr (kAny) {
      return depth + PushChildren(d8, node, met, stack + depth);
    } else {
      const Vec3f w = rays_.frame().w;
      V8 nearest = hn::Set(d8, -depth_of_apex_);
      for (int k = 0; k < 3; ++k) {
        nearest = hn::MulAdd(hn::Set(d8, w[k]), hn::Load(d8, node.bounds[w[k] >= 0 ? k : k + 3]),
                             nearest);
      }
      met = hn::And(met, hn::Le(nearest, hn::Set(d8, bounds_.all_far)));
      HWY_ALIGN float depths[kBvhWidth];
      hn::Store(nearest, d8, depths);
      return PushNearestOnTop(node, MaskBits(d8, met), depths, stack, depth);
    }
  }

  // Leaves out those blocks that a leaf blocks nothing of. Returns whether any are left; VisitLeaf
  // puts the others back.
  HWY_INLINE bool LookAway(ChildRef ref) {
    if constexpr (!kAny) return true;
    const uint32_t open = bounds_.open_blocks & ~ClearBlocks(packet_.clear, ref.bits());
    if (open == 0) return false;
    bounds_.open_blocks = open;
    return true;
  }

  // Returns the number of relevant triangles.
  uint32_t VisitLeaf(ChildRef ref) {
    ++stats_->leaves;
    const LeafView leaf(scene_, ref);
    const uint32_t relevant = leaf_->Prepare(leaf, bounds_, bounds_.all_far);
    found_ = false;
    BlockPairs touched;
    uint64_t tests = 0, covers = 0;
    const TriangleBlocks<kAny, kParallel, Packet> blocks(rays_, bounds_, leaf_->forms());
    for (uint32_t left = relevant; left != 0; left &= left - 1) {
      const uint32_t i = std::countr_zero(left);
      const uint32_t covered = blocks.List(i, &touched);
      if (covered != 0) [[unlikely]] {
        covers += static_cast<uint64_t>(std::popcount(covered));
        TakeCovers(leaf, i, covered);
      }
    }
    MarkTested(rays_, bounds_, leaf, touched, packet_.answered_by);
    // Those in doubt wait, so that no test has to know how the one before ended.
    PairInDoubt doubts[std::size(touched.pairs)];
    size_t doubtful = 0;
    for (size_t k = 0; k < touched.count; ++k) {
      const uint32_t pair = touched.pairs[k], open = TestBlock(leaf, pair, &tests);
      doubts[doubtful] = {pair, open};
      doubtful += open != 0 ? 1 : 0;
    }
    for (size_t k = 0; k < doubtful; ++k) SettleBlock(leaf, doubts[k]);
    if constexpr (kAny) {
      bounds_.open_blocks = OpenBlocks(bounds_.open);
    } else {
      if (found_) UpdateFar();
    }
    stats_->triangle_tests += tests;
    stats_->shaft.covers += covers;
    const auto relevant_count = static_cast<uint32_t>(std::popcount(relevant));
    stats_->shaft.triangles += leaf.count;
    stats_->shaft.relevant += relevant_count;
    stats_->shaft.pairs += covers + touched.count;
    return relevant_count;
  }

  // All rays of the blocks `covered`, before which triangle i stands.
  HWY_NOINLINE void TakeCovers(const LeafView& leaf, uint32_t i, uint32_t covered) {
    for (; covered != 0; covered &= covered - 1) {
      const uint32_t b = std::countr_zero(covered);
      M hit[kBlockVectors];
      BlockLanes(Asked(b, leaf.id(i)), hit);
      Take(leaf, i, b, hit);
    }
    if constexpr (kAny) bounds_.open_blocks = OpenBlocks(bounds_.open);
  }

  // The rays of one block that are still asked about, by floats, without a branch that depends on
  // them: whether a ray is hit cannot be foretold. Returns those left in doubt.
  HWY_INLINE uint32_t TestBlock(const LeafView& leaf, uint32_t pair, uint64_t* tests) {
    const ShaftD d;
    const uint32_t b = BlockOf(pair), i = TriangleOf(pair);
    const size_t at = size_t{b} * Rays::kRays;
    const uint32_t asked = Asked(b, leaf_->forms().id[i]);
    *tests += static_cast<uint64_t>(std::popcount(asked));
    M hit[kBlockVectors];
    BlockLanes(asked, hit);
    typename Test::Floats said[kBlockVectors];
    Test(rays_, leaf, leaf_->forms()).InFloats(i, at, said);
    uint32_t open = 0;
    for (size_t k = 0; k < kBlockVectors; ++k) {
      open |= MaskBits(d, hn::AndNot(said[k].hit, hn::And(hit[k], said[k].open))) << (k * kLanes);
      hit[k] = hn::And(hit[k], said[k].hit);
    }
    Take(leaf, i, b, hit);
    return open;
  }

  // Takes note of the rays of block b that triangle i hits.
  HWY_INLINE void Take(const LeafView& leaf, uint32_t i, uint32_t b,
                       const M (&hit)[kBlockVectors]) {
    const size_t at = size_t{b} * Rays::kRays;
    if constexpr (kAny) {
      const uint32_t id = leaf_->forms().id[i];
      uint32_t blocked = 0;
      for (size_t k = 0; k < kBlockVectors; ++k) {
        blocked |= Block(id, at + k * kLanes, hit[k]) << (k * kLanes);
      }
      bounds_.open[b] &= static_cast<Bits>(~blocked);
    } else {
      KeepCloser(leaf, i, at, hit);
    }
  }

  // The rays of a block that were left in doubt, for certain.
  HWY_NOINLINE void SettleBlock(const LeafView& leaf, PairInDoubt doubt) {
    const Test test(rays_, leaf, leaf_->forms());
    const uint32_t b = BlockOf(doubt.pair), i = TriangleOf(doubt.pair);
    const uint32_t id = leaf.id(i);
    // Those that another triangle has blocked by now are asked about no more.
    M lanes[kBlockVectors];
    BlockLanes(doubt.rays & bounds_.open[b], lanes);
    for (size_t k = 0; k < kBlockVectors; ++k) {
      const size_t at = size_t{b} * Rays::kRays + k * kLanes;
      const M hit[1] = {test.Settle(
          i, at, lanes[k], [&](int lane) HWY_ATTR { return packet_.ray(lane); }, stats_)};
      if constexpr (kAny) {
        bounds_.open[b] &= static_cast<Bits>(~(Block(id, at, hit[0]) << (k * kLanes)));
      } else {
        KeepCloser(leaf, i, at, hit);
      }
    }
  }

  // The rays of block b that triangle `id` may answer.
  HWY_INLINE uint32_t Asked(uint32_t b, uint32_t id) const {
    return AskedOf(rays_, bounds_, b, id);
  }

  // Takes note of what triangle `id` blocks; returns their bits.
  HWY_INLINE uint32_t Block(uint32_t id, size_t at, M hit) {
    const ShaftD d;
    const hn::RebindToUnsigned<ShaftD> du;
    if constexpr (!Rays::kPair) {
      if (packet_.blocked == nullptr) {
        StoreWhere(hn::RebindMask(du, hit), hn::Set(du, id), du, packet_.triangle + at);
      }
    }
    return MaskBits(d, hit);
  }

  // Keeps the least hit by (t, id) in the lanes of `hit`, vectors from `at` on. Bounds of 1/t
  // decide where they do not overlap.
  template <size_t kVectors>
  HWY_INLINE void KeepCloser(const LeafView& leaf, uint32_t i, size_t at,
                             const M (&hit)[kVectors]) {
    const ShaftD d;
    const hn::RebindToUnsigned<ShaftD> du;
    const LeafForms& forms = leaf_->forms();
    found_ = true;
    const Vec3V<V> normal =
        Broadcast(d, forms.normal[0][i], forms.normal[1][i], forms.normal[2][i]);
    const V rate_bound = hn::Set(d, forms.rate_bound[i]);
    const V inverse_lo = hn::Set(d, forms.inverse_lo[i]);
    const V inverse_hi = hn::Set(d, forms.inverse_hi[i]);
    const auto id = hn::Set(du, leaf.id(i));
    uint32_t open = 0;
    for (size_t k = 0; k < kVectors; ++k, at += kLanes) {
      const V rate = DotV(normal, rays_.Own(at));  // N·D.
      const V bound = hn::MulAdd(rate_bound, rays_.OwnInf(at), hn::Set(d, kFloatUnderflow));
      const V lo = hn::Mul(hn::Sub(rate, bound), inverse_lo);
      const V hi = hn::Mul(hn::Add(rate, bound), inverse_hi);
      const M sound =
          hn::And(hn::Gt(rate, hn::Add(bound, bound)), hn::Lt(hi, hn::Set(d, kLargestInverse)));
      const V best_lo = hn::Load(d, best_lo_ + at), best_hi = hn::Load(d, best_hi_ + at);
      const M closer = hn::And(hn::And(hit[k], sound), hn::Gt(lo, best_hi));
      const M farther = hn::And(sound, hn::Lt(hi, best_lo));
      uint32_t* ids = packet_.triangle + at;
      hn::Store(hn::IfThenElse(closer, lo, best_lo), d, best_lo_ + at);
      hn::Store(hn::IfThenElse(closer, hi, best_hi), d, best_hi_ + at);
      hn::Store(hn::IfThenElse(hn::RebindMask(du, closer), id, hn::Load(du, ids)), du, ids);
      open |= MaskBits(d, hn::AndNot(hn::Or(closer, farther), hit[k])) << (k * kLanes);
    }
    at -= kVectors * kLanes;
    for (; open != 0; open >>= kLanes, at += kLanes) {
      const uint32_t lanes = open & ((1u << kLanes) - 1);
      if (lanes != 0) KeepCloserExactly(leaf, i, at, lanes);
    }
  }

  // The same for lanes whose bounds overlap, by their distances.
  HWY_NOINLINE void KeepCloserExactly(const LeafView& leaf, uint32_t i, size_t at, uint32_t open) {
    const ShaftD d;
    const hn::RebindToUnsigned<ShaftD> du;
    const uint32_t id = leaf.id(i);
    const Vec3f o = packet_.origin;
    const Vec3V<V> target = {hn::Load(d, packet_.target_x + at), hn::Load(d, packet_.target_y + at),
                             hn::Load(d, packet_.target_z + at)};
    const Vec3V<V> inv =
        SlabReciprocals(d, packet_.segments ? SubV(target, Broadcast(d, o.x, o.y, o.z)) : target);
    const auto distances = [&](const auto& terms) HWY_ATTR {
      return EvaluateHits<false>(d, terms, o, packet_.segments, target, inv, nullptr,
                                 static_cast<V*>(nullptr), static_cast<V*>(nullptr));
    };
    const TriangleTerms own = {
        TriangleDistance::Make(o, leaf.corner(0, i), leaf.corner(1, i), leaf.corner(2, i)), {}};
    const V t_new = distances(OneTriangleTerms<ShaftD>(own));
    const auto old_ids = hn::Load(du, packet_.triangle + at);
    const auto has_old = hn::Ne(old_ids, hn::Set(du, kNoTriangle));
    V t_old = hn::Set(d, kInfinity);
    if (const uint32_t with_old = open & MaskBits(du, has_old); with_old != 0) {
      HitTerms<ShaftD, false> terms;
      ready_.Fill(packet_.triangle + at, with_old, &terms);
      t_old = hn::IfThenElse(hn::RebindMask(d, has_old), distances(terms), t_old);
    }
    const auto lower = hn::Lt(hn::Set(du, id), old_ids);  // kNoTriangle is above every id.
    const M asked = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(&open));
    const M better =
        hn::Or(hn::Lt(t_new, t_old), hn::And(hn::Eq(t_new, t_old), hn::RebindMask(d, lower)));
    hn::Store(hn::IfThenElse(hn::RebindMask(du, hn::And(asked, better)), hn::Set(du, id), old_ids),
              du, packet_.triangle + at);
    const V inverse = hn::Div(hn::Set(d, 1.0f), hn::IfThenElse(better, t_new, t_old));
    const V lo = hn::Min(hn::Mul(inverse, hn::Set(d, 1 - kInverseMargin)),
                         hn::Set(d, std::numeric_limits<float>::max()));
    const V hi = hn::Mul(inverse, hn::Set(d, 1 + kInverseMargin));
    hn::Store(hn::IfThenElse(asked, lo, hn::Load(d, best_lo_ + at)), d, best_lo_ + at);
    hn::Store(hn::IfThenElse(asked, hi, hn::Load(d, best_hi_ + at)), d, best_hi_ + at);
  }

  // Per block and in all, the depth beyond which no open ray looks.
  void UpdateFar() {
    const ShaftD d;
    HWY_ALIGN float least[kShaftBlocks];  // Of the inverse depths of what has been hit.
    const V no_hit = hn::Set(d, rays_.segments() ? kEndInverse : 0.0f);
    const auto nearest = [&](size_t at) HWY_ATTR {
      return hn::Max(hn::Load(ShaftD(), best_lo_ + at), no_hit);
    };
    const auto least_of = [](V a, V b) HWY_ATTR { return hn::Min(a, b); };
    if (rays_.grid() != nullptr) {
      ReduceBlocks(least_of, nearest, least);
      for (size_t b = 0; b < kShaftBlocks; b += kLanes) {
        hn::Store(hn::Div(hn::Load(d, least + b), hn::Load(d, bounds_.depth + b)), d, least + b);
      }
    } else if (bounds_.whole) {
      ReduceBlocks(
          least_of,
          [&](size_t at) HWY_ATTR { return hn::Mul(nearest(at), rays_.InverseDepth(at)); }, least);
    } else {
      ReduceBlocks(
          least_of,
          [&](size_t at) HWY_ATTR {
            const ShaftD d16;
            return hn::IfThenElse(LanesOf(bounds_.open, at),
                                  hn::Mul(nearest(at), rays_.InverseDepth(at)),
                                  hn::Set(d16, kInfinity));
          },
          least);
    }
    V all = hn::Set(d, kInfinity);
    // An inverse depth beyond all floats: its depth, below 2^-128, is not 0.
    const V largest = hn::Set(d, std::numeric_limits<float>::max());
    for (size_t b = 0; b < kShaftBlocks; b += kLanes) {
      const V q = hn::Min(hn::Load(d, least + b), largest);
      hn::Store(hn::Div(hn::Set(d, kDepthScale), q), d, bounds_.far + b);
      all = hn::Min(all, q);
    }
    bounds_.all_far = kDepthScale / hn::GetLane(hn::MinOfLanes(d, all));
    const Vec3f w = rays_.frame().w, o = rays_.apex();
    depth_of_apex_ = static_cast<float>(Dot(ToDouble(w), ToDouble(o))) + rays_.node_margin();
  }

  const IndexedGeometry& scene_;
  Packet& packet_;
  WalkStats* stats_;
  Rays rays_;
  // Closest hits: for exact distances.
  struct Nothing {};
  using Ready = std::conditional_t<kAny, Nothing, ReadyTriangles>;
  Ready MakeReady() const {
    if constexpr (kAny) {
      return {};
    } else {
      return Ready(scene_.geometry, packet_.origin, packet_.want_barycentrics);
    }
  }
  [[no_unique_address]] Ready ready_;
  const VisitFetcher fetcher_;
  alignas(64) Set lit_;         // Any hit: of sets whose walks are over.
  ShaftSingles<Rays> singles_;  // Likewise: given up on.
  Leaf* leaf_ = nullptr;
  const CancelToken* cancel_ = nullptr;
  int ray_count_ = 0, splits_ = 0;  // Of the whole packet: rays that are asked about, and splits.
  uint64_t visited_ = 0;  // By all sets of rays: parts of a packet alone are too short to poll.
  typename Rays::Bounds bounds_;  // Of the set being walked.
  float depth_of_apex_ = 0;       // w·O, with the margin of a node's depth.
  bool found_ = false;            // A hit in the leaf being visited.
  // Closest hits: bounds of 1/t of the nearest triangle so far; -inf before there is one.
  alignas(64) float best_lo_[RayPacket::kMaxRays], best_hi_[RayPacket::kMaxRays];
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
