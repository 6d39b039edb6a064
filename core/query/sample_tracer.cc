// SPDX-License-Identifier: Apache-2.0
#include "core/query/sample_tracer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>

#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// What a triangle covers is counted by as many rays (WalkStats).
constexpr uint64_t kCoverRays = 16;

// Blocks of a group, of kGroupBlocks, that nothing has come near of for the next one to be asked
// about as a whole. Of fewer, what it finds costs as much to find (core/traverse/EXPERIMENTS.md).
constexpr size_t kMostlyClear = 8;

// Blocks that follow one another, a row of a tile, whose shafts share a seed. With all of a group's
// they are half a percent slower (core/traverse/EXPERIMENTS.md).
constexpr size_t kSeedBlocks = 4;

// Steps by which points to come are asked for between two walks.
constexpr int kStepsBetween = 6;

static_assert(kGroupBlocks * 16 <= RayPacket::kMaxRays, "a group's boxes are a shaft's blocks");

// Whether a walk came to no triangle that might have blocked a ray.
bool MetNothing(const WalkStats& before, const WalkStats& after) {
  return after.triangle_tests == before.triangle_tests && after.shaft.covers == before.shaft.covers;
}

// WalkChoice::Growth of a block whose points, seen from their sample, are in this box.
float GrowthOf(const Box3f& box, const LightSample& sample) {
  const Vec3f diagonal = box.hi - box.lo, way = sample.value - (box.lo + box.hi) * 0.5f;
  const float squared = Dot(diagonal, diagonal);
  return WalkChoice::Growth(sample.directional ? squared : squared / Dot(way, way));
}

}  // namespace

size_t SampleTracer::GroupPoints() const {
  if (run_.options().strategy != Strategy::kRtt) return kGroupRays;
  const size_t tile = RttTileRays(run_.options().rtt_antialiasing);
  return kGroupRays / tile * tile;
}

void SampleTracer::SetPoints(std::span<const Vec3f> positions, std::span<const uint32_t> sources,
                             std::span<const uint32_t> tile_ends) {
  SIGHTLINE_CHECK_LE(positions.size(), static_cast<size_t>(kGroupRays));
  if (!sources.empty()) SIGHTLINE_CHECK_EQ(positions.size(), sources.size());
  if (!tile_ends.empty()) SIGHTLINE_CHECK_EQ(size_t{tile_ends.back()}, positions.size());
  positions_ = positions;
  sources_ = sources;
  tile_ends_ = tile_ends;
  packets_ready_ = parallel_ready_ = false;
  boxes_known_.fill(false);
  grounds_.SetPoints(positions, sources);
  hulls_.SetPoints(positions.size());
  if (record_answered_by_) answered_by_.resize(positions.size());
}

int SampleTracer::LayOut(const LightSample& sample, size_t block, float* x, float* y, float* z,
                         uint32_t* sources) {
  const size_t first = block * kBlockRays;
  const size_t count = std::min<size_t>(kBlockRays, positions_.size() - first);
  LayOut(sample, first, count, x, y, z, sources, &boxes_[block]);
  boxes_known_[block] = t_min_ == 0;  // Else the ends depend on the sample.
  return static_cast<int>(count);
}

const Box3f& SampleTracer::BoxOf(size_t block) {
  if (!std::exchange(boxes_known_[block], true)) {
    rows_.box(positions_.subspan(block * kBlockRays, PointsOf(block)),
              coming_.Take(PointsOf(block)), &boxes_[block]);
  }
  return boxes_[block];
}

