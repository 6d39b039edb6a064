// SPDX-License-Identifier: Apache-2.0
//
// One ray at a time: eight boxes of a node, and sixteen triangles of a leaf, at once. Also brute
// force, which is the same leaf test over every triangle of the geometry in turn, without a
// structure.
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_SINGLE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SINGLE_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SINGLE_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SINGLE_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <new>
#include <span>
#include <type_traits>
#include <utility>

#include "core/accel/indexed_geometry.h"
#include "core/base/cancel.h"
#include "core/base/compress-inl.h"
#include "core/base/work_poll.h"
#include "core/intersect/box_ray-inl.h"
#include "core/intersect/ray_forms-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/trace_ray.h"
#include "core/traverse/visit_fetcher-inl.h"
#include "core/traverse/walk_starts-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// A walk looks at its token once for so many visits of a packet, or blocks of sixteen triangles
// that all its rays are put to; rays that take turns for so many turns of all. One that walks by
// itself does once for so many visits, or blocks, and so does brute force: some 50 µs of work, and
// half a millisecond where each of a packet's rays is put to each triangle.
constexpr size_t kPollInterval = 64;
constexpr size_t kBrutePollInterval = 4096;
using PacketPoll = WorkPoll<kPollInterval>;
using RayPoll = WorkPoll<kBrutePollInterval>;

// Triangles of a leaf, bit i for the i-th.
struct LeafLanes {
  uint32_t left = 0;  // Those that the float stage does not rule out.
  uint32_t hit = 0;   // Those that it is certain of.
};

// The predicate's float stage for one ray and the triangles of one leaf, without a branch that
// depends on what it finds.
HWY_INLINE LeafLanes ClassifyLeaf(const LeafView& leaf, const PredicateRay& ray) {
  const hn::CappedTag<float, kMaxLeafTriangles> d;
  using V = hn::Vec<decltype(d)>;
  constexpr size_t kLanes = hn::MaxLanes(d);
  const auto lanes = RayLanes<V>::Of(d, ray);
  const auto beyond = [](V x, V bound) HWY_ATTR { return hn::Gt(x, bound); };
  LeafLanes found;
  for (size_t first = 0; first < (kLanes == kMaxLeafTriangles ? 1 : leaf.count); first += kLanes) {
    const RayForms<V> forms = EvaluateForms(d, leaf.rows + first, leaf.stride, lanes, ray.segment);
    // All signs as seen with O behind, which must leave toward the front: a hit's are positive.
    const V turn = hn::And(forms.origin_side, hn::Set(d, -0.0f));
    const auto side_is_known = beyond(hn::Abs(forms.origin_side), forms.origin_bound);
    const V e0 = hn::Xor(forms.edge[0], turn), e1 = hn::Xor(forms.edge[1], turn),
            e2 = hn::Xor(forms.edge[2], turn);
    const V least = hn::Min(hn::Min(e0, e1), e2), most = hn::Max(hn::Max(e0, e1), e2);
    // Edges of either sign are a miss whatever the side.
    auto miss = hn::And(beyond(hn::Neg(least), forms.edge_bound),
                        hn::Or(side_is_known, beyond(most, forms.edge_bound)));
    auto hit = hn::And(side_is_known, beyond(least, forms.edge_bound));
    if (ray.segment) {
      const V target_side = hn::Xor(forms.target_side, turn);
      miss = hn::Or(miss, hn::And(side_is_known, beyond(hn::Neg(target_side), forms.target_bound)));
      hit = hn::And(hit, beyond(target_side, forms.target_bound));
    }
    found.left |= (MaskBits(d, miss) ^ ((1u << kLanes) - 1)) << first;
    found.hit |= MaskBits(d, hit) << first;
  }
  found.left &= (1u << leaf.count) - 1;
  return found;
}

