// SPDX-License-Identifier: Apache-2.0
#include "core/query/placement_kernels.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/query/placement_kernels.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: this comes before everything that is compiled once per target.
#include "hwy/foreach_target.h"
// clang-format on

#include "core/query/placement-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

const PlacementKernels& TargetPlacementKernels() {
  static constexpr PlacementKernels kKernels = {
      .place = &PlaceHits,
      .extent = &ExtentOf,
      .not_apart = &NotApart,
  };
  return kKernels;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline {

const PlacementKernels& PlacementKernelsFor(SimdTarget target) {
  return ResolveSimdTarget(target) == SimdTarget::kAvx512 ? N_AVX3::TargetPlacementKernels()
                                                          : N_AVX2::TargetPlacementKernels();
}

}  // namespace sightline
#endif  // HWY_ONCE
