// SPDX-License-Identifier: Apache-2.0
#include "core/query/point_parter.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/query/point_parter.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: this comes before everything that is compiled once per target.
#include "hwy/foreach_target.h"
// clang-format on

#include "core/query/point_parter-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

void PartPoints(std::span<const Vec3f> positions, std::span<const uint8_t> valid,
                const CancelToken* cancel, PartedPoints* parted) {
  PointParter(positions, valid, cancel, parted);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline {

PartPointsFn* PointParterFor(SimdTarget target) {
  return ResolveSimdTarget(target) == SimdTarget::kAvx512 ? &N_AVX3::PartPoints
                                                          : &N_AVX2::PartPoints;
}

}  // namespace sightline
#endif  // HWY_ONCE