// Decides what the float stage has left. Calls on_hit(lane) for each triangle that blocks; on_hit
// returns true to stop. Returns whether it stopped.
template <class OnHit>
HWY_INLINE bool SettleLeaf(const LeafView& leaf, LeafLanes found, const TraceRay& query,
                           const SceneGeometry& geometry, WalkStats* stats, const OnHit& on_hit) {
  const PredicateRay& ray = query.ray;
  for (uint32_t left = found.left; left != 0; left &= left - 1) {
    const uint32_t lane = std::countr_zero(left);
    const uint32_t id = leaf.id(lane);
    if (id == query.from_source || id == query.to_source || query.unseen.Holds(id)) continue;
    const Vec3f a = leaf.corner(0, lane), b = leaf.corner(1, lane), c = leaf.corner(2, lane);
    if ((found.hit >> lane & 1) == 0) {
      PredicateStage stage;
      const bool blocks = Blocks(ray, a, b, c, &stage);
      ++stats->doubt_double;
      stats->doubt_exact += stage == PredicateStage::kExact;
      if (!blocks) continue;
    }
    if (MustAskObjects(geometry, query.mask) &&
        !ObjectBlocks(geometry, id, query.mask, SideOfPlane(a, b, c, ray.origin))) {
      continue;
    }
    if (on_hit(lane)) return true;
  }
  return false;
}

// One ray against the triangles of one leaf: both of the above.
template <class OnHit>
HWY_INLINE bool TestLeaf(const LeafView& leaf, const TraceRay& query, const SceneGeometry& geometry,
                         WalkStats* stats, const OnHit& on_hit) {
  stats->triangle_tests += leaf.count;
  return SettleLeaf(leaf, ClassifyLeaf(leaf, query.ray), query, geometry, stats, on_hit);
}

// Keeps the least hit by (t, id) that counts.
HWY_INLINE void KeepCloser(const LeafView& leaf, uint32_t lane, const TraceRay& query, Hit* best) {
  const Hit hit{
      HitDistance(query.ray, leaf.corner(0, lane), leaf.corner(1, lane), leaf.corner(2, lane)),
      leaf.id(lane)};
  if (hit < *best && hit.t > query.near) *best = hit;
}

// A child to visit; for closest hits with its entry, so that those behind a hit are passed over.
// Trivial: a walk's stack is not initialized.
struct PendingAny {
  uint32_t ref_bits;

  ChildRef ref() const { return ChildRef::FromBits(ref_bits); }
  bool after(float) const { return false; }
};
struct PendingClosest {
  float entry;
  uint32_t ref_bits;

  ChildRef ref() const { return ChildRef::FromBits(ref_bits); }
  bool after(float limit) const { return entry > limit; }
};

// A node's children, as the bits of their references, and those of `met` that there are.
template <class D>
HWY_INLINE hn::Vec<D> ChildBits(D d, const BvhNode& node) {
  static_assert(sizeof(ChildRef) == sizeof(uint32_t));
  return hn::Load(d, reinterpret_cast<const uint32_t*>(node.child));
}
template <class D, class M>
HWY_INLINE hn::Mask<D> UsedOf(D d, const BvhNode& node, M met) {
  return hn::And(hn::RebindMask(d, met),
                 hn::Ne(ChildBits(d, node), hn::Set(d, ChildRef::Empty().bits())));
}

// Pushes the children `met`, in no particular order, without a branch. Writes kBvhWidth entries
// from `end` on; returns how many count.
template <class D, class M>
HWY_INLINE int PushChildren(D /*d*/, const BvhNode& node, M met, PendingAny* end) {
  const hn::RebindToUnsigned<D> du;
  static_assert(sizeof(PendingAny) == sizeof(uint32_t));
  const auto used = UsedOf(du, node, met);
  // Compressed in a register: a compressing store is microcode.
  hn::StoreU(CompressLanes(du, ChildBits(du, node), used), du, reinterpret_cast<uint32_t*>(end));
  return static_cast<int>(hn::CountTrue(du, used));
}

// Sorts eight numbers, the greatest first, without a branch: Batcher's bitonic network.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V SortDescending(D d, V v) {
  static_assert(hn::MaxLanes(d) == kBvhWidth, "a node's eight children fill one vector");
  HWY_ALIGN static constexpr uint32_t kOther[2][kBvhWidth] = {{0, 0, ~0u, ~0u, 0, 0, ~0u, ~0u},
                                                              {0, 0, 0, 0, ~0u, ~0u, ~0u, ~0u}};
  const auto odd_pairs = hn::MaskFromVec(hn::Load(d, kOther[0]));
  const auto upper_half = hn::MaskFromVec(hn::Load(d, kOther[1]));
  const auto pairs = [&]() HWY_ATTR {
    const V other = hn::Shuffle2301(v);
    v = hn::OddEven(hn::Min(v, other), hn::Max(v, other));
  };
  const auto exchange = [&](V other, auto takes_less) HWY_ATTR {
    v = hn::IfThenElse(takes_less, hn::Min(v, other), hn::Max(v, other));
  };
  pairs();
  exchange(hn::Shuffle0123(v), odd_pairs);
  pairs();
  exchange(hn::Reverse(d, v), upper_half);
  exchange(hn::Shuffle1032(v), odd_pairs);
  pairs();
  return v;
}

