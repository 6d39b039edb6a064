// SPDX-License-Identifier: Apache-2.0
#include "core/query/point_rows.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/query/point_rows.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: this comes before everything that is compiled once per target.
#include "hwy/foreach_target.h"
// clang-format on

#include "core/query/point_rows-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

const PointRowKernels& TargetPointRowKernels() {
  static constexpr PointRowKernels kKernels = {
      .split = &SplitPoints,
      .box = &BoxOfPoints,
      .free_bits = &FreeBits,
      .flag_bits = &FlagBits,
      .set_where = &SetWhere,
  };
  return kKernels;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline {

const PointRowKernels& PointRowKernelsFor(SimdTarget target) {
  return ResolveSimdTarget(target) == SimdTarget::kAvx512 ? N_AVX3::TargetPointRowKernels()
                                                          : N_AVX2::TargetPointRowKernels();
}

}  // namespace sightline
#endif  // HWY_ONCE
