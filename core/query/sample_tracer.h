// SPDX-License-Identifier: Apache-2.0
//
// A group of points, put to one light sample after another: what ComputeShadows and the lit outputs
// of tiles share. The points are laid out once for all samples, in blocks that walk as one; the
// blocks of a group begin their walks together. Internal to core/query.
//
// Thread safety: belongs to one thread.
//
//   SampleTracer tracer(scene, run, HitKind::kAny, /*t_min=*/0, samples, &stats);
//   tracer.SetPoints(positions, sources);
//   SL_RETURN_IF_ERROR(tracer.Trace(/*s=*/0));
//   ... tracer.triangle(i) == kNoTriangle: point i is lit.
#ifndef SIGHTLINE_CORE_QUERY_SAMPLE_TRACER_H_
#define SIGHTLINE_CORE_QUERY_SAMPLE_TRACER_H_

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "absl/container/inlined_vector.h"
#include "absl/status/status.h"
#include "core/accel/indexed_geometry.h"
#include "core/light/light.h"
#include "core/query/group_grounds.h"
#include "core/query/group_hulls.h"
#include "core/query/packet_store.h"
#include "core/query/point_rows.h"
#include "core/query/query_run.h"
#include "core/query/ray_block.h"
#include "core/query/shadows.h"
#include "core/traverse/gradual_fetch.h"
#include "core/traverse/shaft_cut.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

class SampleTracer {
 public:
  // `t_min` as in ShadowOptions. `hints`: what another tracer of the same scene and samples left,
  // by which walks begin, or nothing. What is referred to must outlive the tracer.
  SampleTracer(const IndexedGeometry& scene, const QueryRun& run, HitKind kind, double t_min,
               std::span<const LightSample> samples, QueryStats* stats, ShadowHints hints = {})
      : scene_(scene),
        run_(run),
        rows_(PointRowKernelsFor(run.options().simd)),
        grounds_(scene, run, samples.size()),
        hulls_(scene, run, kind, samples),
        kind_(kind),
        t_min_(t_min),
        samples_(samples),
        stats_(stats),
        record_answered_by_(run.options().count_answers),
        hints_(std::move(hints)),
        light_of_(samples.size()) {
    if (hints_.first_leaves.empty()) {
      hints_.first_leaves.assign(samples.size(), RayPacket::kNoLeaf);
      hints_.covered.assign(samples.size(), false);
      hints_.patches.assign(samples.size(), {});
      hints_.clear.assign(samples.size(), 0);
    }
    for (size_t s = 1; s < samples.size(); ++s) {
      light_of_[s] = light_of_[s - 1] + (samples[s].light != samples[s - 1].light);
    }
    samples_of_.resize(samples.empty() ? 0 : size_t{light_of_.back()} + 1);
    for (const uint32_t light : light_of_) ++samples_of_[light];
  }

  // As many points as are best given together: kGroupRays, or for kRtt as many as whole tiles are.
  size_t GroupPoints() const;

  // At most kGroupRays points, all valid, and their source triangles, or none of these.
  // `tile_ends`, read for kRtt alone: where each tile's points end, none of them more than a tile
  // has rays (core/traverse/rtt.h); empty: as many as it has are one. All is kept by reference
  // until the next call.
  void SetPoints(std::span<const Vec3f> positions, std::span<const uint32_t> sources,
                 std::span<const uint32_t> tile_ends = {});

  // What is to be read next, of points to come: fetched bit by bit while the coming sample's blocks
  // are asked about. Kept by reference until then.
  void FetchMeanwhile(std::span<const Vec3f> positions, std::span<const uint32_t> sources,
                      std::span<const uint8_t> valid);

  // Sample s. One that is a point starts the segments, one that is a direction is what rays from
  // the points run toward. REQUIRES: it is valid. On success triangle(i) is the first blocker of
  // point i or, for kAny, kNoTriangle where it has none. Samples of one light share work when they
  // are asked about in turn.
  absl::Status Trace(size_t s);

  // From now on answered_by(i) says what answered point i of the last sample.
  void RecordAnsweredBy() { record_answered_by_ = true; }
  AnsweredBy answered_by(size_t i) const { return answered_by_[i]; }

  // For the next tracer.
  ShadowHints ReleaseHints() { return std::move(hints_); }  // The last call.

  // About how many cycles a ray has taken, of all that were traced: 0 where a strategy was asked
  // for, nothing where there was no ray.
  std::optional<float> RayCost() const {
    if (rays_ == 0) return std::nullopt;
    return static_cast<float>(cycles_ / static_cast<double>(rays_));
  }

