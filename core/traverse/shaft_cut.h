// SPDX-License-Identifier: Apache-2.0
//
// Where the walks of neighbouring shafts begin. The upper tree is walked once for all of them; what
// it comes to is packed into nodes anew, children of several levels together, and each shaft starts
// from these instead of the root.
//
// Thread safety: plain values. Points into the scene it was made for.
#ifndef SIGHTLINE_CORE_TRAVERSE_SHAFT_CUT_H_
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_CUT_H_

#include <cstdint>

#include "core/accel/bvh.h"

namespace sightline {

struct ShaftCut {
  static constexpr uint32_t kMaxNodes = 6;
  static constexpr uint32_t kMaxChildren = kMaxNodes * kBvhWidth;

  uint32_t node_count = 0;
  // Their children are nodes and leaves of the scene. For rays without an end, near before far.
  BvhNode nodes[kMaxNodes];
};

// What a walk for all samples of an area light leaves to walks sample by sample.
struct HullRest {
  ShaftCut cut;
  uint16_t samples = 0;  // Bit k: sample k may meet something there; 0 if the cut has no node.
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_SHAFT_CUT_H_
