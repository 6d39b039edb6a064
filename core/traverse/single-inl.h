// SPDX-License-Identifier: Apache-2.0
//
// One ray at a time: eight boxes of a node, and sixteen triangles of a leaf, at once. Also brute
// force, which is the same leaf test over every triangle of the geometry in turn, without a
// structure.

#if defined(SIGHTLINE_CORE_TRAVERSE_SINGLE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SINGLE_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SINGLE_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SINGLE_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <type_traits>

#include "core/accel/indexed_geometry.h"
#include "core/base/cancel.h"
#include "core/geometry/box_ray.h"
#include "core/intersect/predicate-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/trace_ray.h"
#include "hwy/cache_control.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// A walk polls its token once for so many rays, or brute-forced blocks of sixteen triangles: some
// 50 µs of work.
constexpr size_t kPollInterval = 64;
constexpr size_t kBrutePollInterval = 4096;

// One ray against the triangles of one leaf. Calls on_hit(lane) for each that blocks; on_hit
// returns true to stop. Returns whether it stopped.
template <class OnHit>
HWY_INLINE bool TestLeaf(const LeafView& leaf, const TraceRay& query, const SceneGeometry& geometry,
                         WalkStats* stats, const OnHit& on_hit) {
  const hn::CappedTag<float, kMaxLeafTriangles> d;
  using V = hn::Vec<decltype(d)>;
  const size_t lanes = hn::Lanes(d);
  const PredicateRay& ray = query.ray;
  const Vec3f direction = ray.RoundedDirection();
  const Vec3V<V> o = Broadcast(d, ray.origin.x, ray.origin.y, ray.origin.z);
  const Vec3V<V> dir = Broadcast(d, direction.x, direction.y, direction.z);
  const V dir_inf = hn::Set(d, MaxAbs(direction));
  const V underflow = hn::Set(d, kFloatUnderflow);
  const V zero = hn::Zero(d);
  stats->triangle_tests += leaf.count;

  for (size_t first = 0; first < leaf.count; first += lanes) {
    const OriginTriangles<V> t = PrepareTriangles(d, leaf.rows + first, leaf.stride, o);
    const V e0 = DotV(t.edge[0], dir), e1 = DotV(t.edge[1], dir), e2 = DotV(t.edge[2], dir);
    const V b0 = hn::MulAdd(t.edge_bound[0], dir_inf, underflow);
    const V b1 = hn::MulAdd(t.edge_bound[1], dir_inf, underflow);
    const V b2 = hn::MulAdd(t.edge_bound[2], dir_inf, underflow);
    // The sign of a sum of two floats is exact, so e - b > 0 says e > b.
    const V least = hn::Min(hn::Min(hn::Sub(e0, b0), hn::Sub(e1, b1)), hn::Sub(e2, b2));
    const V most = hn::Max(hn::Max(hn::Add(e0, b0), hn::Add(e1, b1)), hn::Add(e2, b2));
    const V least_top = hn::Min(hn::Min(hn::Add(e0, b0), hn::Add(e1, b1)), hn::Add(e2, b2));
    const V most_bottom = hn::Max(hn::Max(hn::Sub(e0, b0), hn::Sub(e1, b1)), hn::Sub(e2, b2));
    const auto all_positive = hn::Gt(least, zero);
    const auto all_negative = hn::Lt(most, zero);
    const auto any_negative = hn::Lt(least_top, zero);    // Some e + b < 0.
    const auto any_positive = hn::Gt(most_bottom, zero);  // Some e - b > 0.
    const auto behind =
        hn::Gt(t.origin_side, t.origin_bound);  // O behind: must leave toward the front.
    const auto front = hn::Lt(t.origin_side, hn::Neg(t.origin_bound));
    auto miss = hn::Or(hn::And(any_positive, any_negative),
                       hn::Or(hn::And(behind, any_negative), hn::And(front, any_positive)));
    auto hit = hn::Or(hn::And(all_positive, behind), hn::And(all_negative, front));
    uint32_t in_use = leaf.count - first >= lanes ? ~0u : (1u << (leaf.count - first)) - 1;
    in_use &= ~MaskBits(d, miss);
    in_use &= (lanes < 32) ? (1u << lanes) - 1 : ~0u;
    if (in_use == 0) continue;

    if (ray.segment) {
      const Vec3V<V> p = Broadcast(d, ray.target.x, ray.target.y, ray.target.z);
      const Vec3V<V> ap = SubV(p, t.a);
      const V side = DotV(t.normal, ap);
      const V bound = hn::MulAdd(t.normal_bound, NormInfV(ap), underflow);
      const auto p_front = hn::Gt(side, bound);
      const auto p_behind = hn::Lt(side, hn::Neg(bound));
      miss = hn::Or(hn::And(behind, p_behind), hn::And(front, p_front));
      hit = hn::And(hit, hn::Or(hn::And(behind, p_front), hn::And(front, p_behind)));
      in_use &= ~MaskBits(d, miss);
    }
    const uint32_t hits = MaskBits(d, hit);
    for (; in_use != 0; in_use &= in_use - 1) {
      const uint32_t bit = std::countr_zero(in_use);
      const uint32_t lane = static_cast<uint32_t>(first) + bit;
      const uint32_t id = leaf.id(lane);
      if (id == query.from_source || id == query.to_source) continue;
      const Vec3f a = leaf.corner(0, lane), b = leaf.corner(1, lane), c = leaf.corner(2, lane);
      if ((hits >> bit & 1) == 0) {
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
  }
  return false;
}

// Keeps the least hit by (t, id).
HWY_INLINE void KeepCloser(const LeafView& leaf, uint32_t lane, const PredicateRay& ray,
                           Hit* best) {
  const Hit hit{HitDistance(ray, leaf.corner(0, lane), leaf.corner(1, lane), leaf.corner(2, lane)),
                leaf.id(lane)};
  if (hit < *best) *best = hit;
}

// What is visited next is fetched while the present node or leaf is worked on.
HWY_INLINE void PrefetchChild(const Bvh& bvh, ChildRef ref) {
  constexpr size_t kLine = 64;
  const char* at;
  size_t bytes;
  if (ref.is_leaf()) {
    at = reinterpret_cast<const char*>(bvh.leaves.data() + size_t{ref.leaf_unit()} * kUnitFloats);
    bytes = ref.leaf_units() * kUnitFloats * sizeof(float);
  } else {
    at = reinterpret_cast<const char*>(&bvh.nodes[ref.node()]);
    bytes = sizeof(BvhNode);
  }
  for (size_t i = 0; i < bytes; i += kLine) hwy::Prefetch(at + i);
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

// Pushes the children `met`, in no particular order, without a branch. Writes kBvhWidth entries
// from `end` on; returns how many count.
template <class D, class M>
HWY_INLINE int PushChildren(D d, const BvhNode& node, M met, PendingAny* end) {
  const hn::RebindToUnsigned<D> du;
  static_assert(sizeof(PendingAny) == sizeof(uint32_t) && sizeof(ChildRef) == sizeof(uint32_t));
  const auto used = hn::RebindMask(du, hn::And(met, hn::FirstN(d, node.child_count)));
  const auto children = hn::Load(du, reinterpret_cast<const uint32_t*>(node.child));
  // Compressed in a register: a compressing store is microcode.
  hn::StoreU(hn::Compress(children, used), du, reinterpret_cast<uint32_t*>(end));
  return static_cast<int>(hn::CountTrue(du, used));
}

// Pushes the children `met` (bit i for child i) so that the nearest is on top: insertion from the
// far end, since few are met. Returns the new depth.
HWY_INLINE int PushNearestOnTop(const BvhNode& node, uint32_t met, const float* entries,
                                PendingClosest* stack, int depth) {
  const int base = depth;
  for (uint32_t bits = met & ((1u << node.child_count) - 1); bits != 0; bits &= bits - 1) {
    const int i = std::countr_zero(bits);
    int at = depth++;
    while (at > base && stack[at - 1].entry < entries[i]) {
      stack[at] = stack[at - 1];
      --at;
    }
    stack[at] = {entries[i], node.child[i].bits()};
  }
  return depth;
}

// A depth-first walk, for closest hits nearer children first. With kAny it stops at the first
// blocker.
template <bool kAny>
HWY_INLINE Hit WalkSingle(const IndexedGeometry& scene, const TraceRay& query, WalkStats* stats) {
  const hn::CappedTag<float, kBvhWidth> d;
  static_assert(hn::MaxLanes(d) == kBvhWidth, "a node's eight boxes fill one vector");
  using V = hn::Vec<decltype(d)>;
  const Bvh& bvh = scene.bvh;
  Hit best;
  if (bvh.empty()) return best;
  const PredicateRay& ray = query.ray;
  const BoxRay box_ray = BoxRay::Make(ray.origin, ray.RoundedDirection());
  const V ox = hn::Set(d, ray.origin.x), oy = hn::Set(d, ray.origin.y),
          oz = hn::Set(d, ray.origin.z);
  const V ix = hn::Set(d, box_ray.inv.x), iy = hn::Set(d, box_ray.inv.y),
          iz = hn::Set(d, box_ray.inv.z);
  const int nx = std::signbit(box_ray.inv.x) ? 3 : 0, ny = std::signbit(box_ray.inv.y) ? 4 : 1,
            nz = std::signbit(box_ray.inv.z) ? 5 : 2;
  const int fx = 3 - nx, fy = 5 - ny, fz = 7 - nz;
  const V scale = hn::Set(d, kBoxExitScale), shift = hn::Set(d, kBoxExitShift);
  const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  // Nodes entered after this hold no hit that counts.
  float limit = ray.segment ? kSegmentEnd : std::numeric_limits<float>::infinity();

  std::conditional_t<kAny, PendingAny, PendingClosest> stack[kBvhStackSize + kBvhWidth];
  int depth = 0;
  if constexpr (kAny) {
    stack[depth++] = {ChildRef::Inner(0).bits()};
  } else {
    stack[depth++] = {0.0f, ChildRef::Inner(0).bits()};
  }
  while (depth > 0) {
    const auto pending = stack[--depth];
    if (pending.after(limit)) continue;
    if (depth > 0) PrefetchChild(bvh, stack[depth - 1].ref());
    if (pending.ref().is_leaf()) {
      ++stats->leaves;
      const LeafView leaf(bvh, pending.ref());
      const bool stopped =
          TestLeaf(leaf, query, scene.geometry, stats, [&](uint32_t lane) HWY_ATTR {
            if constexpr (kAny) {
              best = {0.0f, leaf.id(lane)};
              return true;
            } else {
              KeepCloser(leaf, lane, ray, &best);
              return false;
            }
          });
      if (stopped) return best;
      if (best.t < limit) limit = best.t;
      continue;
    }
    ++stats->nodes;
    const BvhNode& node = bvh.nodes[pending.ref().node()];
    // The running value stays second: a NaN (see core/geometry/box_ray.h) is passed over.
    V entry = hn::Neg(infinity), exit = infinity;
    entry = hn::Max(hn::Mul(hn::Sub(hn::Load(d, node.bounds[nx]), ox), ix), entry);
    entry = hn::Max(hn::Mul(hn::Sub(hn::Load(d, node.bounds[ny]), oy), iy), entry);
    entry = hn::Max(hn::Mul(hn::Sub(hn::Load(d, node.bounds[nz]), oz), iz), entry);
    exit = hn::Min(hn::Mul(hn::Sub(hn::Load(d, node.bounds[fx]), ox), ix), exit);
    exit = hn::Min(hn::Mul(hn::Sub(hn::Load(d, node.bounds[fy]), oy), iy), exit);
    exit = hn::Min(hn::Mul(hn::Sub(hn::Load(d, node.bounds[fz]), oz), iz), exit);
    const auto met = hn::And(hn::Le(hn::Max(entry, hn::Zero(d)), hn::MulAdd(exit, scale, shift)),
                             hn::Le(entry, hn::Set(d, limit)));
    if constexpr (kAny) depth += PushChildren(d, node, met, stack + depth);
    if constexpr (!kAny) {
      HWY_ALIGN float entries[kBvhWidth];
      hn::Store(entry, d, entries);
      depth = PushNearestOnTop(node, MaskBits(d, met), entries, stack, depth);
    }
  }
  return best;
}

template <bool kAny>
bool TraceSingle(const IndexedGeometry& scene, std::span<const TraceRay> rays, std::span<Hit> hits,
                 const CancelToken* cancel, WalkStats* stats) {
  for (size_t i = 0; i < rays.size(); ++i) {
    if (i % kPollInterval == 0 && cancel != nullptr && cancel->cancelled()) return false;
    hits[i] = WalkSingle<kAny>(scene, rays[i], stats);
  }
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
          KeepCloser(leaf, lane, rays[i].ray, &hits[i]);
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