// Pushes the children `met` (bit i for child i) so that the nearest is on top, without a branch:
// how many are met, and which comes first, cannot be foretold. Entries below zero are as near as
// zero. Writes kBvhWidth entries from stack[depth] on; returns the new depth.
HWY_INLINE int PushNearestOnTop(const BvhNode& node, uint32_t met, const float* entries,
                                PendingClosest* stack, int depth) {
  const hn::CappedTag<float, kBvhWidth> d;
  const hn::RebindToUnsigned<decltype(d)> du;
  const auto bits = static_cast<uint8_t>(met & ((1u << node.child_count) - 1));
  const auto entry = hn::Load(d, entries);
  // Positive floats are ordered as their bits are. The last three make way for the child's number:
  // which of two boxes is entered a trifle earlier does not matter. Those not met come last.
  constexpr uint32_t kNumber = kBvhWidth - 1;
  const auto nearness = hn::BitCast(du, hn::Max(entry, hn::Zero(d)));
  const auto keys = hn::IfThenElseZero(
      hn::LoadMaskBits(du, &bits),
      hn::Or(hn::AndNot(hn::Set(du, kNumber), hn::Add(nearness, hn::Set(du, kBvhWidth))),
             hn::Iota(du, 0)));
  const auto order =
      hn::IndicesFromVec(du, hn::And(SortDescending(du, keys), hn::Set(du, kNumber)));
  const auto sorted = hn::TableLookupLanes(hn::BitCast(du, entry), order);
  const auto children =
      hn::TableLookupLanes(hn::Load(du, reinterpret_cast<const uint32_t*>(node.child)), order);
  static_assert(sizeof(PendingClosest) == 2 * sizeof(uint32_t) &&
                offsetof(PendingClosest, entry) == 0 && sizeof(ChildRef) == sizeof(uint32_t));
  const auto lower = hn::InterleaveLower(du, sorted, children);
  const auto upper = hn::InterleaveUpper(du, sorted, children);
  auto* const to = reinterpret_cast<uint32_t*>(stack + depth);
  hn::StoreU(hn::ConcatLowerLower(du, upper, lower), du, to);
  hn::StoreU(hn::ConcatUpperUpper(du, upper, lower), du, to + kBvhWidth);
  return depth + std::popcount(bits);
}

// A depth-first walk, for closest hits nearer children first. With kAny it stops at the first
// blocker. It goes a visit at a time, so that several can take turns: what one will visit next is
// fetched while the others work.
template <bool kAny>
class alignas(kCacheLine) SingleWalk {
 public:
  // Children of a node, bit by bit: those that there are, or for closest hits perhaps some that
  // there are not, and where each is entered.
  struct MetAny {
    uint32_t children;
  };
  struct MetClosest {
    alignas(sizeof(float) * kBvhWidth) float entries[kBvhWidth];
    uint32_t children;
  };
  using MetChildren = std::conditional_t<kAny, MetAny, MetClosest>;

  // Begins the next of `starts`. The scene and the query are kept by reference until the walk has
  // ended. Returns what FindNext would. REQUIRES: something to hit.
  HWY_INLINE ChildRef Start(const IndexedGeometry& scene, WalkStarts<kAny>* starts) {
    scene_ = &scene;
    query_ = &starts->Take(&ray_);
    best_ = Hit();
    depth_ = 0;
    // Below everything: where a walk comes to its end without having to ask.
    if constexpr (kAny) {
      stack_[depth_++] = {ChildRef::Empty().bits()};
    } else {
      stack_[depth_++] = {-std::numeric_limits<float>::infinity(), ChildRef::Empty().bits()};
    }
    if constexpr (kAny) {
      ++depth_;  // The root's place, which is not read: its first step has been taken.
      return EnterNode(scene.bvh.nodes[0], {ray_.root});
    } else {
      stack_[depth_++] = {0.0f, ChildRef::Inner(0).bits()};
      return next();
    }
  }