// A segment's point end is moved toward the light by t_min, in double, rounded once.
void SampleTracer::LayOut(const LightSample& sample, size_t first, size_t count, float* x, float* y,
                          float* z, uint32_t* sources, Box3f* box) const {
  if (sources == nullptr) {
    // Not wanted.
  } else if (sources_.empty()) {
    std::fill_n(sources, count, kNoTriangle);
  } else {
    std::copy_n(sources_.data() + first, count, sources);
  }
  const std::span<const Vec3f> points = positions_.subspan(first, count);
  if (t_min_ == 0) return rows_.split(points, x, y, z, box);
  const Vec3d toward = ToDouble(sample.value);
  *box = {};
  for (size_t i = 0; i < count; ++i) {
    const Vec3d d = ToDouble(points[i]);
    const Vec3f p = ToFloat(d + (sample.directional ? toward : toward - d) * t_min_);
    x[i] = p.x;
    y[i] = p.y;
    z[i] = p.z;
    box->Extend(p);
  }
}

void SampleTracer::FetchMeanwhile(std::span<const Vec3f> positions,
                                  std::span<const uint32_t> sources,
                                  std::span<const uint8_t> valid) {
  coming_ = GradualFetch(positions, sources, valid);
  // No farther than another call before these points can have come: where the same points are put
  // to a light again, what it had come to at their end says nothing of their beginning.
  coming_.Resume(hints_.fetched, Ahead(kMostAhead, kGroupBlocks) + GradualFetch::kPointsAtOnce);
  coming_.Until(Ahead(kLeastAhead, 0));
}

size_t SampleTracer::Ahead(size_t groups, size_t b) const {
  // Where a group has many walks, what is fetched long before them would be gone again.
  return (samples_.size() == 1 ? groups * kGroupRays : 0) + (b + 1) * kBlockRays;
}

void SampleTracer::FetchSome() {
  for (int i = 0; i < kStepsBetween; ++i) coming_.Some();
}

absl::Status SampleTracer::Trace(size_t s) {
  const LightSample& sample = samples_[s];
  SIGHTLINE_CHECK(sample.valid);
  SL_RETURN_IF_ERROR(run_.Poll());
  rays_ += positions_.size();
  by_bits_.fill(false);
  const uint32_t mask = run_.options().mask & sample.mask;
  const Strategy strategy =
      ChooseStrategy(run_, sample.directional ? RayForm::kParallel : RayForm::kOneOrigin, kind_,
                     positions_.size());
  StatsScope scope(stats_, strategy, positions_.size());
  const bool answered = strategy == Strategy::kShaft && AskGrounds(s, mask, &scope);
  absl::Status traced = answered ? absl::OkStatus() : TraceByWalks(s, mask, strategy, &scope);
  known_points_.fill(0);
  clear_.fill(nullptr);
  if (!coming_.empty()) hints_.fetched = coming_.at();
  coming_ = GradualFetch();
  if (traced.ok() && run_.options().count_answers) CountAnswers(answered_by_, stats_);
  return traced;
}

absl::Status SampleTracer::TraceByWalks(size_t s, uint32_t mask, Strategy strategy,
                                        StatsScope* scope) {
  const LightSample& sample = samples_[s];
  if (strategy == Strategy::kRtt) return TraceTiles(sample, mask, scope);
  if (!sample.directional) return TraceSegments(s, mask, strategy, scope);
  if (strategy == Strategy::kShaft || strategy == Strategy::kPacket) {
    return TraceParallel(s, mask, strategy, scope);
  }
  return TraceOneByOne(sample, mask, strategy, scope->walk());
}

bool SampleTracer::AskGrounds(size_t s, uint32_t mask, StatsScope* scope) {
  // The samples of an area light have a walk for all of them.
  const bool by_hull =
      !samples_[s].directional && samples_of_[light_of_[s]] >= GroupHulls::kLeastSamples;
  if (!AsTheyAre() || by_hull || !grounds_.Help(samples_[s], mask, scope->walk())) return false;
  // One triangle before all points is looked for first: that takes no look at any of them.
  const size_t covered = CoverBlocks(s, 0, mask, scope);
  if (covered == blocks()) return true;
  for (size_t b = 0; b < blocks(); ++b) {
    known_points_[b] = b < covered ? PointsOf(b) : grounds_.Bits(samples_[s], b, bits_[b].data());
    if (known_points_[b] < PointsOf(b)) clear_[b] = grounds_.ClearOf(samples_[s], b);
  }
  return false;
}

