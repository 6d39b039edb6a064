// SPDX-License-Identifier: Apache-2.0
//
// The instruction sets the walks are compiled for, and which of them this machine has.
//
// Thread safety: functions only.
#ifndef SIGHTLINE_CORE_TRAVERSE_SIMD_TARGET_H_
#define SIGHTLINE_CORE_TRAVERSE_SIMD_TARGET_H_

#include <cstdint>

#include "absl/strings/string_view.h"

namespace sightline {

enum class SimdTarget : uint8_t { kBest = 0, kAvx2 = 1, kAvx512 = 2 };

absl::string_view SimdTargetName(SimdTarget target);  // "best", "AVX2", "AVX-512".
bool SimdTargetAvailable(SimdTarget target);          // On this machine.
SimdTarget BestSimdTarget();                          // What kBest means here.
// kBest resolved. CHECKs that the target is available.
SimdTarget ResolveSimdTarget(SimdTarget target);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_SIMD_TARGET_H_
