// SPDX-License-Identifier: Apache-2.0
//
// Segments with two ends of their own: blocked or free, and by what first, counted from `from`.
//
// Thread safety: functions only. TestSegments runs in the caller's thread.
//
//   PreparedSegments segments;
//   absl::Status s = PrepareSegments(*scene, ends, {}, {}, &segments);
//   SegmentResult result;
//   s = TestSegments(*scene, segments, {}, {}, &result);
#ifndef SIGHTLINE_CORE_QUERY_SEGMENTS_H_
#define SIGHTLINE_CORE_QUERY_SEGMENTS_H_

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "core/accel/indexed_geometry.h"
#include "core/geometry/vec3.h"
#include "core/query/options.h"

namespace sightline {

// Stored segments: rebased in double, rounded once.
struct PreparedSegments {
  std::vector<Vec3f> from, to;
  std::vector<uint32_t> from_source, to_source;  // Global triangle id or kNoTriangle.
  std::vector<uint8_t> valid;                    // 0: an end is not finite or out of range.
  uint64_t invalid = 0;

  size_t size() const { return from.size(); }
};

// `ends[i]` is from, to in world coordinates; the sources are empty or one per segment.
// InvalidArgument: lengths that differ, a source out of range. Equal ends are valid: nothing blocks
// an empty segment. What `segments` held goes, its memory is used again.
absl::Status PrepareSegments(const IndexedGeometry& scene,
                             std::span<const std::array<Vec3d, 2>> ends,
                             std::span<const uint32_t> from_sources,
                             std::span<const uint32_t> to_sources, PreparedSegments* segments);
// Of ends that are stored values already: relative to the scene's origin, not beyond
// kMaxCoordinate. -0 counts as +0.
absl::Status PrepareStoredSegments(const IndexedGeometry& scene,
                                   std::span<const std::array<Vec3f, 2>> ends,
                                   std::span<const uint32_t> from_sources,
                                   std::span<const uint32_t> to_sources,
                                   PreparedSegments* segments);

struct SegmentOutputs {
  bool bits = true;
  bool first_hits = false;
};

struct SegmentResult {
  std::vector<uint8_t> blocked_bits;  // n bits; 0 where invalid.
  std::vector<uint32_t> triangle;     // n: the first blocker, kNoTriangle if free or invalid.
  std::vector<float> t;               // n: share of the segment, +inf if free or invalid.
  QueryStats stats;
};

// What CheckOptions says of the options; Cancelled / DeadlineExceeded. On an error the result holds
// nothing. What it held before is lost; its memory serves again.
absl::Status TestSegments(const IndexedGeometry& scene, const PreparedSegments& segments,
                          const SegmentOutputs& outputs, const QueryOptions& options,
                          SegmentResult* result);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_SEGMENTS_H_