bool SampleTracer::GroundsAnswer(size_t b, StatsScope* scope) {
  if (known_points_[b] < PointsOf(b)) return false;
  TakeBits(b, scope);
  return true;
}

void SampleTracer::TakeBits(size_t b, StatsScope* scope) {
  by_bits_[b] = true;
  scope->Took(Strategy::kShaft);
  if (record_answered_by_) std::fill_n(AnsweredByOf(b), PointsOf(b), AnsweredBy::kShaft);
}

void SampleTracer::TakeBlocked(size_t b, Strategy walk, size_t known_points, uint32_t* triangles) {
  BlockBits& known = bits_[b];
  if (BlockedOf(walk) == nullptr) {
    if (known_points > 0) rows_.set_where(known, kSomeTriangle, triangles);
    return;
  }
  by_bits_[b] = true;
  for (size_t i = 0; i < known.size(); ++i) {
    known[i] = static_cast<uint16_t>(blocked_[i] | (known_points > 0 ? known[i] : 0));
  }
}

bool SampleTracer::CoverRange(size_t s, size_t begin, size_t end, uint32_t mask,
                              StatsScope* scope) {
  const LightSample& sample = samples_[s];
  const Kernels& kernels = run_.kernels();
  const bool parallel = sample.directional, one = end - begin == 1;
  PatchHint& patch = hints_.patches[s];
  const bool by_leaf = hints_.covered[s];
  const bool by_patch = !scene_.bvh.mates.empty() && (!one || patch.IsDue());
  if (!by_leaf && !by_patch) return false;
  const size_t first = begin * kBlockRays;
  const size_t count = std::min(end * kBlockRays, positions_.size()) - first;
  const std::span<const uint32_t> sources =
      sources_.empty() ? sources_ : sources_.subspan(first, count);
  Box3f box;
  for (size_t b = begin; b < end; ++b) box.Extend(BoxOf(b));
  FetchSome();
  uint32_t& leaf = hints_.first_leaves[s];
  bool covered = by_leaf && (parallel ? kernels.cover_parallel_points : kernels.cover_points)(
                                scene_, ChildRef::FromBits(leaf), sample.value,
                                sample.source_triangle, mask, box, sources, scope->walk());
  if (one) hints_.covered[s] = covered;
  if (!covered && by_patch) {
    patch.PutFirst(leaf);
    FetchSome();
    covered =
        (parallel ? kernels.cover_parallel_by_patch : kernels.cover_by_patch)(
            scene_, sample.value, sample.source_triangle, mask, box,
            positions_.subspan(first, count), sources, patch.leaves(), &leaf, scope->walk()) > 0;
    if (one) patch.Note(covered);
  }
  if (!covered) return false;
  for (size_t b = begin; b < end; ++b) {
    by_bits_[b] = true;
    bits_[b].fill(0xFFFF);
  }
  if (record_answered_by_) std::fill_n(AnsweredByOf(begin), count, AnsweredBy::kShaft);
  scope->walk()->shaft.covers += (count + kCoverRays - 1) / kCoverRays;
  scope->walk()->shaft.pairs += (count + kCoverRays - 1) / kCoverRays;
  scope->Took(Strategy::kShaft);
  return true;
}

size_t SampleTracer::CoverBlocks(size_t s, size_t b, uint32_t mask, StatsScope* scope) {
  if (!AsTheyAre() || hints_.first_leaves[s] == RayPacket::kNoLeaf ||
      !CoverRange(s, b, b + 1, mask, scope)) {
    return 0;
  }
  // Of two the other one has its own turn.
  return b == 0 && blocks() > 2 && CoverRange(s, 1, blocks(), mask, scope) ? blocks() : 1;
}