  // The child to visit, those behind the limit passed over, or none at the end.
  HWY_INLINE ChildRef FindNext() {
    while (stack_[depth_ - 1].after(ray_.limit)) --depth_;
    return next();
  }
  // The same once more.
  HWY_INLINE ChildRef next() const { return stack_[depth_ - 1].ref(); }

  // What is next is visited in two steps, with nothing between them: several walks take the first
  // by turns, then the second. A step has fewer operations that wait for one another than a whole
  // visit, so that a core, which looks a few hundred instructions ahead, works on more walks at
  // once.
  //
  // A node's first step finds out which of its children the ray meets.
  HWY_INLINE void TestNode(const BvhNode& node, MetChildren* met) const {
    const hn::CappedTag<float, kBvhWidth> d;
    static_assert(hn::MaxLanes(d) == kBvhWidth, "a node's eight boxes fill one vector");
    using V = hn::Vec<decltype(d)>;
    const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    static_assert(offsetof(BvhNode, bounds) == 0);
    const auto faces = [&](uint32_t offset) HWY_ATTR {
      return hn::Load(
          d, reinterpret_cast<const float*>(reinterpret_cast<const char*>(&node) + offset));
    };
    V entry = hn::Neg(infinity), exit = infinity;
    for (int k = 0; k < 3; ++k) {
      // Both factors turned, so that faces are taken away as they lie in memory. The running value
      // stays second: a NaN (see core/geometry/box_ray.h) is passed over.
      const V o = hn::Set(d, ray_.origin[k]), inv = hn::Set(d, ray_.minus_inv[k]);
      entry = hn::Max(hn::Mul(hn::Sub(o, faces(ray_.near[k])), inv), entry);
      exit = hn::Min(hn::Mul(hn::Sub(o, faces(ray_.far[k])), inv), exit);
    }
    const V last = ExitWithMargin(d, exit);
    const V limit = hn::Set(d, ray_.limit), from_origin = hn::Max(entry, hn::Zero(d));
    if constexpr (kAny) {
      // The limit is positive: an entry below zero may count as zero for both.
      const hn::RebindToUnsigned<decltype(d)> du;
      met->children = MaskBits(du, UsedOf(du, node, hn::Le(from_origin, hn::Min(last, limit))));
    } else {
      met->children = MaskBits(d, hn::And(hn::Le(from_origin, last), hn::Le(entry, limit)));
      hn::Store(entry, d, met->entries);
    }
  }
  // In the second they take the node's place. Returns what FindNext would. REQUIRES: `node` is
  // next, and `met` is what TestNode said of it.
  HWY_INLINE ChildRef EnterNode(const BvhNode& node, const MetChildren& met) {
    if constexpr (kAny) {
      const hn::CappedTag<uint32_t, kBvhWidth> d;
      const uint32_t children = met.children;
      const int depth = depth_;
      const uint32_t below = stack_[depth - 2].ref_bits;
      hn::StoreU(CompressLanesByBits(d, ChildBits(d, node), children), d,
                 reinterpret_cast<uint32_t*>(stack_ + depth - 1));
      depth_ = depth + std::popcount(children) - 1;
      // Not read back: what was stored as a part of a vector comes late. Chosen by arithmetic, lest
      // a compiler makes a branch of it; less than one is none, since there are eight bits.
      const uint32_t top = node.child[31 - std::countl_zero(children | 1)].bits();
      const uint32_t if_none = 0u - ((children - 1) >> 31);
      return ChildRef::FromBits((top & ~if_none) | (below & if_none));
    } else {
      depth_ = PushNearestOnTop(node, met.children, met.entries, stack_, depth_ - 1);
      return FindNext();
    }
  }
  // A leaf's first step has no branch to be foretold. Those that have something left take a second.
  HWY_INLINE LeafLanes VisitLeaf(WalkStats* stats) {
    const LeafView leaf(*scene_, stack_[--depth_].ref());
    stats->triangle_tests += leaf.count;
    return ClassifyLeaf(leaf, query_->ray);
  }
  HWY_INLINE void Settle(LeafLanes found, WalkStats* stats) {
    const LeafView leaf(*scene_, stack_[depth_].ref());  // The one just visited.
    if constexpr (kAny) {
      // One triangle that certainly blocks is enough: nothing is asked about those in doubt.
      const uint32_t certain = found.hit & found.left;
      const uint32_t id = leaf.id(std::countr_zero(certain) % kMaxLeafTriangles);
      if (certain != 0 && id != query_->from_source && id != query_->to_source &&
          !query_->unseen.Holds(id) && !MustAskObjects(scene_->geometry, query_->mask)) [[likely]] {
        best_ = {0.0f, id};
        depth_ = 1;
        return;
      }
    }
    const bool stopped =
        SettleLeaf(leaf, found, *query_, scene_->geometry, stats, [&](uint32_t lane) HWY_ATTR {
          if constexpr (kAny) {
            best_ = {0.0f, leaf.id(lane)};
            return true;
          } else {
            KeepCloser(leaf, lane, *query_, &best_);
            return false;
          }
        });
    if (best_.t < ray_.limit) ray_.limit = best_.t;
    if (stopped) depth_ = 1;  // Any further hit is of no interest.
  }

