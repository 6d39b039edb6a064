// SPDX-License-Identifier: Apache-2.0
//
// An area light's samples and a group of points as hulls: one of each block of points with all
// samples, walked before the samples are asked about one by one, and one of all blocks, where those
// walks begin. Internal to core/query.
//
// Thread safety: belongs to one thread.
//
//   GroupHulls hulls(scene, run, kind, samples);
//   hulls.SetPoints(count);
//   if (hulls.Find(s, /*alone=*/false)) {
//     hulls.Begin(packets);
//     if (hulls.IsNew(b)) hulls.Trace(b, by_shaft, &packets[b], &stats);
//     dark = hulls.Bits(s, b, bits);  // The rest, if !hulls.Answers(s, b), from hulls.CutOf(b) on.
//   }
#ifndef SIGHTLINE_CORE_QUERY_GROUP_HULLS_H_
#define SIGHTLINE_CORE_QUERY_GROUP_HULLS_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/accel/indexed_geometry.h"
#include "core/base/aligned_vector.h"
#include "core/light/light.h"
#include "core/query/point_rows.h"
#include "core/query/query_run.h"
#include "core/query/ray_block.h"
#include "core/traverse/light_hull.h"
#include "core/traverse/shaft_cut.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

class GroupHulls {
 public:
  // Samples of one light for which it pays to look at their common hull first.
  static constexpr size_t kLeastSamples = 4;

  // What is referred to must outlive this.
  GroupHulls(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
             std::span<const LightSample> samples)
      : scene_(scene),
        run_(run),
        rows_(PointRowKernelsFor(run.options().simd)),
        kind_(kind),
        samples_(samples) {}

  // Other points, in blocks of kBlockRays.
  void SetPoints(size_t count) {
    points_ = count;
    begin_ = end_ = 0;
  }

  // Finds the samples from s on that are of its light, or none but s if that is to stay `alone`.
  // Whether they are enough for a hull, which all that follows is about.
  bool Find(size_t s, bool alone);
  size_t begin() const { return begin_; }
  size_t end() const { return end_; }

  // The hull of these and the points, whose packets are laid out: once, and nothing after that.
  void Begin(std::span<const RayPacket> packets);

  // Whether block b has not been traced.
  bool IsNew(size_t b) const { return states_[b] == State::kNew; }
  // Puts all of the samples to block b, if its walk is to be a shaft's; else cuts by the hull of
  // them and the block's points alone. The packet's origin is lost. Whether there was a walk.
  bool Trace(size_t b, bool by_shaft, RayPacket* packet, WalkStats* stats);

  // Whether nothing of block b is left to be walked for sample s. REQUIRES: Find() of it.
  bool Answers(size_t s, size_t b) const {
    if (states_[b] == State::kAnswered) return true;
    return states_[b] == State::kCut && (rests_[b].samples >> (s - begin_) & 1) == 0;
  }
  // Of a block that was traced: where the walks of what is left begin, or null: at the root.
  const ShaftCut* CutOf(size_t b) const {
    return states_[b] == State::kRoot ? nullptr : &rests_[b].cut;
  }
  // The points found not to see sample s: bit i % 16 of bits[i / 16] for point i, as many bits as a
  // block has. Returns how many.
  size_t Bits(size_t s, size_t b, uint16_t* bits) const;
  // What that cost, by sample.
  const WalkStats& share(size_t b) const { return shares_[b]; }
  // By point, what answered it, where that is recorded.
  const AnsweredBy* answered_by(size_t b) const { return answered_by_.data() + b * kBlockRays; }

 private:
  // kCut: rests_ has what is left to walk; kAnswered: nothing is.
  enum class State : uint8_t { kNew, kRoot, kCut, kAnswered };

  size_t blocks() const { return (points_ + kBlockRays - 1) / kBlockRays; }

  const IndexedGeometry& scene_;
  const QueryRun& run_;
  const PointRowKernels& rows_;
  const HitKind kind_;
  const std::span<const LightSample> samples_;
  size_t points_ = 0;
  // Samples begin_ .. end_ are asked about together: light_, if fitted_begin_ and fitted_end_ are
  // the same.
  size_t begin_ = 0, end_ = 0, fitted_begin_ = 0, fitted_end_ = 0;
  bool begun_ = false;
  LightHull light_;
  ShaftCut cut_;  // Of all blocks, or group_cut_ null.
  const ShaftCut* group_cut_ = nullptr;
  // By block.
  std::vector<State> states_;
  std::vector<HullRest> rests_;
  std::vector<WalkStats> shares_;
  // By point: bit k says that it is not seen by sample begin_ + k; and what answered it.
  AlignedVector<uint16_t> blocked_;
  std::vector<AnsweredBy> answered_by_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_GROUP_HULLS_H_