  size_t count() const { return positions_.size(); }
  uint32_t triangle(size_t i) const {
    const size_t b = i / kBlockRays, lane = i % kBlockRays;
    if (!by_bits_[b]) return triangles(b)[lane];
    return (bits_[b][lane / 16] >> (lane % 16) & 1) != 0 ? kSomeTriangle : kNoTriangle;
  }
  // kClosest only.
  float t(size_t i) const { return packets_[i / kBlockRays].t[i % kBlockRays]; }
  // Bit i % 8 of bits[i / 8] is set where point i is lit; bits past the last point are 0.
  // (count() + 7) / 8 bytes.
  void CopyLit(uint8_t* bits) const;

 private:
  // What calls for one light are made of, or for a few: no memory is taken for them.
  static constexpr size_t kFewSamples = 4;
  // Stands for whatever triangle blocks a ray, where it is not told which.
  static constexpr uint32_t kSomeTriangle = 0;
  // How far ahead of the points that are read those to come are asked for, in groups: walks, which
  // take time, ask for what groups that need none will read; what is asked for between walks, which
  // stops a core sooner, is the next group's alone. Two groups, or eight, are as good to half a
  // percent (core/traverse/EXPERIMENTS.md).
  static constexpr size_t kMostAhead = 4, kLeastAhead = 1;
  using BlockBits = std::array<uint16_t, kBlockRays / 16>;  // By point.

  size_t blocks() const { return (positions_.size() + kBlockRays - 1) / kBlockRays; }
  size_t PointsOf(size_t block) const {
    return std::min<size_t>(kBlockRays, positions_.size() - block * kBlockRays);
  }
  // Whether points may be answered together, where they lie, by any blocker.
  bool AsTheyAre() const { return kind_ == HitKind::kAny && t_min_ == 0; }
  // RayPacket::unasked of a block.
  const uint16_t* KnownOf(size_t block) const {
    return known_points_[block] > 0 ? bits_[block].data() : nullptr;
  }
  const uint32_t* triangles(size_t block) const {
    return parallel_traced_ ? parallel_[block].triangle : packets_[block].triangle;
  }
  // Finds which points their grounds hide from the sample, as far as grounds help; or that it is
  // answered without: returns true.
  bool AskGrounds(size_t s, uint32_t mask, StatsScope* scope);
  // Answers block b if they hide all of its points.
  bool GroundsAnswer(size_t b, StatsScope* scope);
  // Where a walk says by bits what it finds; null: it says which triangles.
  uint16_t* BlockedOf(Strategy walk) {
    return walk == Strategy::kShaft && kind_ == HitKind::kAny ? blocked_.data() : nullptr;
  }
  // Takes what a walk has said of block b, of which so many points were known in bits_ before it.
  void TakeBlocked(size_t b, Strategy walk, size_t known_points, uint32_t* triangles);
  // Answers block b by its bits alone.
  void TakeBits(size_t b, StatsScope* scope);
  absl::Status TraceByWalks(size_t s, uint32_t mask, Strategy strategy, StatsScope* scope);
  absl::Status TraceSegments(size_t s, uint32_t mask, Strategy strategy, StatsScope* scope);
  // By tiles of kRtt, which need not divide blocks.
  absl::Status TraceTiles(const LightSample& sample, uint32_t mask, StatsScope* scope);
  // Answers blocks begin .. end - 1 if what darkened those before them, a triangle or two of a leaf
  // or a patch, blocks all of their points.
  bool CoverRange(size_t s, size_t begin, size_t end, uint32_t mask, StatsScope* scope);
  // Answers so blocks from b on, of sample s: none, that one, or, if it is the first, all at once.
  // Returns how many.
  size_t CoverBlocks(size_t s, size_t b, uint32_t mask, StatsScope* scope);
  // Around the points of a block, as they lie.
  const Box3f& BoxOf(size_t block);
  // How many of the points to come may be asked for while block b is, so many groups ahead.
  size_t Ahead(size_t groups, size_t b) const;
  // A few of them, while no walk is under way.
  void FetchSome();
  // walk(packet) of a block, or of some up to `last`, while some are asked for.
  template <class Packet, class Walk>
  auto FetchWhile(size_t last, Packet* packet, const Walk& walk) {
    coming_.Until(Ahead(kMostAhead, last));
    packet->meanwhile = &coming_;
    auto traced = walk(packet);
    packet->meanwhile = nullptr;
    coming_.Until(Ahead(kLeastAhead, last));
    FetchSome();
    return traced;
  }
  // If nothing came near most blocks of the last group, asks about all of this one at once: those
  // that sample s certainly reaches all of, a bit each, with their bits. 0 where some points are
  // known.
  uint32_t FindLitBlocks(size_t s, uint32_t mask, StatsScope* scope);
  // Takes note of whether a block's walk met a triangle that blocks most of it.
  void NoteCovers(size_t s, const WalkStats& before, const WalkStats& after);
  // The same of any walk that block b was just asked about by.
  void NoteBlock(size_t s, size_t b, Strategy walk, const WalkStats& before,
                 const WalkStats& after);
  // Whether blocks b and b + 1 may walk as one shaft: both are whole, all of their points are asked
  // about, and neither is among the `lit` ones, a bit each. REQUIRES: their packets are laid out.
  bool MayPair(size_t b, uint32_t lit) const;
  // Answers them so. False: it answers neither, or the call is to stop.
  bool TracePair(size_t b, const ShaftCut* cut, StatsScope* scope);
  // Puts all samples of the hull to block b at once (GroupHulls::Trace).
  absl::Status TraceHull(size_t s, size_t b, bool by_shaft, StatsScope* scope);
  // Answers block b for a sample by what its hull found, which is in bits_, alone.
  void TakeHull(size_t b, float growth, WalkChoice* choice, StatsScope* scope);
  // What answered such points of a block, where it is recorded.
  void MarkKnown(size_t b, const BlockBits& known, bool by_hull);
  absl::Status TraceParallel(size_t s, uint32_t mask, Strategy strategy, StatsScope* scope);
  absl::Status TraceOneByOne(const LightSample& sample, uint32_t mask, Strategy strategy,
                             WalkStats* stats);
  // Where a block's packet says it; null where it is not recorded.
  AnsweredBy* AnsweredByOf(size_t block) {
    return record_answered_by_ ? answered_by_.data() + block * kBlockRays : nullptr;
  }
  // The points of a block, or some, as the ends of segments, or origins of rays, of `sample`: of a
  // block how many, with the box around them in boxes_; of some with that box.
  int LayOut(const LightSample& sample, size_t block, float* x, float* y, float* z,
             uint32_t* sources);
  void LayOut(const LightSample& sample, size_t first, size_t count, float* x, float* y, float* z,
              uint32_t* sources, Box3f* box) const;

