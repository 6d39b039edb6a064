// SPDX-License-Identifier: Apache-2.0
#include "core/query/pixel_blocks.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/query/pixel_blocks.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: this comes before everything that is compiled once per target.
#include "hwy/foreach_target.h"
// clang-format on

#include "core/query/pixel_blocks-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

const PixelBlockKernels& TargetPixelBlockKernels() {
  static constexpr PixelBlockKernels kKernels = {
      .lay_out = &LayOutPixels,
      .write = &WriteFloats,
      .write_ids = &WriteIds,
      .stream = &StreamFloats,
      .stream_ids = &StreamIds,
  };
  return kKernels;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline {

const PixelBlockKernels& PixelBlockKernelsFor(SimdTarget target) {
  return ResolveSimdTarget(target) == SimdTarget::kAvx512 ? N_AVX3::TargetPixelBlockKernels()
                                                          : N_AVX2::TargetPixelBlockKernels();
}

}  // namespace sightline
#endif  // HWY_ONCE