  const TraceRay& query() const { return *query_; }
  const Hit& best() const { return best_; }

 private:
  using Pending = std::conditional_t<kAny, PendingAny, PendingClosest>;

  RayTerms ray_;
  const IndexedGeometry* scene_ = nullptr;
  const TraceRay* query_ = nullptr;
  Hit best_;
  int depth_ = 0;
  Pending stack_[1 + kBvhStackSize + kBvhWidth];
};

// Walks that take turns. More than the memory system serves at a time bring nothing, and cost the
// nearer caches their stacks.
constexpr int kTurns = 32;

// How many walks do what next, all in one number, which stays in a register: what is counted by its
// kind in memory waits for the walk before, whose kind is known late.
class VisitCounts {
 public:
  uint32_t of(NextVisit visit) const { return bits_ >> (kBits * visit) & ((1u << kBits) - 1); }
  void Add(NextVisit visit) { bits_ += uint64_t{1} << (kBits * visit); }
  bool any() const { return bits_ != 0; }

 private:
  static constexpr uint32_t kBits = 16;
  static_assert(kTurns < 1 << kBits);
  uint64_t bits_ = 0;
};

// Rays in rounds: first all that visit a node, then all that visit a leaf. Whether a ray does one
// or the other cannot be foretold; a branch on it would cost as much as the visit.
template <bool kAny>
bool TraceSingle(const IndexedGeometry& scene, std::span<const TraceRay> rays, std::span<Hit> hits,
                 const CancelToken* cancel, WalkStats* stats) {
  using Walk = SingleWalk<kAny>;
  struct Turn {
    Walk* walk;
    const char* at;  // Where the node or the leaf lies that it visits.

    const BvhNode& node() const { return *reinterpret_cast<const BvhNode*>(at); }
  };
  struct Round {
    VisitCounts counts;
    Turn turns[3][kTurns];  // By what is next.
    std::span<const Turn> next(NextVisit visit) const { return {turns[visit], counts.of(visit)}; }
  };
  // Begins to live when its first ray does: a call may be about a few.
  union Place {
    Place() {}  // NOLINT(modernize-use-equals-default): defaulted, it would be deleted.
    Walk walk;
  };
  Place places[kTurns];
  Round rounds[2];
  typename Walk::MetChildren met[kTurns];  // Of those at a node.
  LeafLanes found[kTurns];                 // In leaves, of the walks in found_by.
  Walk* found_by[kTurns];
  Round* now = &rounds[0];
  Round* then = &rounds[1];
  if (cancel != nullptr && cancel->cancelled()) return false;
  PacketPoll poll(cancel);
  if (scene.bvh.empty()) {
    std::fill_n(hits.begin(), rays.size(), Hit());
    return true;
  }
  WalkStarts<kAny> starts(scene.bvh.nodes[0], rays);
  const VisitFetcher fetcher(scene.bvh);
  VisitCounts filed;  // In the next round.
  const auto file = [&](Walk* walk, ChildRef ref) HWY_ATTR {
    static_assert(kVisitNode == 0 && kVisitLeaf == 1 && kVisitEnd == 2);
    const auto next = static_cast<NextVisit>((ref.bits() >> 31) + (ref.is_empty() ? 1u : 0u));
    then->turns[next][filed.of(next)] = {walk, fetcher.Fetch(next, ref)};
    filed.Add(next);
  };
  const auto start = [&](Walk* walk) HWY_ATTR { file(walk, walk->Start(scene, &starts)); };
  static_assert(std::is_trivially_destructible_v<Walk>);
  for (int i = 0; i < kTurns && starts.any_left(); ++i) {
    // Not std::construct_at, which would set every walk's stack to zero.
    start(::new (static_cast<void*>(&places[i].walk)) Walk);
  }
  while (filed.any()) {
    // By turns, not by rays: how many one takes has no bound where triangles lie on each other.
    if (poll.Stops()) return false;
    std::swap(now, then);
    now->counts = std::exchange(filed, {});
    const auto in_nodes = now->next(kVisitNode), in_leaves = now->next(kVisitLeaf);
    stats->nodes += in_nodes.size();
    stats->leaves += in_leaves.size();
    if (fetcher.leaves_are_far()) {
      for (const Turn& turn : in_leaves) fetcher.FetchRest(turn.walk->next());
    }
    for (size_t i = 0; i < in_nodes.size(); ++i) {
      in_nodes[i].walk->TestNode(in_nodes[i].node(), &met[i]);
    }
    for (size_t i = 0; i < in_nodes.size(); ++i) {
      file(in_nodes[i].walk, in_nodes[i].walk->EnterNode(in_nodes[i].node(), met[i]));
    }
    uint32_t some_left = 0;
    for (const Turn& turn : in_leaves) {
      found[some_left] = turn.walk->VisitLeaf(stats);
      found_by[some_left] = turn.walk;
      some_left += found[some_left].left != 0 ? 1 : 0;
    }
    for (uint32_t i = 0; i < some_left; ++i) found_by[i]->Settle(found[i], stats);
    for (const Turn& turn : in_leaves) file(turn.walk, turn.walk->FindNext());
    for (const Turn& turn : now->next(kVisitEnd)) {
      hits[static_cast<size_t>(&turn.walk->query() - rays.data())] = turn.walk->best();
      if (starts.any_left()) start(turn.walk);
    }
  }
  if constexpr (kAny) stats->nodes += rays.size();  // The root, which WalkStarts visits.
  return true;
}

