// SPDX-License-Identifier: Apache-2.0
//
// What every kind of query shares: strategy, masks, cancellation, statistics.
//
// None of these options changes an answer, except the mask and the intersector: a strategy, a
// structure, a thread count or an instruction set only decides how fast the one exact answer is
// found. With another intersector than the predicate answers are that test's, and two ways to one
// may differ by as much as its error bound says (core/intersect/intersector_check.h).
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_QUERY_OPTIONS_H_
#define SIGHTLINE_CORE_QUERY_OPTIONS_H_

#include <array>
#include <cstdint>
#include <optional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/accel/indexed_geometry.h"
#include "core/base/cancel.h"
#include "core/intersect/intersector.h"
#include "core/traverse/answered_by.h"
#include "core/traverse/leaf_culling.h"
#include "core/traverse/shaft_stats.h"
#include "core/traverse/simd_target.h"

namespace sightline {

enum class Strategy : uint8_t {
  kAuto = 0,
  kSingle = 1,      // One ray at a time.
  kPacket = 2,      // Rays with a common origin, or direction, walk together.
  kBruteForce = 3,  // The predicate applied to every triangle: the definition.
  kShaft = 4,       // Rays with a common origin as one convex shaft (BVH).
  kRtt = 5,         // Relevant triangles of tiles of rays with a common origin (kd-tree).
};

// "AUTO", "SINGLE", "PACKET", "BRUTE_FORCE", "SHAFT", "RTT".
absl::string_view StrategyName(Strategy strategy);
// By that name, in any case. InvalidArgument listing the names.
absl::StatusOr<Strategy> ParseStrategy(absl::string_view name);

// What of a scene's structures is walked.
enum class Structure : uint8_t {
  // What the strategy needs: the BVH, for kRtt the kd-tree; that, too, in a scene without a BVH.
  kAuto = 0,
  kBvh = 1,        // An error where the scene has none.
  kKdTree = 2,     // An error where the scene has none, or the strategy is kShaft.
  kBinaryBvh = 3,  // Likewise, and for kRtt.
};

absl::string_view StructureName(Structure structure);  // "AUTO", "BVH", "KD_TREE", ...
// By that name, in any case. InvalidArgument listing the names.
absl::StatusOr<Structure> ParseStructure(absl::string_view name);

// Sides that packets of kPacket may have.
inline constexpr std::array<int, 4> kPacketSides = {2, 4, 8, 16};

struct QueryOptions {
  Strategy strategy = Strategy::kAuto;
  Structure structure = Structure::kAuto;
  // kRtt alone. A tile is four pixels square; images taken at n times their size in either
  // direction, to be averaged, have n × n rays a pixel: 1 .. kMaxRttAntialiasing (core/traverse/
  // rtt.h). Tiles begin at the corner of what TraceTile is given, and are cut at its other borders.
  // Those of its lights' shadows are each tile's hits. Points by themselves (ComputeShadows) are
  // tiles as they follow one another, 16·n² at a time.
  int rtt_antialiasing = 1;
  bool rtt_shared_edges = false;  // RttOptions::shared_edges.
  int rtt_side_by_side = 0;       // RttOptions::side_by_side, 0 .. kMaxRttSideBySide.
  // Culling within leaves: kSingle and kPacket alone. Its `tree` and `intersector` are not read.
  // Under kPacket rays of one direction are then single rays, as they are on other trees than the
  // BVH, by another intersector than the predicate and where their first hits are asked for.
  std::optional<LeafCulling> leaf_culling;
  // The test that decides: another than the predicate with kSingle, kPacket and kBruteForce alone,
  // kHavelHeroutDotProduct not with kPacket.
  Intersector intersector = Intersector::kExact;
  // kPacket alone: rays of so many pixels square, or as many of the points that follow one another,
  // walk together. One of kPacketSides.
  int packet_side = 16;
  // kPacket alone, of a tile's shadows: a packet from the light is that of the pixels' own square.
  // Where one of them hits nothing, the ray goes to the packet's first hit instead (paper 004,
  // section 5): the packet stays together, at no answer's cost; statistics count it. Else packets
  // hold hits alone, as they follow one another, and so do a sun's.
  bool pixel_shadow_packets = false;
  SimdTarget simd = SimdTarget::kBest;  // REQUIRES: SimdTargetAvailable(simd).
  uint32_t mask = 0xFFFFFFFFu;
  const CancelToken* cancel = nullptr;  // Polled during traversal; may be null.
  // Whether QueryStats::answered_by is wanted, which costs a little.
  bool count_answers = false;
};

// Whether the kd-tree is walked, not the BVH.
bool WalksKdTree(const IndexedGeometry& scene, const QueryOptions& options);
// Whether the scene has what is asked for; every query asks this first. FailedPrecondition: no such
// structure. InvalidArgument: a strategy that does not walk the structure, a number out of range.
// Each is named.
absl::Status CheckOptions(const IndexedGeometry& scene, const QueryOptions& options);

// How many kinds of AnsweredBy there are.
inline constexpr size_t kAnsweredByCount = static_cast<size_t>(AnsweredBy::kRay) + 1;

// Work done, summed over whatever the statistics belong to. Depends on strategy and target; not
// part of the answer.
struct QueryStats {
  uint64_t rays = 0;   // Segments asked about (invalid ones not counted).
  uint64_t nodes = 0;  // Eight-wide nodes visited, once per packet or ray.
  uint64_t leaves = 0;
  uint64_t triangle_tests = 0;      // Triangle × ray pairs the predicate looked at.
  uint64_t doubt_double = 0;        // Pairs the float stage left to doubles…
  uint64_t doubt_exact = 0;         // … and those that doubles left to exact arithmetic.
  uint64_t tiles = 0;               // kRtt: tiles asked about,
  uint64_t tiles_answered = 0;      // those that needed no rays,
  uint64_t relevant_triangles = 0;  // and the triangles on the lists of these.
  uint64_t culled_tests = 0;        // leaf_culling: pairs that never came to a test.
  ShaftStats shaft;                 // kShaft: what its stages culled.
  // Rays by what answered them (AnsweredBy); all 0 unless QueryOptions::count_answers.
  std::array<uint64_t, kAnsweredByCount> answered_by{};
  uint64_t compute_nanoseconds = 0;     // Summed over threads.
  Strategy strategy = Strategy::kAuto;  // What AUTO chose; kAuto where more than one was used.

  void Add(const QueryStats& other);
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_OPTIONS_H_
