// SPDX-License-Identifier: Apache-2.0
//
// A patch of triangles that blocks every ray of a set, told from the box around the set's points
// alone: what stands before all points may be as finely divided as a statue is, as long as the
// surface goes on without an edge, an outline or a fold that some ray could pass. Found from one
// leaf, by mates (core/accel/leaf_mates.h): no tree is walked.
//
// Why it holds. Let M, the patch, be a set of triangles such that, certainly,
//  (1) each one's plane stands between the origin and all of the box;
//  (2) for each edge of each, all of the box is on the triangle's side of it, or its mate is in M,
//      too, and lies on its other side, as the origin sees them;
//  (3) some point of the box is within all three edges of one of them.
// Of a point of the box, count the triangles of M within whose edges it is. Moving the point within
// the box changes that number only where it crosses an edge's plane through the origin, beside the
// edge itself; by (2) it enters the one as it leaves the other there. So but for points on edges,
// which lie thinly, the number is the same for all of the box, and by (3) it is not 0. A point on
// edges is the limit of points that are not: one triangle holds infinitely many of them, hence the
// limit, edges included, and blocks it by (1), since the predicate counts edges as within
// (core/intersect/predicate.h: watertight). That M is all that the origin sees there is not asked:
// triangles may be left out of it, or stand before and behind each other. Along a direction it is
// the same with rays from the box that end nowhere.
//
// What is certain is told as in leaf_cover-inl.h, by the float stage's forms at the box's corners,
// for all triangles of a leaf at once. Points that lie on a level wall, which stands between them
// and the origin, are too near its plane for that: (1) is asked of each of them there.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_PATCH_COVER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_PATCH_COVER_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_PATCH_COVER_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_PATCH_COVER_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/accel/indexed_geometry.h"
#include "core/base/check.h"
#include "core/geometry/box3.h"
#include "core/traverse/leaf_cover-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/patch_leaf-inl.h"
#include "core/traverse/plane_side-inl.h"
#include "core/traverse/shaft_lanes-inl.h"
#include "core/traverse/trace_ray.h"
#include "hwy/cache_control.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <bool kParallel>
class PatchFinder {
 public:
  // All but the box is kept by reference. REQUIRES: the scene has mates; every point is in the box.
  PatchFinder(const IndexedGeometry& scene, Vec3f common, const Box3f& box,
              std::span<const Vec3f> points)
      : scene_(scene),
        mates_(scene.bvh.mates),
        common_(common),
        box_(box),
        middle_((box.lo + box.hi) * 0.5f),
        points_(points) {}

  // How many triangles the patch has, or 0 where none is found from these leaves, or kNoLeaf.
  uint32_t Find(std::span<const uint32_t> seeds) {
    bool before_middle = false;
    for (const uint32_t seed : seeds) {
      if (seed == RayPacket::kNoLeaf) continue;
      SIGHTLINE_DCHECK(scene_.bvh.HoldsLeaf(ChildRef::FromBits(seed))) << "leaf " << seed;
      PatchLeaf* const leaf = Open(ChildRef::FromBits(seed));
      if (leaf == nullptr) return 0;
      // Several may stand behind each other.
      for (uint32_t left = leaf->middle; left != 0; left &= ~leaf->members) {
        before_middle = true;
        if (const uint32_t count = Spread(leaf, std::countr_zero(left)); count > 0) return count;
      }
    }
    return before_middle || leaves_ == 0 ? 0 : FindFrom(&leaf_[0]);
  }

  // After a patch was found: the leaf that it began with.
  ChildRef first() const { return first_; }
  // How many leaves were looked at.
  size_t leaves() const { return leaves_; }

  // fn(id) for all of the patch; false once it is for one.
  template <class Fn>
  bool All(const Fn& fn) const {
    for (size_t i = 0; i < leaves_; ++i) {
      const LeafView view(scene_, leaf_[i].ref);
      for (uint32_t in = leaf_[i].members; in != 0; in &= in - 1) {
        if (!fn(view.id(std::countr_zero(in)))) return false;
      }
    }
    return true;
  }

 private:
  // Of one search: beyond these a walk costs as much.
  static constexpr size_t kMaxLeaves = 10;
  static constexpr int kMaxSteps = 24;
  static constexpr int kMaxLevel = 2;  // Triangles that all points are asked about.
  static constexpr uint32_t kNowhere = 0xFFFFFFFFu;