// Triangles are gathered into leaf form sixteen at a time and every ray of the span is put to them,
// so that the gathering is paid once.
template <bool kAny>
bool TraceBrute(const IndexedGeometry& scene, std::span<const TraceRay> rays, std::span<Hit> hits,
                const CancelToken* cancel, WalkStats* stats) {
  const SceneGeometry& geometry = scene.geometry;
  std::fill(hits.begin(), hits.begin() + rays.size(), Hit{});
  HWY_ALIGN float rows[kLeafRows * kMaxLeafTriangles + kLeafPadding] = {};
  const size_t triangle_count = geometry.triangles.size();
  size_t next_inert = 0;
  size_t since_poll = kBrutePollInterval;
  for (size_t first = 0; first < triangle_count;) {
    uint32_t count = 0;
    for (; first < triangle_count && count < kMaxLeafTriangles; ++first) {
      const uint32_t id = static_cast<uint32_t>(first);
      if (next_inert < geometry.inert.size() && geometry.inert[next_inert] == id) {
        ++next_inert;
        continue;
      }
      const auto corners = geometry.Corners(id);
      for (int corner = 0; corner < 3; ++corner) {
        for (int axis = 0; axis < 3; ++axis) {
          rows[(3 * corner + axis) * kMaxLeafTriangles + count] = corners[corner][axis];
        }
      }
      rows[9 * kMaxLeafTriangles + count] = std::bit_cast<float>(id);
      ++count;
    }
    const LeafView leaf(rows, kMaxLeafTriangles, count);
    for (size_t i = 0; i < rays.size(); ++i) {
      if (since_poll++ >= kBrutePollInterval) {
        since_poll = 0;
        if (cancel != nullptr && cancel->cancelled()) return false;
      }
      if (kAny && hits[i].triangle != kNoTriangle) continue;
      TestLeaf(leaf, rays[i], geometry, stats, [&](uint32_t lane) HWY_ATTR {
        if constexpr (kAny) {
          hits[i] = {0.0f, leaf.id(lane)};
          return true;
        } else {
          KeepCloser(leaf, lane, rays[i], &hits[i]);
          return false;
        }
      });
    }
  }
  return true;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
