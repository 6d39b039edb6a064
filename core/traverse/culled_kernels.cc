// SPDX-License-Identifier: Apache-2.0
#include "core/traverse/culled_kernels.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/traverse/culled_kernels.cc"
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

const CulledKernels& TargetCulledKernels() {
  static constexpr CulledKernels kKernels = {
      .occluded_single = &TraceCulledSingle<true>,
      .closest_single = &TraceCulledSingle<false>,
      .occluded_packet = &TraceCulledPacket<true>,
      .closest_packet = &TraceCulledPacket<false>,
      .occluded_brute = &TraceBruteByIntersector<true>,
      .closest_brute = &TraceBruteByIntersector<false>,
  };
  return kKernels;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline {

const CulledKernels& CulledKernelsFor(SimdTarget target) {
  return ResolveSimdTarget(target) == SimdTarget::kAvx512 ? N_AVX3::TargetCulledKernels()
                                                          : N_AVX2::TargetCulledKernels();
}

}  // namespace sightline
#endif  // HWY_ONCE
