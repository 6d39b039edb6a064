// SPDX-License-Identifier: Apache-2.0
#include "core/query/group_grounds.h"

#include <algorithm>

#include "core/base/check.h"
#include "core/query/ray_block.h"
#include "core/traverse/leaf_view.h"

namespace sightline {
namespace {

// Samples for which a search pays: it costs about as much as walks for two of them.
constexpr size_t kLeastSamples = 8;
// One of so many points must have a ground: behind a block where fewer have, none is looked for.
constexpr size_t kLeastShare = 8;
constexpr uint32_t kLongestWait = 64;

}  // namespace

GroupGrounds::GroupGrounds(const IndexedGeometry& scene, const QueryRun& run, size_t samples)
    : scene_(scene),
      run_(run),
      rows_(PointRowKernelsFor(run.options().simd)),
      wanted_(samples >= kLeastSamples) {}

bool GroupGrounds::Help(const LightSample& sample, uint32_t mask, WalkStats* stats) {
  if (!wanted_ || state_ == State::kUseless || MustAskObjects(scene_.geometry, mask) ||
      sample.source_triangle != kNoTriangle) {
    return false;
  }
  if (state_ == State::kNew) state_ = Find(stats) ? State::kFound : State::kUseless;
  return state_ == State::kFound;
}

bool GroupGrounds::Find(WalkStats* stats) {
  if (wait_ > 0) {
    --wait_;
    return false;
  }
  if (grounds_ == nullptr) {
    grounds_ = std::make_unique_for_overwrite<PointGrounds[]>(kGroupBlocks);
  }
  size_t found = 0;
  bool enough = true;
  for (size_t first = 0; enough && first < positions_.size(); first += kBlockRays) {
    const size_t count = std::min<size_t>(kBlockRays, positions_.size() - first);
    PointGrounds& block = grounds_[first / kBlockRays];
    block.count = static_cast<int>(count);
    rows_.split(positions_.subspan(first, count), block.x, block.y, block.z);
    found += run_.kernels().find_grounds(
        scene_, sources_.empty() ? nullptr : sources_.data() + first, &block, stats);
    enough = found * kLeastShare >= first + count;
  }
  if (enough) {
    next_wait_ = 1;
    return true;
  }
  wait_ = next_wait_;
  next_wait_ = std::min(2 * next_wait_, kLongestWait);
  return false;
}

size_t GroupGrounds::Bits(const LightSample& sample, size_t block, uint16_t* bits) const {
  SIGHTLINE_DCHECK(state_ == State::kFound);
  const Kernels& kernels = run_.kernels();
  return (sample.directional ? kernels.parallel_ground_bits : kernels.ground_bits)(
      grounds_[block], sample.value, bits);
}

}  // namespace sightline
