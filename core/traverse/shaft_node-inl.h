// SPDX-License-Identifier: Apache-2.0
//
// A node's eight boxes and a shaft: those that its sides and its shadows on the coordinate planes
// leave over.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_NODE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_NODE_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_NODE_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_NODE_INL_H_
#endif

#include "core/traverse/shaft_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using ShaftNodeD = hn::CappedTag<float, kBvhWidth>;

// The children that the shaft may meet; where any hit will do, those that reach beyond its caps
// across the axes alone.
template <bool kAny, bool kParallel, class Packet>
HWY_INLINE hn::Mask<ShaftNodeD> MayMeet(const BvhNode& node, const BlockBounds& bounds,
                                        const ShaftRays<kAny, kParallel, Packet>& rays) {
  const ShaftNodeD d;
  auto met = MeetsSides(node, bounds.sides, rays.node_margin());
  met = hn::And(met, hn::Ge(WithinWedges(d, bounds.wedges, node.bounds), hn::Zero(d)));
  if constexpr (kAny) met = hn::And(met, BeyondCaps(d, rays.axis_caps(), node.bounds));
  return met;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
