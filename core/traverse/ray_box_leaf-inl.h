// SPDX-License-Identifier: Apache-2.0
//
// What the single-ray walks do in a leaf that may be large: ray-box culling (paper 001, section 3).
// The box of the ray's points between its entry into and its exit from the leaf, cut at the nearest
// hit so far, is put to the triangles' boxes, sixteen at a time; what it misses is not tested.
// After a hit its far faces move up to the hit point. Where triangles are tested one by one, by a
// paper's test, those that are left of the sixteen are put to it again; by the predicate sixteen
// are tested at once, and the next ones meet the smaller box.
//
// Margin, with u = 2^-24, everything relative to the origin O: entry and exit carry four roundings
// each (core/geometry/box_ray.h, 2), D one, the product one: a point of the ray within the leaf
// lies within 6.2u of the box's faces, relative to the farther of the two along that axis. A
// triangle's face carries one rounding; a face farther away than twice that is told apart by far
// more than its rounding. kRayBoxUnits = 16u covers both, underflow its own term. (The paper widens
// by a constant, 0.0001, which has a unit.) Along an axis whose reciprocal is not to be trusted
// (box_ray.h, 4) the box has no ends.
//
// Distances: a triangle beyond the box cut at a hit has an entry after that hit by the same margin,
// and its distance is not below its entry (core/intersect/hit.h). So what is culled is farther.
// That holds axis by axis, each by its own far face, whose margin is relative to the face alone:
// moving the far faces changes nothing of what the near ones say.
//
// The hit point that the paper reuses is t·D here, three products: the box is relative to O.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_RAY_BOX_LEAF_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_RAY_BOX_LEAF_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_RAY_BOX_LEAF_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_RAY_BOX_LEAF_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "core/accel/indexed_geometry.h"
#include "core/geometry/box_ray.h"
#include "core/intersect/intersector-inl.h"
#include "core/traverse/leaf_culling.h"
#include "core/traverse/leaf_range.h"
#include "core/traverse/packet_leaf-inl.h"
#include "core/traverse/single-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr float kRayBoxUnits = 16 * 0x1p-24f;

// The box of a ray's points between two parameters, relative to its origin, widened by the margin.
struct RayPartBox {
  float lo[3], hi[3];

  // How far a face at t·d, |t·d| = `size`, may be off. A parameter that underflows is off by up to
  // 2^-149, which d scales.
  static HWY_INLINE float Margin(float size, float d) {
    return size * kRayBoxUnits + kBoxExitShift * std::max(1.0f, std::abs(d));
  }

  // REQUIRES: 0 <= begin, begin <= end but for roundings; end may be +inf.
  static HWY_INLINE RayPartBox Make(const BoxRay& ray, Vec3f direction, float begin, float end) {
    constexpr float kInf = std::numeric_limits<float>::infinity();
    RayPartBox box;
    for (int k = 0; k < 3; ++k) {
      const float d = direction[k];
      if (std::isnan(ray.inv[k])) {
        box.lo[k] = -kInf;
        box.hi[k] = kInf;
        continue;
      }
      const float a = d == 0 ? 0 : begin * d, b = d == 0 ? 0 : end * d;
      const float size = std::max(std::abs(a), std::abs(b));
      const float margin = size < kInf ? Margin(size, d) : 0;
      box.lo[k] = std::min(a, b) - margin;
      box.hi[k] = std::max(a, b) + margin;
      if (size == kInf) {
        // An endless ray out of the scene: its nearer end carries its own rounding alone.
        const float near = Margin(std::min(std::abs(a), std::abs(b)), d);
        (d > 0 ? box.lo[k] : box.hi[k]) = d > 0 ? a - near : a + near;
      }
    }
    return box;
  }

  // The part ends at a hit: its far faces move there, the near ones stay (paper 001, section 3.5).
  // REQUIRES: `end` is finite, and no later than the part's.
  HWY_INLINE void EndAt(const BoxRay& ray, Vec3f direction, float end) {
    for (int k = 0; k < 3; ++k) {
      const float d = direction[k];
      if (std::isnan(ray.inv[k]) || d == 0) continue;
      const float at = end * d;
      const float margin = Margin(std::abs(at), d);
      (d > 0 ? hi[k] : lo[k]) = d > 0 ? at + margin : at - margin;
    }
  }
};

// Triangles tested lately by one ray: a small table that forgets (paper 001, section 2.2).
class Mailbox {
 public:
  Mailbox() { Clear(); }
  void Clear() { std::fill_n(ids_, kSlots, kNoTriangle); }
  // Whether it was tested; from now on it was.
  HWY_INLINE bool Seen(uint32_t id) {
    uint32_t& slot = ids_[id % kSlots];
    if (slot == id) return true;
    slot = id;
    return false;
  }

 private:
  static constexpr uint32_t kSlots = 64;
  uint32_t ids_[kSlots];
};