uint32_t SampleTracer::FindLitBlocks(size_t s, uint32_t mask, StatsScope* scope) {
  if (hints_.clear[s] < kMostlyClear || !AsTheyAre() || known_points_ != KnownPoints{}) return 0;
  for (size_t b = 0; b < blocks(); ++b) BoxOf(b);
  const uint32_t lit =
      run_.kernels().lit_boxes(scene_, samples_[s].value, samples_[s].source_triangle, mask,
                               std::span<const Box3f>(boxes_.data(), blocks()), scope->walk());
  for (uint32_t left = lit; left != 0; left &= left - 1) {
    bits_[static_cast<size_t>(std::countr_zero(left))].fill(0);
  }
  return lit;
}

void SampleTracer::NoteCovers(size_t s, const WalkStats& before, const WalkStats& after) {
  // As many as half of a packet's vectors of rays.
  hints_.covered[s] = after.shaft.covers - before.shaft.covers >= kBlockRays / kCoverRays / 2;
}

void SampleTracer::NoteBlock(size_t s, size_t b, Strategy walk, const WalkStats& before,
                             const WalkStats& after) {
  if (walk == Strategy::kShaft) {
    NoteCovers(s, before, after);
    return;
  }
  // Other walks do not tell. What made all of it dark at once may be one triangle.
  const std::span<const uint32_t> blockers(triangles(b), PointsOf(b));
  hints_.covered[s] = after.leaves - before.leaves == 1 &&
                      std::find(blockers.begin(), blockers.end(), kNoTriangle) == blockers.end();
}

