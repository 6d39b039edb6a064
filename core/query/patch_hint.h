// SPDX-License-Identifier: Apache-2.0
//
// Where a patch that hides points from a light sample is looked for
// (core/traverse/patch_cover-inl.h), and when again after it was looked for in vain.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_QUERY_PATCH_HINT_H_
#define SIGHTLINE_CORE_QUERY_PATCH_HINT_H_

#include <algorithm>
#include <array>
#include <cstdint>

#include "core/traverse/trace_ray.h"

namespace sightline {

class PatchHint {
 public:
  // Leaves that darkened points, the last ones first; or kNoLeaf.
  const std::array<uint32_t, 4>& leaves() const { return leaves_; }
  void PutFirst(uint32_t leaf) {
    const auto was = std::find(leaves_.begin(), leaves_.end() - 1, leaf);
    std::move_backward(leaves_.begin(), was, was + 1);
    leaves_[0] = leaf;
  }

  // Whether it is to be looked for before the next block; if not, that is one block less to wait
  // for.
  bool IsDue() {
    if (wait_ == 0) return true;
    --wait_;
    return false;
  }
  // One was found before a block, or not: the more often not, one after the other, the longer it is
  // not looked for.
  void Note(bool found) {
    failed_ = found ? 0 : std::min(failed_ + 1, kMostWaits + 1);
    wait_ = std::max(failed_ - 1, 0);
  }

 private:
  static constexpr int kMostWaits = 7;
  static constexpr uint32_t kNoLeaf = RayPacket::kNoLeaf;

  std::array<uint32_t, 4> leaves_ = {kNoLeaf, kNoLeaf, kNoLeaf, kNoLeaf};
  int failed_ = 0, wait_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_PATCH_HINT_H_
