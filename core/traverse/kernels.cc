// SPDX-License-Identifier: Apache-2.0
#include "core/traverse/kernels.h"

#include "core/base/check.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/traverse/kernels.cc"
// AVX2 is the floor and AVX-512 (Highway's AVX3) the one other target; newer ones bring nothing to
// these walks.
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: this comes before everything that is compiled once per target.
#include "hwy/foreach_target.h"
// clang-format on

#include "core/traverse/clear_leaves-inl.h"
#include "core/traverse/hull_cut-inl.h"
#include "core/traverse/hull_walk-inl.h"
#include "core/traverse/kd_packet-inl.h"
#include "core/traverse/kd_single-inl.h"
#include "core/traverse/leaf_cover-inl.h"
#include "core/traverse/lit_boxes-inl.h"
#include "core/traverse/occluded_packet-inl.h"
#include "core/traverse/packet-inl.h"
#include "core/traverse/patch_cover-inl.h"
#include "core/traverse/point_ground-inl.h"
#include "core/traverse/rtt-inl.h"
#include "core/traverse/single-inl.h"
#include "core/traverse/trace_shaft-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr TraceShaftPairFn ShaftPairOfTarget() {
  if constexpr (hn::MaxLanes(ShaftD()) == kShaftBlockRays) {
    return &TraceShaftPair<PacketPair>;
  } else {
    return nullptr;
  }
}

// Called after the CPU has been asked for this target; plain data, so it could be read before.
const Kernels& TargetKernels() {
  static constexpr Kernels kKernels = {
      .occluded_single = &TraceSingle<true>,
      .closest_single = &TraceSingle<false>,
      .occluded_brute = &TraceBrute<true>,
      .closest_brute = &TraceBrute<false>,
      .occluded_packet = &TraceOccludedPacket<OriginLanes>,
      .closest_packet = &TraceClosestPacket,
      .occluded_parallel_packet = &TraceOccludedPacket<ParallelLanes>,
      .occluded_kd_single = &TraceKdSingle<true>,
      .closest_kd_single = &TraceKdSingle<false>,
      .occluded_kd_packet = &TraceKdPacket<true>,
      .closest_kd_packet = &TraceKdPacket<false>,
      .occluded_rtt = &TraceRtt<true>,
      .closest_rtt = &TraceRtt<false>,
      .occluded_shaft = &TraceShaft<true>,
      .closest_shaft = &TraceShaft<false>,
      .occluded_shaft_pair = ShaftPairOfTarget(),
      .occluded_parallel_shaft = &TraceParallelShaft,
      .cut_shaft = &CutShaft<false>,
      .cut_parallel_shaft = &CutShaft<true>,
      .cut_hull = &CutHull,
      .trace_hull = &TraceHull,
      .lit_boxes = &LitBoxes,
      .cover_points = &CoverPoints<false>,
      .cover_parallel_points = &CoverPoints<true>,
      .cover_by_patch = &CoverByPatch<false>,
      .cover_parallel_by_patch = &CoverByPatch<true>,
      .find_grounds = &FindGrounds,
      .ground_bits = &GroundBits<false>,
      .parallel_ground_bits = &GroundBits<true>,
      .choose_clear = &ChooseClear<false>,
      .choose_parallel_clear = &ChooseClear<true>,
  };
  return kKernels;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline {

absl::string_view SimdTargetName(SimdTarget target) {
  switch (target) {
    case SimdTarget::kBest:
      return "best";
    case SimdTarget::kAvx2:
      return "AVX2";
    case SimdTarget::kAvx512:
      return "AVX-512";
  }
  return "unknown";
}

bool SimdTargetAvailable(SimdTarget target) {
  static const auto supported = hwy::SupportedTargets();  // Asks the CPU, which takes its time.
  switch (target) {
    case SimdTarget::kBest:
    case SimdTarget::kAvx2:
      return (supported & HWY_AVX2) != 0;
    case SimdTarget::kAvx512:
      return (supported & HWY_AVX3) != 0;
  }
  return false;
}

SimdTarget BestSimdTarget() {
  static const SimdTarget best =
      SimdTargetAvailable(SimdTarget::kAvx512) ? SimdTarget::kAvx512 : SimdTarget::kAvx2;
  return best;
}

SimdTarget ResolveSimdTarget(SimdTarget target) {
  if (target == SimdTarget::kBest) target = BestSimdTarget();
  SIGHTLINE_CHECK(SimdTargetAvailable(target)) << SimdTargetName(target) << " is not on this CPU";
  return target;
}

const Kernels& KernelsFor(SimdTarget target) {
  return ResolveSimdTarget(target) == SimdTarget::kAvx512 ? N_AVX3::TargetKernels()
                                                          : N_AVX2::TargetKernels();
}

}  // namespace sightline
#endif  // HWY_ONCE
