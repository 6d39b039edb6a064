// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/papers/leaf_boxes.h"

#include <algorithm>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/bench/papers/leaf_boxes.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: this comes before everything that is compiled once per target.
#include "hwy/foreach_target.h"
// clang-format on

#include "core/traverse/culled_walks-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

// The kd-tree without its leaves' boxes.
class ComputedBoxView : public KdTreeView {
 public:
  ComputedBoxView(const IndexedGeometry& scene, const LeafCulling& culling)
      : KdTreeView(scene, culling), geometry_(scene.geometry) {}

  bool LeafOf(uint32_t node, const Box3f& cell, LeafRange* range, Box3f* leaf_box) const {
    Box3f stored;
    if (!KdTreeView::LeafOf(node, cell, range, &stored)) return false;
    *leaf_box = HullOf(*range);
    for (int k = 0; k < 3; ++k) {
      leaf_box->lo[k] = std::max(leaf_box->lo[k], cell.lo[k]);
      leaf_box->hi[k] = std::min(leaf_box->hi[k], cell.hi[k]);
    }
    return true;
  }

 private:
  // Of the triangles as they are.
  Box3f HullOf(const LeafRange& range) const {
    const hn::CappedTag<float, kMaxLeafTriangles> d;
    using V = hn::Vec<decltype(d)>;
    const V none = hn::Set(d, std::numeric_limits<float>::infinity());
    V lo[3] = {none, none, none}, hi[3] = {hn::Neg(none), hn::Neg(none), hn::Neg(none)};
    for (uint32_t at = 0; at < range.count; at += kMaxLeafTriangles) {
      const RangeView view(geometry_, range, at);
      const LeafView& leaf = view.leaf;
      for (uint32_t i = 0; i < leaf.count; i += static_cast<uint32_t>(hn::Lanes(d))) {
        const auto here = hn::FirstN(d, leaf.count - i);
        for (uint32_t k = 0; k < 3; ++k) {
          const auto corner = [&](uint32_t c) HWY_ATTR {
            return hn::LoadU(d, leaf.rows + size_t{3 * c + k} * leaf.stride + i);
          };
          const V a = corner(0), b = corner(1), c = corner(2);
          const V least = hn::Min(hn::Min(a, b), c), most = hn::Max(hn::Max(a, b), c);
          lo[k] = hn::Min(lo[k], hn::IfThenElse(here, least, none));
          hi[k] = hn::Max(hi[k], hn::IfThenElse(here, most, hn::Neg(none)));
        }
      }
    }
    Box3f hull;
    for (int k = 0; k < 3; ++k) {
      hull.lo[k] = hn::GetLane(hn::MinOfLanes(d, lo[k]));
      hull.hi[k] = hn::GetLane(hn::MaxOfLanes(d, hi[k]));
    }
    return hull;
  }

  const SceneGeometry& geometry_;
};

bool ClosestComputed(const IndexedGeometry& scene, const LeafCulling& culling, RayPacket& packet,
                     const CancelToken* cancel, WalkStats* stats) {
  return packet.count == 0 ||
         TraceCulledTree<ComputedBoxView, false>(scene, culling, packet, cancel, stats);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline::bench {

TraceCulledPacketFn ClosestWithComputedBoxes() {
  return ResolveSimdTarget(SimdTarget::kBest) == SimdTarget::kAvx512 ? &N_AVX3::ClosestComputed
                                                                     : &N_AVX2::ClosestComputed;
}

}  // namespace sightline::bench
#endif  // HWY_ONCE
