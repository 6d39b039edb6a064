// SPDX-License-Identifier: Apache-2.0
//
// The grounds of a group of points (core/traverse/point_ground.h): found once, and put to one light
// sample after another. Points that lie on no surface cost a search now and then. Internal to
// core/query.
//
// Thread safety: belongs to one thread.
//
//   GroupGrounds grounds(scene, run, samples);
//   grounds.SetPoints(positions, sources);
//   if (grounds.Help(sample, mask, &stats)) dark = grounds.Bits(sample, block, bits);
#ifndef SIGHTLINE_CORE_QUERY_GROUP_GROUNDS_H_
#define SIGHTLINE_CORE_QUERY_GROUP_GROUNDS_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "core/accel/indexed_geometry.h"
#include "core/geometry/vec3.h"
#include "core/light/light.h"
#include "core/query/point_rows.h"
#include "core/query/query_run.h"
#include "core/traverse/clear_leaves.h"
#include "core/traverse/point_ground.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

class GroupGrounds {
 public:
  // For points that are asked about `samples` times. What is referred to must outlive this.
  GroupGrounds(const IndexedGeometry& scene, const QueryRun& run, size_t samples);

  // As SampleTracer::SetPoints.
  void SetPoints(std::span<const Vec3f> positions, std::span<const uint32_t> sources) {
    positions_ = positions;
    sources_ = sources;
    state_ = State::kNew;
  }

  // Whether Bits may be asked about this sample; finds the grounds if need be.
  bool Help(const LightSample& sample, uint32_t mask, WalkStats* stats);

  // Which points of a block their grounds hide from the sample: bit i % 16 of bits[i / 16] for
  // point i, as many bits as a block has. Returns how many. REQUIRES: Help().
  size_t Bits(const LightSample& sample, size_t block, uint16_t* bits);
  // The leaves that are clear of a block's points toward the sample: valid until it is called for
  // the block again. REQUIRES: Bits of this sample and block were the last to be asked for.
  const ClearToward* ClearOf(const LightSample& sample, size_t block);

 private:
  enum class State : uint8_t { kNew, kFound, kUseless };

  // Whether enough of the points have one.
  bool Find(WalkStats* stats);

  const IndexedGeometry& scene_;
  const QueryRun& run_;
  const PointRowKernels& rows_;
  const bool wanted_, wants_clear_;
  std::span<const Vec3f> positions_;
  std::span<const uint32_t> sources_;
  State state_ = State::kNew;
  // Whether something is tried for a group: after it went badly not for the next ones, `wait` of
  // them and then ever more.
  class Turn {
   public:
    explicit Turn(uint32_t wait) : first_wait_(wait), next_wait_(wait) {}
    bool Comes() {
      if (wait_ == 0) return true;
      --wait_;
      return false;
    }
    void Went(bool well);

   private:
    const uint32_t first_wait_;
    uint32_t wait_ = 0, next_wait_;
  };

  Turn grounds_turn_ = Turn(1), clear_turn_ = Turn(16);
  bool has_clear_ = false;  // Of this group.
  // Pairs of a leaf and a block that were looked at for it, and how often they were clear.
  uint64_t searched_ = 0, cleared_ = 0;
  // By block; made when first needed.
  std::unique_ptr<PointGrounds[]> grounds_;
  std::unique_ptr<ClearLeaves[]> clear_;
  std::unique_ptr<ClearToward[]> toward_;
  alignas(64) float rises_[PointGrounds::kMaxPoints / 16];  // Of the last Bits().
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_GROUP_GROUNDS_H_
