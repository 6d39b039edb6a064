// SPDX-License-Identifier: Apache-2.0
//
// One ray at a time through the kd-tree, nearer cells first; sixteen triangles of a leaf at once.
//
// Which cells are entered, and what may be left out behind a hit, is core/accel/kd_tree.h's "what
// walks may rely on": cells' intervals are slab intervals, and the margins are those of boxes.
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_KD_SINGLE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_KD_SINGLE_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_KD_SINGLE_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_KD_SINGLE_INL_H_
#endif

#include <cmath>
#include <limits>
#include <span>

#include "core/accel/kd_tree.h"
#include "core/geometry/box_ray.h"
#include "core/traverse/leaf_range.h"
#include "core/traverse/single-inl.h"
#include "core/traverse/trace_ray.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

// Whether a cell or box with this interval may hold a hit (core/geometry/box_ray.h, 2).
HWY_INLINE bool MayHoldHit(float entry, float exit) {
  return (entry > 0 ? entry : 0.0f) <= exit * kBoxExitScale + kBoxExitShift;
}

template <bool kAny>
class KdSingleWalk {
 public:
  // All are kept by reference.
  HWY_INLINE KdSingleWalk(const IndexedGeometry& scene, const TraceRay& query, WalkStats* stats,
                          RayPoll* poll)
      : scene_(scene), tree_(*scene.kd_tree), query_(query), stats_(stats), poll_(poll) {}

  // Left off, and of no use, where the poll has fired.
  HWY_INLINE Hit Run() {
    if (tree_.empty()) return best_;
    const PredicateRay& ray = query_.ray;
    box_ray_ = BoxRay::Make(ray.origin, ray.RoundedDirection());
    limit_ = ray.segment ? kSegmentEnd : std::numeric_limits<float>::infinity();
    Pending at = {0, BoxEntry(box_ray_, tree_.bounds), BoxExit(box_ray_, tree_.bounds)};
    if (!MayHoldHit(at.entry, at.exit) || at.entry > limit_) return best_;
    Pending stack[kKdStackSize];
    int depth = 0;
    while (true) {
      const KdNode node = tree_.nodes[at.node];
      if (!node.is_leaf()) {
        ++stats_->nodes;
        if (Enter(node, &at, stack, &depth)) continue;
      } else if (!node.is_empty_leaf() && VisitLeaf(tree_.leaves[node.leaf()])) {
        return best_;
      }
      // Between two of these lie no more steps than the tree is deep.
      if (poll_->Stops()) return best_;
      do {
        if (depth == 0) return best_;
        at = stack[--depth];
      } while (IsBehind(at));
    }
  }

 private:
  struct Pending {  // Trivial: the stack is not initialized.
    uint32_t node;
    float entry, exit;
  };

  // Whether nothing in the cell can be closer than what was found.
  HWY_INLINE bool IsBehind(const Pending& at) const {
    if constexpr (!kAny) {
      if (tree_.perfect()) return BoxEntry(box_ray_, tree_.reach[at.node]) > limit_;
    }
    return at.entry > limit_;
  }

  // Goes to the nearer child that may hold a hit, and leaves the other one on the stack if it may,
  // too. False: neither may.
  HWY_INLINE bool Enter(KdNode node, Pending* at, Pending* stack, int* depth) const {
    const int axis = node.axis();
    const float inv = box_ray_.inv[axis];
    const float t = (node.split() - box_ray_.origin[axis]) * inv;
    const uint32_t lower_is_far = std::signbit(inv);
    // NaN (core/geometry/box_ray.h, 3 and 4) is passed over: both children have the whole interval.
    const Pending near = {node.first_child() + lower_is_far, at->entry,
                          t < at->exit ? t : at->exit};
    const Pending far = {node.first_child() + 1 - lower_is_far, t > at->entry ? t : at->entry,
                         at->exit};
    const bool near_met = MayHoldHit(near.entry, near.exit);
    const bool far_met = MayHoldHit(far.entry, far.exit) && !IsBehind(far);
    if (!near_met) {
      *at = far;
      return far_met;
    }
    if (far_met) stack[(*depth)++] = far;
    *at = near;
    return true;
  }

  // Returns true when any further hit is of no interest.
  HWY_INLINE bool VisitLeaf(const KdLeaf& kd_leaf) {
    const Box3f box = kd_leaf.box();
    const float entry = BoxEntry(box_ray_, box);
    if (!MayHoldHit(entry, BoxExit(box_ray_, box))) return false;
    if ((kAny || !tree_.perfect()) && entry > limit_) return false;
    ++stats_->leaves;
    const LeafRange range = LeafRange::Of(scene_, kd_leaf);
    for (uint32_t at = 0; at < range.count; at += kMaxLeafTriangles) {
      if (at > 0 && poll_->Stops()) return true;
      const RangeView some(scene_.geometry, range, at);
      const LeafView& view = some.leaf;
      if (TestLeaf(view, query_, scene_.geometry, stats_, [&](uint32_t lane) HWY_ATTR {
            if constexpr (kAny) {
              best_ = {0.0f, view.id(lane)};
              return true;
            } else {
              KeepCloser(view, lane, query_, &best_);
              return false;
            }
          })) {
        return true;
      }
    }
    if (best_.t < limit_) limit_ = best_.t;
    return false;
  }

  const IndexedGeometry& scene_;
  const KdTree& tree_;
  const TraceRay& query_;
  WalkStats* const stats_;
  RayPoll* const poll_;
  BoxRay box_ray_;
  float limit_ = 0;  // What is entered after this holds no hit that counts.
  Hit best_;
};

template <bool kAny>
bool TraceKdSingle(const IndexedGeometry& scene, std::span<const TraceRay> rays,
                   std::span<Hit> hits, const CancelToken* cancel, WalkStats* stats) {
  RayPoll poll(cancel);
  for (size_t i = 0; i < rays.size(); ++i) {
    if (i % kPollInterval == 0 && cancel != nullptr && cancel->cancelled()) return false;
    hits[i] = KdSingleWalk<kAny>(scene, rays[i], stats, &poll).Run();
    if (poll.stopped()) return false;
  }
  return true;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