absl::Status SampleTracer::TraceSegments(size_t s, uint32_t mask, Strategy strategy,
                                         StatsScope* scope) {
  const LightSample& sample = samples_[s];
  parallel_traced_ = false;
  WalkChoice& choice = hints_.walks.Of(light_of_[s], OtherWalks(run_, RayForm::kOneOrigin, kind_));
  const bool by_shafts = strategy == Strategy::kShaft;
  // With t_min the points differ from sample to sample.
  const bool by_hulls = by_shafts && samples_of_[light_of_[s]] >= GroupHulls::kLeastSamples &&
                        !choice.ShaftsAreRare() && hulls_.Find(s, /*alone=*/t_min_ != 0);
  if (by_hulls) packets_.Reserve(blocks());
  // A hull's samples are as good as one for a block's frame.
  if (!by_hulls || !seeds_by_block_ || s == hulls_.begin()) seeds_.fill({});
  seeds_by_block_ = by_hulls;
  const ShaftCut* cut = nullptr;
  // Made for the first block that a walk has to answer.
  bool prepared = false;
  uint32_t lit = 0;  // Blocks found to be so before any is walked, a bit each.
  size_t clear = 0;  // Blocks that nothing comes near of.
  const auto prepare = [&] {
    if (by_shafts && !by_hulls) lit = FindLitBlocks(s, mask, scope);
    clear = static_cast<size_t>(std::popcount(lit));
    if (clear == blocks()) return;
    packets_.Reserve(blocks());
    for (size_t b = 0; b < blocks(); ++b) {
      RayPacket& packet = packets_[b];
      packet.origin = sample.value;
      packet.segments = true;
      packet.mask = mask;
      packet.origin_source = sample.source_triangle;
      packet.answered_by = AnsweredByOf(b);
      if (!packets_ready_) {
        packet.count = LayOut(sample, b, packet.target_x, packet.target_y, packet.target_z,
                              sources_.empty() ? nullptr : packet.target_source);
      }
      packet.unasked = KnownOf(b);
      packet.clear = clear_[b];
      packet.point_box = packet.unasked == nullptr ? &boxes_[b] : nullptr;
      packet.sourceless = sources_.empty();
      packet.seed = &seeds_[by_hulls ? b : b / kSeedBlocks];
    }
    packets_ready_ = t_min_ == 0;  // Else the ends depend on the sample.
    if (by_hulls) {
      hulls_.Begin(std::span<const RayPacket>(packets_.get(), blocks()));
    } else if (by_shafts && blocks() > 1) {
      cut = CutGroup(scene_, run_, std::span<const RayPacket>(packets_.get(), blocks()), &cut_);
    }
  };
  uint32_t* const first_leaf = &hints_.first_leaves[s];
  bool next_covered = false;  // Whether the coming block has its answer.
  // As after a walk that finds all lit.
  const auto take_lit = [&](size_t b) {
    TakeBits(b, scope);
    *first_leaf = RayPacket::kNoLeaf;
    hints_.covered[s] = false;
  };
  for (size_t b = 0; b < blocks(); ++b) {
    if (std::exchange(next_covered, false)) continue;
    if ((lit >> b & 1) != 0) {
      take_lit(b);
      continue;
    }
    if (GroundsAnswer(b, scope)) continue;
    BlockBits& known = bits_[b];
    size_t known_points = known_points_[b];
    if (by_hulls && hulls_.Answers(s, b)) {
      hulls_.Bits(s, b, known.data());
      TakeHull(b, GrowthOf(boxes_[b], sample), &choice, scope);
      continue;
    }
    // What darkened the packet before this one, or this one before, for the light's last sample.
    if (by_hulls && s != hulls_.begin() && packets_[b].first_leaf != RayPacket::kNoLeaf) {
      *first_leaf = packets_[b].first_leaf;
    }
    if (by_shafts) {
      if (const size_t covered = CoverBlocks(s, b, mask, scope); covered > 0) {
        for (size_t i = b; by_hulls && i < b + covered; ++i) packets_[i].first_leaf = *first_leaf;
        b += covered - 1;
        continue;
      }
    }
    if (!std::exchange(prepared, true)) prepare();
    if ((lit >> b & 1) != 0) {
      take_lit(b);
      continue;
    }
    packets_[b].first_leaf = *first_leaf;
    const float growth = GrowthOf(boxes_[b], sample);
    const Strategy walk = by_shafts ? choice.Next(growth) : strategy;
    if (by_hulls) {
      if (hulls_.IsNew(b)) {
        SL_RETURN_IF_ERROR(TraceHull(s, b, walk == Strategy::kShaft, scope));
      }
      known_points = hulls_.Bits(s, b, known.data());
      if (hulls_.Answers(s, b) || known_points == PointsOf(b)) {
        TakeHull(b, growth, &choice, scope);
        continue;
      }
      cut = hulls_.CutOf(b);
    }
    const bool pair = walk == Strategy::kShaft && !by_hulls && MayPair(b, lit);
    if (pair) next_covered = CoverBlocks(s, b + 1, mask, scope) > 0;
    const WalkStats before = *scope->walk();
    if (pair && !next_covered) {
      if (TracePair(b, cut, scope)) {
        const WalkStats& after = *scope->walk();
        cycles_ += choice.Learn(walk, before, after, 2 * kBlockRays, growth);
        *first_leaf = packets_[b].first_leaf;
        NoteBlock(s, b, walk, before, after);
        clear += MetNothing(before, after) ? 2 : 0;
        ++b;
        continue;
      }
      SL_RETURN_IF_ERROR(run_.Poll());
    }
    SL_RETURN_IF_ERROR(FetchWhile(b, &packets_[b], [&](RayPacket* packet) {
      if (by_hulls) packet->unasked = known_points > 0 ? known.data() : nullptr;
      packet->blocked = BlockedOf(walk);
      absl::Status traced = TracePacketBlock(scene_, run_, kind_, walk, packet, cut, scope->walk());
      packet->unasked = nullptr;
      packet->blocked = nullptr;
      return traced;
    }));
    if (known_points > 0 && record_answered_by_) MarkKnown(b, known, by_hulls);
    TakeBlocked(b, walk, known_points, packets_[b].triangle);
    scope->Took(walk);
    if (by_shafts) {
      WalkStats after = *scope->walk();
      if (by_hulls && walk == Strategy::kShaft) {
        after.nodes += hulls_.share(b).nodes;
        after.leaves += hulls_.share(b).leaves;
        after.triangle_tests += hulls_.share(b).triangle_tests;
      }
      cycles_ += choice.Learn(walk, before, after, PointsOf(b) - known_points_[b], growth);
    }
    *first_leaf = packets_[b].first_leaf;
    NoteBlock(s, b, walk, before, *scope->walk());
    clear += MetNothing(before, *scope->walk()) ? 1 : 0;
  }
  // What needed no walk, as what was dark as a whole, says that something is near.
  hints_.clear[s] = static_cast<uint8_t>(prepared ? clear * kGroupBlocks / blocks() : 0);
  return absl::OkStatus();
}

