// SPDX-License-Identifier: Apache-2.0
//
// How single rays' walks begin, a vector of rays at a time: what nodes' boxes are put to, and where
// any hit will do the root, which all rays visit.
//
// Thread safety: a call's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_WALK_STARTS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_WALK_STARTS_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_WALK_STARTS_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_WALK_STARTS_INL_H_
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "core/accel/bvh.h"
#include "core/geometry/box_ray.h"
#include "core/geometry/vec3.h"
#include "core/intersect/box_ray-inl.h"
#include "core/intersect/predicate-inl.h"
#include "core/intersect/predicate.h"
#include "core/traverse/trace_ray.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// A ray as a node's boxes are put to it. In parts of four words, as WalkStarts has it.
struct alignas(16) RayTerms {
  Vec3f origin;
  float limit;       // Nodes entered after this hold no hit that counts.
  Vec3f minus_inv;   // A BoxRay's reciprocals, with their signs changed.
  uint32_t root;     // Any hit: those of the root's children that the ray meets, bit by bit.
  uint32_t near[4];  // Bytes from a node to its near faces, by axis; the last is unused.
  uint32_t far[4];   // The same, to its far faces.
};

template <bool kAny>
class WalkStarts {
 public:
  // Both are kept by reference.
  WalkStarts(const BvhNode& root, std::span<const TraceRay> rays) : root_(root), rays_(rays) {}

  // How many rays have begun.
  size_t count() const { return next_; }
  bool any_left() const { return next_ < rays_.size(); }
  // Begins the next ray. REQUIRES: there is one.
  HWY_INLINE const TraceRay& Take(RayTerms* terms) {
    const size_t lane = next_ % kLanes;
    if (lane == 0) Prepare();
    const hn::Full128<uint32_t> d;
    auto* const to = reinterpret_cast<uint32_t*>(terms);
    static_assert(sizeof(RayTerms) == 4 * kParts * sizeof(uint32_t));
    for (size_t part = 0; part < kParts; ++part) {
      hn::Store(hn::Load(d, parts_[part] + lane * 4), d, to + part * 4);
    }
    return rays_[next_++];
  }

 private:
  using D = hn::CappedTag<float, 16>;
  using V = hn::Vec<D>;
  static constexpr size_t kLanes = hn::MaxLanes(D()), kParts = 4;
  static constexpr uint32_t kFacesBytes = sizeof(BvhNode::bounds[0]);

  // The next kLanes rays; what is behind the last one is that again.
  HWY_NOINLINE void Prepare() {
    const D d;
    const hn::RebindToUnsigned<D> du;
    alignas(64) float origin[3][kLanes], direction[3][kLanes], limit[kLanes];
    for (size_t lane = 0; lane < kLanes; ++lane) {
      const PredicateRay& ray = rays_[std::min(next_ + lane, rays_.size() - 1)].ray;
      const Vec3f toward = ray.RoundedDirection();
      for (int k = 0; k < 3; ++k) {
        origin[k][lane] = ray.origin[k];
        direction[k][lane] = toward[k];
      }
      limit[lane] = ray.segment ? kSegmentEnd : std::numeric_limits<float>::infinity();
    }
    const V o[3] = {hn::Load(d, origin[0]), hn::Load(d, origin[1]), hn::Load(d, origin[2])};
    const Vec3V<V> reciprocals = SlabReciprocals(
        d, {hn::Load(d, direction[0]), hn::Load(d, direction[1]), hn::Load(d, direction[2])});
    const V inv[3] = {reciprocals.x, reciprocals.y, reciprocals.z};
    const V most = hn::Load(d, limit);
    const auto bits = [&](V v) HWY_ATTR { return hn::BitCast(du, v); };
    auto met = hn::Zero(du);
    if constexpr (kAny) met = TestRoot(o, inv, most);
    hn::Vec<decltype(du)> near[3], far[3];
    for (uint32_t k = 0; k < 3; ++k) {
      const auto low = hn::Set(du, k * kFacesBytes), high = hn::Set(du, (k + 3) * kFacesBytes);
      near[k] = bits(hn::IfNegativeThenElse(inv[k], hn::BitCast(d, high), hn::BitCast(d, low)));
      far[k] = hn::Sub(hn::Add(low, high), near[k]);
    }
    hn::StoreInterleaved4(bits(o[0]), bits(o[1]), bits(o[2]), bits(most), du, parts_[0]);
    hn::StoreInterleaved4(bits(hn::Neg(inv[0])), bits(hn::Neg(inv[1])), bits(hn::Neg(inv[2])), met,
                          du, parts_[1]);
    hn::StoreInterleaved4(near[0], near[1], near[2], near[2], du, parts_[2]);
    hn::StoreInterleaved4(far[0], far[1], far[2], far[2], du, parts_[3]);
  }

  // SingleWalk::TestNode, operation by operation, for one box and a vector of rays at a time.
  HWY_INLINE hn::Vec<hn::RebindToUnsigned<D>> TestRoot(const V (&origin)[3], const V (&inv)[3],
                                                       V limit) const {
    const D d;
    const hn::RebindToUnsigned<D> du;
    const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    auto children = hn::Zero(du);
    for (uint32_t c = 0; c < root_.child_count; ++c) {
      V entry = hn::Neg(infinity), exit = infinity;
      for (int k = 0; k < 3; ++k) {
        const V lo = hn::Sub(hn::Set(d, root_.bounds[k][c]), origin[k]);
        const V hi = hn::Sub(hn::Set(d, root_.bounds[k + 3][c]), origin[k]);
        CutSlab(d, inv[k], lo, hi, &entry, &exit);
      }
      const V last = hn::Min(ExitWithMargin(d, exit), limit);
      const auto met = hn::Le(hn::Max(entry, hn::Zero(d)), last);
      children =
          hn::Or(children, hn::IfThenElseZero(hn::RebindMask(du, met), hn::Set(du, 1u << c)));
    }
    return children;
  }

  const BvhNode& root_;
  const std::span<const TraceRay> rays_;
  size_t next_ = 0;
  alignas(64) uint32_t parts_[kParts][kLanes * 4];  // Each lane's RayTerms, part by part.
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
