// SPDX-License-Identifier: Apache-2.0
//
// Which boxes of points a light certainly reaches, all of each. They are put to the tree together,
// as the blocks of one shaft (shaft-inl.h) whose rays run to their corners: what bounds these,
// their slopes, depths and forms, bounds all segments to points between them. No ray is tested. A
// box that some triangle may touch is given up.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_LIT_BOXES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_LIT_BOXES_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_LIT_BOXES_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_LIT_BOXES_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <span>

#include "core/base/check.h"
#include "core/base/fill-inl.h"
#include "core/traverse/shaft_blocks-inl.h"
#include "core/traverse/shaft_leaf-inl.h"
#include "core/traverse/shaft_node-inl.h"
#include "core/traverse/shaft_rays-inl.h"
#include "core/traverse/single-inl.h"
#include "core/traverse/visit_fetcher-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

class LitBoxesWalk {
 public:
  // As LitBoxes.
  LitBoxesWalk(const IndexedGeometry& scene, Vec3f origin, uint32_t origin_source, uint32_t mask,
               std::span<const Box3f> boxes, WalkStats* stats)
      : scene_(scene), stats_(stats), rays_(scene, packet_), fetcher_(scene.bvh) {
    SIGHTLINE_DCHECK(!boxes.empty() && boxes.size() <= size_t{kShaftBlocks});
    packet_.origin = origin;
    packet_.origin_source = origin_source;
    packet_.mask = mask;
    packet_.sourceless = true;
    packet_.count = static_cast<int>(boxes.size()) * kShaftBlockRays;
    packet_.point_box = &all_;
    FillRow(&least_[0][0][0], sizeof(least_) / sizeof(float), -kInfinity);
    for (size_t b = 0; b < boxes.size(); ++b) {
      const Box3f& box = boxes[b];
      SIGHTLINE_DCHECK(!box.empty());
      all_.Extend(box);
      const size_t at = b * kShaftBlockRays;
      PutCorners(0xAAAA, box.lo.x, box.hi.x, packet_.target_x + at);
      PutCorners(0xCCCC, box.lo.y, box.hi.y, packet_.target_y + at);
      PutCorners(0xF0F0, box.lo.z, box.hi.z, packet_.target_z + at);
      for (int k = 0; k < 3; ++k) {
        if (box.lo[k] < origin[k]) least_[0][k][b] = box.lo[k];
        if (box.hi[k] > origin[k]) least_[1][k][b] = -box.hi[k];
      }
    }
  }

  uint32_t Run() {
    if (!rays_.Prepare(/*alone=*/true)) return 0;
    rays_.Bound(rays_.all(), &bounds_);
    if (!rays_.Fits(bounds_)) return 0;
    if (scene_.bvh.empty()) return bounds_.open_blocks;
    ShaftLeaf<true, false> prepared(scene_, rays_);
    PendingAny stack[kBvhStackSize + kBvhWidth];  // A whole vector is stored at its end.
    int depth = VisitNode(scene_.bvh.nodes[0], stack, 0);
    for (uint32_t work = 0; depth > 0;) {
      const ChildRef ref = stack[--depth].ref();
      if (depth > 0) fetcher_.FetchAll(stack[depth - 1].ref());
      if (ref.is_leaf()) {
        work += 2 + VisitLeaf(ref, &prepared);
      } else {
        depth = VisitNode(scene_.bvh.nodes[ref.node()], stack, depth);
        ++work;
      }
      if (bounds_.open_blocks == 0 || work > kMostWork) return 0;
    }
    return bounds_.open_blocks;
  }

 private:
  using M = ShaftM;
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  static constexpr size_t kLanes = hn::MaxLanes(ShaftD());
  // Work (nodes + 2·leaves + relevant triangles) after which all boxes are given up. Measured: 35
  // and 100 are as good to half a percent (core/traverse/EXPERIMENTS.md).
  static constexpr uint32_t kMostWork = 60;

  // Sixteen of a row, `hi` where a bit is set.
  static void PutCorners(uint32_t bits, float lo, float hi, float* row) {
    const ShaftD d;
    M high[kShaftBlockRays / kLanes];
    BlockLanes(bits, high);
    for (size_t k = 0; k < std::size(high); ++k) {
      hn::Store(hn::IfThenElse(high[k], hn::Set(d, hi), hn::Set(d, lo)), d, row + k * kLanes);
    }
  }

  int VisitNode(const BvhNode& node, PendingAny* stack, int depth) {
    ++stats_->nodes;
    return depth + PushChildren(ShaftNodeD(), node, MayMeet(node, bounds_, rays_), stack + depth);
  }

  // Gives up what the leaf's triangles may touch. Returns how many of them are relevant.
  uint32_t VisitLeaf(ChildRef ref, ShaftLeaf<true, false>* prepared) {
    ++stats_->leaves;
    const LeafView leaf(scene_, ref);
    const uint32_t relevant = prepared->Prepare(leaf, bounds_, bounds_.all_far);
    const TriangleBlocks<true, false> blocks(rays_, bounds_, prepared->forms());
    for (uint32_t left = relevant; left != 0; left &= left - 1) {
      const uint32_t i = std::countr_zero(left);
      touched_.count = 0;
      uint32_t met = blocks.List</*kFewBlocks=*/0>(i, &touched_);
      for (size_t k = 0; k < touched_.count; ++k) met |= 1u << BlockOf(touched_.pairs[k]);
      if (met != 0) bounds_.open_blocks &= ~(met & BeyondOwnCaps(leaf, i));
      stats_->shaft.pairs += touched_.count;
    }
    const auto relevant_count = static_cast<uint32_t>(std::popcount(relevant));
    stats_->shaft.triangles += leaf.count;
    stats_->shaft.relevant += relevant_count;
    return relevant_count;
  }

  // The boxes beyond whose own caps across the axes (AxisCaps) a triangle reaches.
  uint32_t BeyondOwnCaps(const LeafView& leaf, uint32_t i) const {
    const ShaftD d;
    const Vec3f a = leaf.corner(0, i), b = leaf.corner(1, i), c = leaf.corner(2, i);
    uint32_t beyond = 0;
    for (size_t first = 0; first < kShaftBlocks; first += kLanes) {
      M in = hn::FirstN(d, kLanes);
      for (int k = 0; k < 3; ++k) {
        const float most = std::max({a[k], b[k], c[k]}), least = std::min({a[k], b[k], c[k]});
        in = hn::And(in, hn::Lt(hn::Load(d, least_[0][k] + first), hn::Set(d, most)));
        in = hn::And(in, hn::Lt(hn::Load(d, least_[1][k] + first), hn::Set(d, -least)));
      }
      beyond |= MaskBits(d, in) << first;
    }
    return beyond;
  }

  const IndexedGeometry& scene_;
  WalkStats* const stats_;
  RayPacket packet_;
  Box3f all_;
  ShaftRays<true, false> rays_;
  const VisitFetcher fetcher_;
  ShaftBounds bounds_;
  BlockPairs touched_;
  // A box's caps: its least coordinate along an axis, and against it; minus infinity where the
  // light does not lie beyond that.
  alignas(64) float least_[2][3][kShaftBlocks];
};

inline uint32_t LitBoxes(const IndexedGeometry& scene, Vec3f origin, uint32_t origin_source,
                         uint32_t mask, std::span<const Box3f> boxes, WalkStats* stats) {
  return LitBoxesWalk(scene, origin, origin_source, mask, boxes, stats).Run();
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