absl::Status SampleTracer::TraceHull(size_t s, size_t b, bool by_shaft, StatsScope* scope) {
  const WalkStats before = *scope->walk();
  bool walked = false;
  SL_RETURN_IF_ERROR(FetchWhile(b, &packets_[b], [&](RayPacket* packet) {
    walked = hulls_.Trace(b, by_shaft, packet, scope->walk());
    packet->origin = samples_[s].value;
    return run_.Poll();
  }));
  if (!walked) return absl::OkStatus();
  for (size_t i = hulls_.begin(); i < hulls_.end(); ++i) {
    hints_.first_leaves[i] = packets_[b].first_leaf;
    NoteCovers(i, before, *scope->walk());
  }
  return absl::OkStatus();
}

void SampleTracer::TakeHull(size_t b, float growth, WalkChoice* choice, StatsScope* scope) {
  by_bits_[b] = true;
  scope->Took(Strategy::kShaft);
  cycles_ += choice->Learn(Strategy::kShaft, {}, hulls_.share(b), PointsOf(b), growth);
  if (record_answered_by_) {
    std::copy_n(hulls_.answered_by(b), PointsOf(b), AnsweredByOf(b));
  }
}

void SampleTracer::MarkKnown(size_t b, const BlockBits& known, bool by_hull) {
  for (size_t i = 0; i < kBlockRays; ++i) {
    if ((known[i / 16] >> (i % 16) & 1) == 0) continue;
    answered_by_[b * kBlockRays + i] = by_hull ? hulls_.answered_by(b)[i] : AnsweredBy::kShaft;
  }
}

absl::Status SampleTracer::TraceParallel(size_t s, uint32_t mask, Strategy strategy,
                                         StatsScope* scope) {
  const LightSample& sample = samples_[s];
  uint32_t* const first_leaf = &hints_.first_leaves[s];
  parallel_traced_ = true;
  const bool by_shafts = strategy == Strategy::kShaft;
  WalkChoice& choice = hints_.walks.Of(light_of_[s], OtherWalks(run_, RayForm::kParallel, kind_));
  seeds_.fill({});
  bool laid_out = false;
  const auto lay_out = [&] {
    parallel_.Reserve(blocks());
    for (size_t b = 0; b < blocks(); ++b) {
      ParallelPacket& packet = parallel_[b];
      packet.direction = sample.value;
      packet.mask = mask;
      packet.direction_source = sample.source_triangle;
      packet.answered_by = AnsweredByOf(b);
      if (!parallel_ready_) {
        packet.count = LayOut(sample, b, packet.origin_x, packet.origin_y, packet.origin_z,
                              sources_.empty() ? nullptr : packet.origin_source);
      }
      packet.unasked = KnownOf(b);
      packet.clear = clear_[b];
      packet.point_box = packet.unasked == nullptr ? &boxes_[b] : nullptr;
      packet.sourceless = sources_.empty();
      packet.seed = &seeds_[b / kSeedBlocks];
    }
    parallel_ready_ = t_min_ == 0;
  };
  // Made before the first shaft, however rare they are: one asked again without it would cost more
  // than any to come, and never be taken.
  const ShaftCut* cut = nullptr;
  bool prepared = blocks() == 1;
  for (size_t b = 0; b < blocks(); ++b) {
    if (GroundsAnswer(b, scope)) continue;
    if (by_shafts) {
      if (const size_t covered = CoverBlocks(s, b, mask, scope); covered > 0) {
        b += covered - 1;
        continue;
      }
    }
    if (!std::exchange(laid_out, true)) lay_out();
    parallel_[b].first_leaf = *first_leaf;
    const float growth = GrowthOf(boxes_[b], sample);
    const Strategy walk = by_shafts ? choice.Next(growth) : strategy;
    if (walk == Strategy::kShaft && !std::exchange(prepared, true)) {
      cut =
          CutGroup(scene_, run_, std::span<const ParallelPacket>(parallel_.get(), blocks()), &cut_);
    }
    const WalkStats before = *scope->walk();
    SL_RETURN_IF_ERROR(FetchWhile(b, &parallel_[b], [&](ParallelPacket* packet) {
      packet->blocked = BlockedOf(walk);
      absl::Status traced = TraceParallelBlock(scene_, run_, walk, packet, cut, scope->walk());
      packet->blocked = nullptr;
      return traced;
    }));
    if (known_points_[b] > 0 && record_answered_by_) MarkKnown(b, bits_[b], /*by_hull=*/false);
    TakeBlocked(b, walk, known_points_[b], parallel_[b].triangle);
    scope->Took(walk);
    if (by_shafts) {
      cycles_ += choice.Learn(walk, before, *scope->walk(), PointsOf(b) - known_points_[b], growth);
    }
    *first_leaf = parallel_[b].first_leaf;
    NoteBlock(s, b, walk, before, *scope->walk());
  }
  return absl::OkStatus();
}

