// SPDX-License-Identifier: Apache-2.0
#include "core/query/group_grounds.h"

#include <algorithm>
#include <bit>
#include <cstdint>

#include "core/base/check.h"
#include "core/query/ray_block.h"
#include "core/traverse/leaf_view.h"

namespace sightline {
namespace {

// Samples for which a search pays: it costs about as much as walks for two of them.
constexpr size_t kLeastSamples = 8;
// One of so many points must have a ground: behind a block where fewer have, none is looked for.
constexpr size_t kLeastShare = 8;
// Toward so many samples a leaf beside a block's points must be clear of them, on an average of a
// group's: what is toward fewer saves less than the search takes. And what is tried for that.
constexpr uint64_t kLeastCleared = 24;
constexpr size_t kLeastClearSamples = 32;
constexpr uint32_t kLongestWait = 64;

}  // namespace

void GroupGrounds::Turn::Went(bool well) {
  if (well) {
    next_wait_ = first_wait_;
    return;
  }
  wait_ = next_wait_;
  next_wait_ = std::min(2 * next_wait_, kLongestWait);
}

GroupGrounds::GroupGrounds(const IndexedGeometry& scene, const QueryRun& run, size_t samples)
    : scene_(scene),
      run_(run),
      rows_(PointRowKernelsFor(run.options().simd)),
      wanted_(samples >= kLeastSamples),
      wants_clear_(samples >= kLeastClearSamples) {}

bool GroupGrounds::Help(const LightSample& sample, uint32_t mask, WalkStats* stats) {
  if (!wanted_ || state_ == State::kUseless || MustAskObjects(scene_.geometry, mask) ||
      sample.source_triangle != kNoTriangle) {
    return false;
  }
  if (state_ == State::kNew) state_ = Find(stats) ? State::kFound : State::kUseless;
  return state_ == State::kFound;
}

bool GroupGrounds::Find(WalkStats* stats) {
  if (!grounds_turn_.Comes()) return false;
  if (grounds_ == nullptr) {
    grounds_ = std::make_unique_for_overwrite<PointGrounds[]>(kGroupBlocks);
  }
  // What the group before had of its clear leaves.
  if (has_clear_) clear_turn_.Went(cleared_ >= kLeastCleared * searched_);
  has_clear_ = wants_clear_ && clear_turn_.Comes();
  if (has_clear_ && clear_ == nullptr) {
    clear_ = std::make_unique_for_overwrite<ClearLeaves[]>(kGroupBlocks);
    toward_ = std::make_unique_for_overwrite<ClearToward[]>(kGroupBlocks);
  }
  searched_ = cleared_ = 0;
  size_t found = 0;
  bool enough = true;
  for (size_t first = 0; enough && first < positions_.size(); first += kBlockRays) {
    const size_t count = std::min<size_t>(kBlockRays, positions_.size() - first);
    PointGrounds& block = grounds_[first / kBlockRays];
    block.count = static_cast<int>(count);
    Box3f box;  // Nobody asks for it.
    rows_.split(positions_.subspan(first, count), block.x, block.y, block.z, &box);
    found += run_.kernels().find_grounds(
        scene_, sources_.empty() ? nullptr : sources_.data() + first, &block,
        has_clear_ ? &clear_[first / kBlockRays] : nullptr, stats);
    searched_ += uint64_t{block.leaf_count} * ClearLeaves::kBlocks;
    enough = found * kLeastShare >= first + count;
  }
  grounds_turn_.Went(enough);
  return enough;
}

const ClearToward* GroupGrounds::ClearOf(const LightSample& sample, size_t block) {
  SIGHTLINE_DCHECK(state_ == State::kFound);
  if (!has_clear_ || clear_[block].count == 0) return nullptr;
  const Kernels& kernels = run_.kernels();
  ClearToward* const toward = &toward_[block];
  (sample.directional ? kernels.choose_parallel_clear : kernels.choose_clear)(
      clear_[block], sample.value, rises_, toward);
  for (uint32_t i = 0; i < toward->count; ++i) {
    cleared_ += static_cast<uint64_t>(std::popcount(toward->blocks[i]));
  }
  return toward->count > 0 ? toward : nullptr;
}

size_t GroupGrounds::Bits(const LightSample& sample, size_t block, uint16_t* bits) {
  SIGHTLINE_DCHECK(state_ == State::kFound);
  const Kernels& kernels = run_.kernels();
  return (sample.directional ? kernels.parallel_ground_bits : kernels.ground_bits)(
      grounds_[block], sample.value, bits, has_clear_ ? rises_ : nullptr);
}

}  // namespace sightline
