// SPDX-License-Identifier: Apache-2.0
//
// A tracer's neighbouring blocks as one shaft of 512 rays: what a shaft costs beside its tests, to
// be placed and bounded, to find its nodes and to prepare leaves' triangles, two packets share.
#include <algorithm>
#include <cstring>
#include <iterator>

#include "core/query/sample_tracer.h"

namespace sightline {

bool SampleTracer::MayPair(size_t b, uint32_t lit) const {
  if (run_.kernels().occluded_shaft_pair == nullptr || !AsTheyAre()) return false;
  if (b + 1 >= blocks() || PointsOf(b + 1) < kBlockRays) return false;
  const auto whole = [&](size_t block) {
    return known_points_[block] == 0 && clear_[block] == nullptr && (lit >> block & 1) == 0;
  };
  return whole(b) && whole(b + 1);
}

bool SampleTracer::TracePair(size_t b, const ShaftCut* cut, StatsScope* scope) {
  if (record_answered_by_) std::fill_n(AnsweredByOf(b), 2 * kBlockRays, AnsweredBy::kShaft);
  Box3f box = boxes_[b];
  box.Extend(boxes_[b + 1]);
  uint32_t blocked[2 * kBlockRays / 32];
  const bool traced = FetchWhile(b + 1, &packets_[b], [&](RayPacket* packets) {
    PacketPair pair(packets, &box, blocked);
    if (!run_.kernels().occluded_shaft_pair(scene_, pair, cut, run_.cancel(), scope->walk())) {
      return false;
    }
    packets->first_leaf = pair.first_leaf;
    return true;
  });
  if (!traced) return false;
  for (size_t k = 0; k < 2; ++k) {
    by_bits_[b + k] = true;
    // Sixteen to a number, as thirty-two: little-endian.
    static_assert(2 * sizeof(BlockBits) == sizeof(blocked));
    std::memcpy(bits_[b + k].data(), blocked + k * std::size(blocked) / 2, sizeof(BlockBits));
    scope->Took(Strategy::kShaft);
  }
  return true;
}

}  // namespace sightline
