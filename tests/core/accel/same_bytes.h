// SPDX-License-Identifier: Apache-2.0
//
// Whether two trees are the same to the last bit.
//
// Thread safety: a pure function.
#ifndef SIGHTLINE_TESTS_CORE_ACCEL_SAME_BYTES_H_
#define SIGHTLINE_TESTS_CORE_ACCEL_SAME_BYTES_H_

#include <cstring>

#include "core/accel/bvh.h"

namespace sightline::testing_support {

inline bool SameBytes(const Bvh& a, const Bvh& b) {
  return a.nodes.size() == b.nodes.size() && a.leaves.size() == b.leaves.size() &&
         (a.nodes.empty() ||
          std::memcmp(a.nodes.data(), b.nodes.data(), a.nodes.size() * sizeof(BvhNode)) == 0) &&
         (a.leaves.empty() ||
          std::memcmp(a.leaves.data(), b.leaves.data(), a.leaves.size() * sizeof(float)) == 0) &&
         a.leaf_ids == b.leaf_ids && a.bounds == b.bounds && a.leaf_count == b.leaf_count &&
         a.triangle_count == b.triangle_count && a.max_depth == b.max_depth;
}

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_ACCEL_SAME_BYTES_H_
