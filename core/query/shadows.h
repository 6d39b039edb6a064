// SPDX-License-Identifier: Apache-2.0
//
// Light samples × points: does anything stand between them? A segment starts at a light's sample
// and ends at the point (toward a directional light it starts at the point and has no end).
//
// Thread safety: functions only. ComputeShadows runs in the caller's thread over the points given;
// a caller with many cuts them into ranges and runs those side by side. Results do not depend on
// the cut.
//
//   ShadowResult result;
//   absl::Status status = ComputeShadows(*scene, PointRange::All(points), samples, {}, {}, {.bits =
//   true}, {},
//                                        &result);
#ifndef SIGHTLINE_CORE_QUERY_SHADOWS_H_
#define SIGHTLINE_CORE_QUERY_SHADOWS_H_

#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "core/accel/indexed_geometry.h"
#include "core/light/light.h"
#include "core/query/options.h"
#include "core/query/patch_hint.h"
#include "core/query/points.h"
#include "core/query/walk_choice.h"
#include "core/traverse/answered_by.h"

namespace sightline {

// The most points of one call, which numbers them in 31 bits.
inline constexpr uint64_t kMaxShadowPoints = 0x7FFFFFFF;

struct PointRange {
  std::span<const Vec3f> positions;
  std::span<const uint32_t> sources;  // By point, or empty: no point names a triangle.
  // By point, 0 or 1, or empty: all of them are valid, and so finite. Who knows that spares a light
  // a hundredth of its time, in which flags come from memory.
  std::span<const uint8_t> valid;

  static PointRange All(const PreparedPoints& points) {
    return {points.positions, points.sources, points.valid};
  }
  static PointRange Slice(const PreparedPoints& points, size_t begin, size_t count) {
    return {std::span(points.positions).subspan(begin, count),
            std::span(points.sources).subspan(begin, count),
            std::span(points.valid).subspan(begin, count)};
  }
};

// Where walks toward each sample last found a blocker: tried first for the next points, which are
// their neighbours. And what these cost, by which AUTO chooses how to walk for them, and whether it
// pays to bring them into an order of their own. Of one set of samples; empty at first. Handed to
// another scene or revision, they begin afresh.
struct ShadowHints {
  uint64_t bvh = 0;                    // Whose leaves they are: its number; 0: nobody's yet.
  std::vector<uint32_t> first_leaves;  // By sample.
  std::vector<uint8_t> covered;        // Whether one triangle there blocked many points at once.
  std::vector<PatchHint> patches;      // By sample.
  std::vector<uint8_t> clear;          // By sample: how many of a group's blocks nothing came near.
  WalkChoices walks;                   // By light, counted from 0.
  float ray_cost = 0;                  // Cycles a ray, about, in the order given; 0: not known.
  uintptr_t fetched = 0;               // Up to which address points to come were fetched; compared
                                       // with those of the next call's, never followed.
};

struct ShadowOptions {
  // Segments end this share of their length before the point: in [0, 1). The shortened end is the
  // double P + t_min·(L − P), rounded once; for directional lights the start is P + t_min·D.
  double t_min = 0;
  // Speed alone, for points that are handed over bit by bit. The points come as neighbours already:
  // no other order is looked for.
  bool ordered = false;
  // What the points before these left behind, taken over and left to those that follow; may be
  // null. After Cancelled and DeadlineExceeded they are empty: nothing is known of the next points.
  ShadowHints* hints = nullptr;
  // The points that come next, in that order: those of the call to come and, where they are known
  // and lie behind each other, of those after it. Some of them, up to four groups of 4,096, are
  // brought into the cache while those of this call are walked for, which takes less than waiting
  // for them: where points lie in memory, that is a tenth of a light's time, and half of it where
  // next to no walk is needed. Hints say up to where that was done. May be empty, and need only
  // outlive this call.
  PointRange next = {};
};

struct ShadowOutputs {
  bool bits = true;     // Lit or not, per sample and point.
  bool counts = false;  // Per point: how many samples reach it.
  bool weighted_sums =
      false;  // Per point: the weights of the samples that reach it, summed in sample order.
  bool blockers =
      false;  // Per sample and point: the first triangle from the segment's start, and where.
  bool answered_by = false;  // Per sample and point: what answered.
};

// n points, s samples. Points or samples that are invalid count as not lit in sums; their validity
// is the caller's to report (PointRange::valid, LightSample::valid). Bits of invalid pairs are 0.
struct ShadowResult {
  std::vector<uint8_t> lit_bits;        // s rows of (n + 7) / 8 bytes.
  std::vector<uint32_t> lit_counts;     // n.
  std::vector<double> weighted_sums;    // n.
  std::vector<uint32_t> blocker;        // s · n global ids, kNoTriangle where lit or invalid.
  std::vector<float> blocker_t;         // s · n, +inf where lit or invalid; share of the segment.
  std::vector<AnsweredBy> answered_by;  // s · n, kNoRay where invalid.
  QueryStats stats;
};

// `weights`: one per sample where weighted sums are asked for, else not read. InvalidArgument: more
// than kMaxShadowPoints points, lengths that differ, hints of another number of samples, t_min out
// of range (each named with its value); what CheckOptions says of the options. Cancelled /
// DeadlineExceeded. On an error the result holds nothing. What it held before is lost; its memory
// serves again.
absl::Status ComputeShadows(const IndexedGeometry& scene, const PointRange& points,
                            std::span<const LightSample> samples, std::span<const double> weights,
                            const ShadowOptions& shadow, const ShadowOutputs& outputs,
                            const QueryOptions& options, ShadowResult* result);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_SHADOWS_H_