  // Null: there are too many.
  HWY_INLINE PatchLeaf* Open(ChildRef ref) {
    for (size_t i = 0; i < leaves_; ++i) {
      if (refs_[i] == ref) return &leaf_[i];
    }
    if (leaves_ == kMaxLeaves) return nullptr;
    refs_[leaves_] = ref;
    PatchLeaf* const leaf = &leaf_[leaves_++];
    AskPatchLeaf<kParallel>(scene_, ref, common_, box_, middle_, leaf);
    return leaf;
  }

  // From a leaf that has no triangle before the middle: over the edges that this lies beyond.
  uint32_t FindFrom(PatchLeaf* leaf) {
    uint32_t lane = leaf->Nearest(), came_from = kNowhere;
    for (int step = 0; (leaf->middle >> lane & 1) == 0; ++step) {
      const LeafMate mate = mates_.of(leaf->ref, leaf->FarthestEdge(lane))[lane];
      if (!mate.exists() || mate.place() == came_from || step == kMaxSteps) return 0;
      came_from = LeafMates::PlaceOf(leaf->ref, lane);
      leaf = Open(mates_.leaf(mate));
      if (leaf == nullptr) return 0;
      lane = leaf->middle != 0 ? static_cast<uint32_t>(std::countr_zero(leaf->middle))
                               : LeafMates::lane(leaf->ref, mate);
    }
    return Spread(leaf, lane);
  }

  // How many triangles the patch has that one before the middle belongs to, or 0.
  uint32_t Spread(PatchLeaf* leaf, uint32_t lane) {
    first_ = leaf->ref;
    for (size_t i = 0; i < leaves_; ++i) leaf_[i].members = leaf_[i].done = 0;
    leaf->members = 1u << lane;
    for (bool more = true; more;) {
      more = false;
      for (size_t i = 0; i < leaves_; ++i) {
        if (leaf_[i].members == leaf_[i].done) continue;
        if (!TakeMates(&leaf_[i])) return 0;
        more = true;
      }
    }
    uint32_t count = 0;
    for (size_t i = 0; i < leaves_; ++i) count += std::popcount(leaf_[i].members);
    return count;
  }

  // Takes all that the leaf's members lead to; false if one of them cannot be a member.
  HWY_INLINE bool TakeMates(PatchLeaf* leaf) {
    leaf->members = leaf->Closure();
    const uint32_t fresh = leaf->members & ~leaf->done;
    leaf->done = leaf->members;
    if ((fresh & (leaf->lone | ~leaf->certain)) != 0) return false;
    for (uint32_t near = fresh & ~leaf->beyond; near != 0; near &= near - 1) {
      if (!PlaneIsBetween(*leaf, std::countr_zero(near))) return false;
    }
    // Other leaves are all asked for before any is looked at.
    struct Way {
      uint32_t leaf, lane, turned;  // Of the mate, as it has to be.
    };
    Way ways[3 * kMaxLeafTriangles];
    size_t count = 0;
    for (int e = 0; e < 3; ++e) {
      const LeafMate* const row = mates_.of(leaf->ref, e);
      for (uint32_t out = fresh & leaf->out[e]; out != 0; out &= out - 1) {
        const uint32_t i = std::countr_zero(out);
        const ChildRef ref = mates_.leaf(row[i]);
        Fetch(ref);
        ways[count++] = {ref.bits(), LeafMates::lane(ref, row[i]),
                         (leaf->turned >> i & 1) ^ (row[i].same_way() ? 1u : 0u)};
      }
    }
    for (size_t k = 0; k < count; ++k) {
      PatchLeaf* const other = Open(ChildRef::FromBits(ways[k].leaf));
      if (other == nullptr || (other->turned >> ways[k].lane & 1) != ways[k].turned) return false;
      other->members |= 1u << ways[k].lane;
    }
    return true;
  }

  HWY_INLINE void Fetch(ChildRef ref) const {
    constexpr size_t kLine = 64 / sizeof(float);
    for (int e = 0; e < 3; ++e) hwy::Prefetch(mates_.of(ref, e));
    if (!scene_.bvh.has_leaf_rows()) return;
    const float* const rows = &scene_.bvh.leaves[size_t{ref.leaf_unit()} * kUnitFloats];
    for (size_t at = 0; at < size_t{ref.leaf_units()} * kUnitFloats; at += kLine) {
      hwy::Prefetch(rows + at);
    }
  }

