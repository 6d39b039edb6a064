// SPDX-License-Identifier: Apache-2.0
#include "server/stream/shadow_chunk.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/query/point_bits.h"
#include "server/codec/result_codec.h"

namespace sightline {

ShadowChunk::ShadowChunk(size_t count, size_t part_points, const PointOrders* orders, size_t begin)
    : count_(count),
      part_points_(part_points),
      parts_((count + part_points - 1) / part_points),
      orders_(orders),
      begin_(begin),
      parts_left_(parts_) {
  SIGHTLINE_CHECK_GT(parts_, 0u);
  SIGHTLINE_CHECK_EQ(part_points % 8, size_t{0}) << "a part's bits are whole bytes";
}

size_t ShadowChunk::PartPoints(uint64_t part_rays, uint64_t samples) {
  constexpr uint64_t kLeastPoints = 8;
  const uint64_t wanted = part_rays / samples;
  // The power of two that is nearest by ratio, or about.
  return std::max(kLeastPoints, std::bit_floor(wanted + wanted / 2));
}

std::vector<uint32_t> ShadowChunk::Begin(size_t part, const PointRange& points,
                                         ShadowHints* hints) {
  MutexLock lock(mutex_);
  *hints = hints_;
  if (!ordered_) {
    order_ = orders_ != nullptr ? orders_->Of(begin_, count_)
                                : SpatialOrder(points.positions, points.valid);
    ordered_ = true;  // Not before: memory may run out, and other parts go on (memory_guard.h).
  }
  const size_t begin = std::min(part * part_points_, order_.size());
  const size_t end = std::min(begin + part_points_, order_.size());
  return {order_.begin() + static_cast<ptrdiff_t>(begin),
          order_.begin() + static_cast<ptrdiff_t>(end)};
}

absl::StatusOr<bool> ShadowChunk::RunPart(size_t part, const PointRange& points, size_t samples,
                                          const ShadowOutputs& outputs, const Compute& compute,
                                          ShadowResult* result, QueryStats* stats) {
  SIGHTLINE_CHECK_EQ(points.positions.size(), count_);
  ShadowHints hints;
  const std::vector<uint32_t> places = Begin(part, points, &hints);
  ShadowResult mine;
  if (!places.empty()) {
    SL_RETURN_IF_ERROR(compute(places, &hints, &mine));
    stats->Add(mine.stats);
  }
  MutexLock lock(mutex_);
  hints_ = std::move(hints);
  if (!begun_) {
    all_ = NothingLit(count_, samples, outputs);
    begun_ = true;  // As above.
  }
  if (!places.empty()) {
    ShadowOutputs others = outputs;
    others.bits = false;
    SpreadShadows(mine, places, count_, samples, others, &all_);
    // Bits stay in the order's places until there are all of them.
    const size_t bytes = (places.size() + 7) / 8, row = (count_ + 7) / 8;
    for (size_t s = 0; s < samples && outputs.bits; ++s) {
      std::memcpy(all_.lit_bits.data() + s * row + part * part_points_ / 8,
                  mine.lit_bits.data() + s * bytes, bytes);
    }
  }
  if (--parts_left_ > 0) return false;
  if (outputs.bits) PointBits(order_, count_).PutBack(all_.lit_bits);
  *result = std::move(all_);
  return true;
}

}  // namespace sightline