template <bool kAny>
class RayBoxLeaf {
 public:
  RayBoxLeaf(const IndexedGeometry& scene, const LeafCulling& culling, const TraceRay& query,
             WalkStats* stats, RayPoll* poll)
      : scene_(scene),
        culling_(culling),
        query_(query),
        stats_(stats),
        poll_(poll),
        direction_(query.ray.RoundedDirection()),
        dot_ray_(DotProductRay::Make(query.ray.origin, direction_)),
        box_ray_(BoxRay::Make(query.ray.origin, direction_)) {}

  const BoxRay& box_ray() const { return box_ray_; }

  // The ray is within the leaf from `entry` to `exit`, and looks no further than `limit`. Returns
  // true when any further hit is of no interest, or when the poll has fired.
  bool Visit(const LeafRange& range, float entry, float exit, Hit* best, float* limit) {
    Part part;
    part.boxes = culling_.ray_box && range.count >= culling_.ray_box_min_triangles;
    if (part.boxes) {
      ++stats_->ray_boxes;
      part.end = std::min(exit, *limit);
      part.box = RayPartBox::Make(box_ray_, direction_, entry > 0 ? entry : 0, part.end);
    }
    for (uint32_t at = 0; at < range.count; at += kMaxLeafTriangles) {
      if (at > 0 && poll_->Stops()) return true;
      const RangeView view(scene_.geometry, range, at);
      const Batch batch = {view.leaf, range, at};
      uint32_t chosen = (1u << view.leaf.count) - 1;
      if (part.boxes) chosen &= Overlapping(batch, part.box);
      if (culling_.mailbox) {
        for (uint32_t bits = chosen; bits != 0; bits &= bits - 1) {
          const uint32_t lane = std::countr_zero(bits);
          if (mailbox_.Seen(view.leaf.id(lane))) chosen &= ~(1u << lane);
        }
      }
      stats_->culled_tests += view.leaf.count - std::popcount(chosen);
      if (chosen == 0) continue;
      const bool stop = culling_.intersector == Intersector::kExact
                            ? TestExactly(view.leaf, chosen, best)
                            : TestByIntersector(batch, chosen, best, &part);
      if (stop) return true;
      if (best->t < *limit) *limit = best->t;
      if (at + kMaxLeafTriangles < range.count) EndAt(*best, &part);
    }
    return false;
  }

 private:
  // What the leaf's triangles are put to.
  struct Part {
    bool boxes = false;  // If not, nothing: the others are not set.
    RayPartBox box;
    float end = 0;
  };
  // Triangles at, at + 1, ... of a leaf, as they are seen.
  struct Batch {
    const LeafView& leaf;
    const LeafRange& range;
    uint32_t at;
  };
  using DT = hn::CappedTag<float, kMaxLeafTriangles>;

  // Makes the part end at the nearest hit, if that is within it. Returns whether it does.
  HWY_INLINE bool EndAt(const Hit& best, Part* part) {
    if (!part->boxes || !culling_.ray_box_update || !(best.t < part->end)) return false;
    ++stats_->ray_box_updates;
    part->end = best.t;
    part->box.EndAt(box_ray_, direction_, best.t);
    return true;
  }

  // Faces along an axis of the batch's boxes from `first` on, relative to the ray's origin: stored,
  // else made on the way.
  template <bool kHigh>
  HWY_INLINE hn::Vec<DT> Faces(const Batch& batch, uint32_t first, int axis) const {
    const DT d;
    const auto o = hn::Set(d, query_.ray.origin[axis]);
    if (const LeafTriangles* const stored = batch.range.triangles; stored != nullptr) {
      const float* const row = stored->boxes.data() + batch.range.first + batch.at + first;
      return hn::Sub(hn::LoadU(d, row + (kHigh ? 3 + axis : axis) * stored->stride), o);
    }
    const size_t stride = batch.leaf.stride;
    const float* const row = batch.leaf.rows + axis * stride + first;
    const auto a = hn::LoadU(d, row), b = hn::LoadU(d, row + 3 * stride),
               c = hn::LoadU(d, row + 6 * stride);
    return hn::Sub(kHigh ? hn::Max(hn::Max(a, b), c) : hn::Min(hn::Min(a, b), c), o);
  }

  HWY_INLINE uint32_t Overlapping(const Batch& batch, const RayPartBox& box) const {
    const DT d;
    uint32_t met = 0;
    for (uint32_t first = 0; first < batch.leaf.count;
         first += static_cast<uint32_t>(hn::Lanes(d))) {
      auto apart = hn::Lt(hn::Zero(d), hn::Zero(d));  // None.
      for (int k = 0; k < 3; ++k) {
        apart = hn::Or(apart, hn::Gt(Faces<false>(batch, first, k), hn::Set(d, box.hi[k])));
        apart = hn::Or(apart, hn::Lt(Faces<true>(batch, first, k), hn::Set(d, box.lo[k])));
      }
      met |= (~MaskBits(d, apart) & ((1u << hn::Lanes(d)) - 1)) << first;
    }
    return met & ((1u << batch.leaf.count) - 1);
  }