  const IndexedGeometry& scene_;
  const QueryRun& run_;
  const PointRowKernels& rows_;
  GroupGrounds grounds_;
  GroupHulls hulls_;
  const HitKind kind_;
  const double t_min_;
  const std::span<const LightSample> samples_;
  QueryStats* const stats_;
  std::span<const Vec3f> positions_;
  std::span<const uint32_t> sources_, tile_ends_;
  GradualFetch coming_;
  // Rows hold the points of this group.
  bool packets_ready_ = false, parallel_ready_ = false;
  // Where the last results are: a block's in its packet, or in bits alone, of the points blocked.
  bool parallel_traced_ = false;
  std::array<bool, kGroupBlocks> by_bits_ = {};
  std::array<BlockBits, kGroupBlocks> bits_;
  BlockBits blocked_;  // Of the block that is being walked for.
  // How many of a block's points the grounds hide from the sample that is being asked about: bits_
  // has them before its walk.
  using KnownPoints = std::array<size_t, kGroupBlocks>;
  KnownPoints known_points_ = {};
  std::array<const ClearToward*, kGroupBlocks> clear_ = {};  // By block, as packets'.
  bool record_answered_by_;
  std::vector<AnsweredBy> answered_by_;  // By point, where it is recorded.
  // By block; reserved when first needed, and then as they happen to be.
  PacketStore<RayPacket> packets_;
  PacketStore<ParallelPacket> parallel_;
  std::array<Box3f, kGroupBlocks> boxes_;            // Around the points of either.
  std::array<bool, kGroupBlocks> boxes_known_ = {};  // Whether they are around points as they lie.
  // One for several small tiles, or those of a large one; made when first needed.
  std::unique_ptr<RayPacket[]> tile_packets_;
  std::vector<AnsweredBy> tile_answered_by_;  // By lane of these, where it is recorded.
  ShaftCut cut_;
  // By block of a hull's samples, or of one sample by so many blocks.
  std::array<ShaftSeed, kGroupBlocks> seeds_;
  bool seeds_by_block_ = false;
  ShadowHints hints_;  // RayPacket::first_leaf of each sample's next packet; what blocked its last.
  double cycles_ = 0;  // What WalkChoice has learned.
  uint64_t rays_ = 0;
  // By sample: how many lights came before its own; and by that how many samples it has.
  absl::InlinedVector<uint32_t, kFewSamples> light_of_, samples_of_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_SAMPLE_TRACER_H_