  // Whether a triangle's plane is between the origin and all points, where floats did not tell: by
  // doubles, of the box or, if need be, of each point.
  HWY_NOINLINE bool PlaneIsBetween(const PatchLeaf& leaf, uint32_t lane) {
    const LeafView view(scene_, leaf.ref);
    const Vec3f a = view.corner(0, lane);
    const Vec3d v = ToDouble(view.corner(1, lane)) - ToDouble(a);
    const Vec3d w = ToDouble(view.corner(2, lane)) - ToDouble(view.corner(1, lane));
    // That of N·(P-A), or of its contrary along a direction.
    const float sign = ((leaf.turned >> lane & 1) != 0) != kParallel ? -1 : 1;
    if (BoxIsBeyond(v, w, sign, ToDouble(a))) return true;
    if (++level_ > kMaxLevel) return false;
    const ShaftD d;
    const auto beyond = [&](const float* from) HWY_ATTR {
      Vec3V<ShaftV> p;
      hn::LoadInterleaved3(d, from, p.x, p.y, p.z);
      return hn::AllTrue(d, hn::Gt(SideInDoubles(v, w, sign, &a, p), hn::Zero(d)));
    };
    static_assert(sizeof(Vec3f) == 3 * sizeof(float));
    constexpr size_t kLanes = hn::MaxLanes(ShaftD());
    size_t i = 0;
    for (; i + kLanes <= points_.size(); i += kLanes) {
      if (!beyond(&points_[i].x)) return false;
    }
    if (i == points_.size()) return true;
    Vec3f rest[kLanes];
    for (size_t k = 0; k < kLanes; ++k) rest[k] = points_[std::min(i + k, points_.size() - 1)];
    return beyond(&rest[0].x);
  }

  // sign·(v×w)·(P-a) > 0 for all P of the box; the bound is that of SideInDoubles.
  bool BoxIsBeyond(Vec3d v, Vec3d w, float sign, Vec3d a) const {
    const auto norm_1 = [](Vec3d x) { return std::abs(x.x) + std::abs(x.y) + std::abs(x.z); };
    const Vec3d form = Cross(v, w) * static_cast<double>(sign);
    const Vec3d lo = ToDouble(box_.lo) - a, hi = ToDouble(box_.hi) - a;
    double least = 0, farthest = 0;
    for (int k = 0; k < 3; ++k) {
      least += form[k] * (form[k] < 0 ? hi[k] : lo[k]);
      farthest = std::max(farthest, std::max(std::abs(lo[k]), std::abs(hi[k])));
    }
    return least > kDoubleUnits * norm_1(v) * norm_1(w) * farthest;
  }

  const IndexedGeometry& scene_;
  const LeafMates& mates_;
  const Vec3f common_;
  const Box3f box_;
  const Vec3f middle_;  // A point of the box.
  const std::span<const Vec3f> points_;
  ChildRef first_;
  int level_ = 0;
  size_t leaves_ = 0;
  ChildRef refs_[kMaxLeaves];
  PatchLeaf leaf_[kMaxLeaves];
};

// As CoverByPatchFn says.
template <bool kParallel>
uint32_t CoverByPatch(const IndexedGeometry& scene, Vec3f common, uint32_t common_source,
                      uint32_t mask, const Box3f& box, std::span<const Vec3f> points,
                      std::span<const uint32_t> sources, std::span<const uint32_t> seeds,
                      uint32_t* leaf, WalkStats* stats) {
  if (scene.bvh.mates.empty() || box.empty() || MustAskObjects(scene.geometry, mask)) return 0;
  PatchFinder<kParallel> finder(scene, common, box, points);
  const uint32_t count = finder.Find(seeds);
  stats->leaves += finder.leaves();
  if (count == 0) return 0;
  if (common_source != kNoTriangle || !sources.empty()) {
    const bool foreign = finder.All(
        [&](uint32_t id) HWY_ATTR { return id != common_source && !Holds(sources, id); });
    if (!foreign) return 0;
  }
  stats->shaft.relevant += count;
  *leaf = finder.first().bits();
  return count;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