  // Those of `left` whose boxes begin before the part ends, which overlapped it when it was longer:
  // half of the faces, as only the far ones have moved.
  HWY_INLINE uint32_t BeginWithin(const Batch& batch, const RayPartBox& box, uint32_t left) const {
    const DT d;
    uint32_t beyond = 0;
    for (uint32_t first = 0; left >> first != 0; first += static_cast<uint32_t>(hn::Lanes(d))) {
      auto apart = hn::Lt(hn::Zero(d), hn::Zero(d));  // None.
      for (int k = 0; k < 3; ++k) {
        apart = hn::Or(apart, direction_[k] > 0
                                  ? hn::Gt(Faces<false>(batch, first, k), hn::Set(d, box.hi[k]))
                                  : hn::Lt(Faces<true>(batch, first, k), hn::Set(d, box.lo[k])));
      }
      beyond |= MaskBits(d, apart) << first;
    }
    return left & ~beyond;
  }

  // All lanes at once: those that are not chosen cost nothing, and are not counted.
  bool TestExactly(const LeafView& leaf, uint32_t chosen, Hit* best) {
    stats_->triangle_tests -= leaf.count - std::popcount(chosen);
    return TestLeaf(leaf, query_, scene_.geometry, stats_, [&](uint32_t lane) HWY_ATTR {
      if constexpr (kAny) {
        *best = {0.0f, leaf.id(lane)};
        return true;
      } else {
        KeepCloser(leaf, lane, query_, best);
        return false;
      }
    });
  }

  // One by one: the part of the ray ends at each hit, if there is something left that it may spare.
  bool TestByIntersector(const Batch& batch, uint32_t chosen, Hit* best, Part* part) {
    const LeafView& leaf = batch.leaf;
    const float end = query_.ray.segment ? 1.0f : std::numeric_limits<float>::infinity();
    while (chosen != 0) {
      const uint32_t lane = std::countr_zero(chosen), id = leaf.id(lane);
      chosen &= chosen - 1;
      ++stats_->triangle_tests;
      if (id == query_.from_source || id == query_.to_source || query_.unseen.Holds(id)) continue;
      PreparedTriangle room;
      const float* const value = PreparedValue(scene_, culling_.intersector, id, &room);
      const auto tested = TestOneBy(value, std::min(end, best->t));
      if (!tested.hit) continue;
      if (MustAskObjects(scene_.geometry, query_.mask) &&
          !ObjectBlocks(scene_.geometry, id, query_.mask,
                        SideOfPlane(leaf.corner(0, lane), leaf.corner(1, lane),
                                    leaf.corner(2, lane), query_.ray.origin))) {
        continue;
      }
      if constexpr (kAny) {
        *best = {0.0f, id};
        return true;
      } else {
        const Hit hit{tested.t, id};
        if (!(hit < *best) || !(hit.t > query_.near)) continue;
        *best = hit;
        if (chosen == 0 || !EndAt(*best, part)) continue;
        const uint32_t left = BeginWithin(batch, part->box, chosen);
        stats_->culled_tests += std::popcount(chosen & ~left);
        chosen = left;
      }
    }
    return false;
  }

  HWY_INLINE Tested<ScalarOps<float>> TestOneBy(const float* value, float t_max) const {
    const Vec3f o = query_.ray.origin, d = direction_;
    switch (culling_.intersector) {
      case Intersector::kHavelHerout:
        return TestOne<Intersector::kHavelHerout>(value, o, d, t_max);
      case Intersector::kHavelHeroutDivided:
        return TestOne<Intersector::kHavelHeroutDivided>(value, o, d, t_max);
      case Intersector::kWald:
        return TestOne<Intersector::kWald>(value, o, d, t_max);
      case Intersector::kShevtsov:
        return TestOne<Intersector::kShevtsov>(value, o, d, t_max);
      case Intersector::kKenslerShirley:
        return TestOne<Intersector::kKenslerShirley>(value, o, d, t_max);
      case Intersector::kHavelHeroutDotProduct:
        return TestByDotProducts(value, dot_ray_, t_max);
      case Intersector::kExact:
      case Intersector::kMoellerTrumbore:
        break;
    }
    return TestOne<Intersector::kMoellerTrumbore>(value, o, d, t_max);
  }

  const IndexedGeometry& scene_;
  const LeafCulling& culling_;
  const TraceRay& query_;
  WalkStats* const stats_;
  RayPoll* const poll_;
  const Vec3f direction_;
  const DotProductRay dot_ray_;
  const BoxRay box_ray_;
  Mailbox mailbox_;
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