absl::Status SampleTracer::TraceOneByOne(const LightSample& sample, uint32_t mask,
                                         Strategy strategy, WalkStats* stats) {
  parallel_traced_ = false;
  packets_ready_ = false;
  std::fill(answered_by_.begin(), answered_by_.end(), AnsweredBy::kRay);
  packets_.Reserve(blocks());
  std::array<TraceRay, kBlockRays> rays;
  std::array<Hit, kBlockRays> hits;
  for (size_t b = 0; b < blocks(); ++b) {
    RayPacket& packet = packets_[b];
    packet.count =
        LayOut(sample, b, packet.target_x, packet.target_y, packet.target_z, packet.target_source);
    for (int i = 0; i < packet.count; ++i) {
      rays[i] = {.ray = PredicateRay::Ray(packet.target(i), sample.value),
                 .mask = mask,
                 .from_source = packet.target_source[i],
                 .to_source = sample.source_triangle};
    }
    SL_RETURN_IF_ERROR(TraceRayBlock(scene_, run_, kind_, strategy,
                                     std::span<const TraceRay>(rays.data(), packet.count), hits,
                                     stats));
    for (int i = 0; i < packet.count; ++i) {
      packet.t[i] = hits[i].t;
      packet.triangle[i] = hits[i].triangle;
    }
  }
  return absl::OkStatus();
}

void SampleTracer::CopyLit(uint8_t* bits) const {
  for (size_t b = 0; b < blocks(); ++b) {
    const size_t first = b * kBlockRays;
    const size_t count = std::min<size_t>(kBlockRays, positions_.size() - first);
    if (!by_bits_[b]) {
      rows_.free_bits({triangles(b), count}, bits + first / 8);
      continue;
    }
    // By words, as they are copied: what is stored in parts is not there yet for a whole load.
    std::array<uint64_t, kBlockRays / 64> lit;
    static_assert(sizeof(lit) == sizeof(BlockBits));
    std::memcpy(lit.data(), bits_[b].data(), sizeof(lit));
    for (uint64_t& word : lit) word = ~word;
    if (count < kBlockRays) lit[count / 64] &= (uint64_t{1} << count % 64) - 1;
    std::memcpy(bits + first / 8, lit.data(), (count + 7) / 8);  // Little-endian.
  }
}

}  // namespace sightline
