// SPDX-License-Identifier: Apache-2.0
//
// What a walk is asked about, one ray or a packet of them, and what it reports of its work.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_TRAVERSE_TRACE_RAY_H_
#define SIGHTLINE_CORE_TRAVERSE_TRACE_RAY_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"
#include "core/intersect/hit.h"
#include "core/intersect/predicate.h"
#include "core/traverse/answered_by.h"
#include "core/traverse/gradual_fetch.h"
#include "core/traverse/pixel_grid.h"
#include "core/traverse/shaft_seed.h"
#include "core/traverse/shaft_stats.h"

namespace sightline {

struct ClearToward;
struct ShaftCut;

// Triangles whose ids follow one another: an object's.
struct TriangleRange {
  uint32_t first = 0, count = 0;
  bool Holds(uint32_t id) const { return id - first < count; }
};

// Closest hits alone, of rays that begin where they leave a mirror (core/query/mirrors.h): hits at
// t <= near do not count, and the triangles of `unseen` do not block. All walks for closest hits
// know both but the shaft's; those for any hit need not.
struct TraceRay {
  PredicateRay ray;
  uint32_t mask = 0xFFFFFFFFu;         // An object is seen when (object mask & mask) != 0.
  uint32_t from_source = kNoTriangle;  // Triangles the ends lie on, which do not block.
  uint32_t to_source = kNoTriangle;
  float near = -std::numeric_limits<float>::infinity();
  TriangleRange unseen;
};

// `lanes` bits from number `first` on of a row with sixteen to a number, all in one number; 0 where
// the row is null.
inline uint32_t LaneBits(const uint16_t* row, size_t first, size_t lanes) {
  return row == nullptr ? 0 : uint32_t{row[first / 16]} >> (first % 16) & ((1u << lanes) - 1);
}

// Rays with one origin (an eye's, or a light's toward its points) that walk together.
// Invariants: lanes 0 .. count-1 are in use; all run from `origin`; `segments` says what targets
// are.
struct alignas(64) RayPacket {
  static constexpr int kMaxRays = 256;
  static constexpr uint32_t kNoLeaf = 0xFFFFFFFFu;

  Vec3f origin;
  bool segments = true;
  uint32_t mask = 0xFFFFFFFFu;
  uint32_t origin_source = kNoTriangle;
  int count = 0;
  // Any hit, over the BVH: a leaf to try first (ChildRef bits), of the same scene. The walk leaves
  // the one behind that blocked the last ray, or kNoLeaf: what darkens one packet may darken the
  // next.
  uint32_t first_leaf = kNoLeaf;
  // No lane has a source, so that nobody reads target_source (a ParallelPacket's: origin_source),
  // and it need not be filled. Where it is not said, whoever wants to know looks.
  bool sourceless = false;
  // Any hit: asked for meanwhile, as far as a walk gets to it (shafts do); null: nothing.
  GradualFetch* meanwhile = nullptr;
  // Any hit: the least box around the points (targets, or a ParallelPacket's origins) of the lanes
  // in use, where it is known; null: whoever wants it finds that of those that are not `unasked`.
  const Box3f* point_box = nullptr;
  // Any hit, over the BVH: lanes whose answer is not wanted, a bit each, sixteen to a number; null:
  // all are wanted.
  const uint16_t* unasked = nullptr;
  // Any hit, over the BVH: leaves that block none of some blocks' others; null: none are known.
  const ClearToward* clear = nullptr;
  // Any hit, shafts: where to say which lanes are blocked, a bit each, sixteen to a number, all
  // kMaxRays of them (those `unasked` or out of use are not); `triangle` says nothing then. Null:
  // `triangle` says it.
  uint16_t* blocked = nullptr;
  // Any hit: what shafts of neighbouring packets have left to this one's walk, or its shaft is to
  // leave to them; null: nothing.
  ShaftSeed* seed = nullptr;
  // Any hit, packets over the BVH: where the walk begins; null: at the root. (Shafts are handed
  // theirs.)
  const ShaftCut* cut = nullptr;
  alignas(64) float target_x[kMaxRays], target_y[kMaxRays], target_z[kMaxRays];
  alignas(64) uint32_t target_source[kMaxRays];  // kNoTriangle: none. Read for segments only.
  // As a TraceRay's: by lane, up to the end of a vector, or null; and for all lanes.
  const float* near = nullptr;
  TriangleRange unseen;
  // Where the rays are those of 16 by 16 pixels, in squares of lanes (pixel_grid.h), or null: the
  // pixels' grid, and the packet's first pixel in it. REQUIRES: target_x, target_y and target_z are
  // the sums of the grid's terms, rounded.
  const PixelGrid* grid = nullptr;
  uint32_t grid_column = 0, grid_row = 0;
  // Whether u and v are wanted beside a closest hit's t and triangle.
  bool want_barycentrics = false;
  // Where to say what answered each ray, count elements; null: nowhere. The caller fills it with
  // what the walk as such is (kShaft, for shafts), the walk changes what fared otherwise.
  AnsweredBy* answered_by = nullptr;
  // Results. Occlusion: triangle is some blocker's id or kNoTriangle; the others are unused.
  alignas(64) float t[kMaxRays];  // +inf for a miss.
  alignas(64) uint32_t triangle[kMaxRays];
  alignas(64) float u[kMaxRays], v[kMaxRays];  // 0 for a miss.

  Vec3f target(int lane) const { return {target_x[lane], target_y[lane], target_z[lane]}; }
  PredicateRay ray(int lane) const { return {origin, target(lane), segments}; }
  // The lane's ray by itself.
  TraceRay trace_ray(int lane) const {
    TraceRay ray = {.ray = this->ray(lane),
                    .mask = mask,
                    .from_source = origin_source,
                    .to_source = segments ? source(lane) : kNoTriangle,
                    .unseen = unseen};
    if (near != nullptr) ray.near = near[lane];
    return ray;
  }
  uint32_t source(int lane) const { return sourceless ? kNoTriangle : target_source[lane]; }
  // A lane out of use as a copy of one that is not, so that whole vectors can be asked about.
  void PadLane(size_t lane, size_t as) {
    target_x[lane] = target_x[as];
    target_y[lane] = target_y[as];
    target_z[lane] = target_z[as];
    target_source[lane] = kNoTriangle;
  }
  Hit hit(int lane) const { return {t[lane], triangle[lane]}; }

  // The question of `lanes` lanes from `first` on, as another packet's, which has no grid. What
  // answers them is said where this one says it.
  void CopyLanes(int first, int lanes, RayPacket* to) const {
    to->origin = origin;
    to->segments = segments;
    to->mask = mask;
    to->origin_source = origin_source;
    to->near = near == nullptr ? nullptr : near + first;
    to->unseen = unseen;
    to->grid = nullptr;
    to->unasked = nullptr;
    to->clear = nullptr;
    to->blocked = nullptr;
    to->seed = nullptr;
    to->cut = cut;
    to->want_barycentrics = want_barycentrics;
    to->answered_by = answered_by == nullptr ? nullptr : answered_by + first;
    to->sourceless = sourceless;
    to->meanwhile = nullptr;
    to->point_box = nullptr;
    to->count = lanes;
    std::copy_n(target_x + first, lanes, to->target_x);
    std::copy_n(target_y + first, lanes, to->target_y);
    std::copy_n(target_z + first, lanes, to->target_z);
    if (!sourceless) std::copy_n(target_source + first, lanes, to->target_source);
  }
};

// Two full packets of segments, one behind the other in an array, that walk together as one shaft
// for any hit: what they share is the first one's, and nothing of `unasked` or `clear`. All that is
// not told of here is as in RayPacket.
struct PacketPair {
  static constexpr int kMaxRays = 2 * RayPacket::kMaxRays;
  static constexpr int count = kMaxRays;
  static constexpr bool segments = true;
  static constexpr const uint32_t* unasked = nullptr;
  static constexpr const ClearToward* clear = nullptr;

  // `box` is the least around the points of both; `blocked` is as long as both, thirty-two lanes to
  // a number.
  PacketPair(const RayPacket* packets, const Box3f* box, uint32_t* blocked)
      : origin(packets->origin),
        mask(packets->mask),
        origin_source(packets->origin_source),
        first_leaf(packets->first_leaf),
        sourceless(packets->sourceless),
        meanwhile(packets->meanwhile),
        point_box(box),
        blocked(blocked),
        seed(packets->seed),
        answered_by(packets->answered_by),
        target_x(packets->target_x),
        target_y(packets->target_y),
        target_z(packets->target_z),
        target_source(packets->target_source) {}

  const Vec3f origin;
  const uint32_t mask, origin_source;
  uint32_t first_leaf;
  const bool sourceless;
  GradualFetch* const meanwhile;
  const Box3f* const point_box;
  uint32_t* const blocked;
  ShaftSeed* const seed;
  AnsweredBy* const answered_by;  // Of both, one behind the other.
  // The first one's rows; lane `lane` of both is at At(lane).
  const float *const target_x, *const target_y, *const target_z;
  const uint32_t* const target_source;

  static constexpr size_t At(size_t lane) { return lane + lane / RayPacket::kMaxRays * kGap; }
  Vec3f target(int lane) const {
    const size_t at = At(static_cast<size_t>(lane));
    return {target_x[at], target_y[at], target_z[at]};
  }
  PredicateRay ray(int lane) const { return {origin, target(lane), segments}; }
  TraceRay trace_ray(int lane) const {
    return {.ray = ray(lane),
            .mask = mask,
            .from_source = origin_source,
            .to_source = sourceless ? kNoTriangle : target_source[At(static_cast<size_t>(lane))]};
  }
  void PadLane(size_t, size_t) const {}  // There is none out of use.

 private:
  // From the end of a packet's row to that of the next one's, in numbers.
  static constexpr size_t kGap = sizeof(RayPacket) / sizeof(float) - RayPacket::kMaxRays;
};

// Rays with one direction (a sun's) that walk together: from each origin toward it, without end.
// Asked for any hit only.
struct alignas(64) ParallelPacket {
  static constexpr int kMaxRays = RayPacket::kMaxRays;

  Vec3f direction;
  uint32_t mask = 0xFFFFFFFFu;
  uint32_t direction_source = kNoTriangle;  // What the light itself lies on; it does not block.
  int count = 0;
  uint32_t first_leaf = RayPacket::kNoLeaf;  // As in RayPacket.
  bool sourceless = false;                   // As in RayPacket.
  GradualFetch* meanwhile = nullptr;         // As in RayPacket.
  const Box3f* point_box = nullptr;          // As in RayPacket.
  AnsweredBy* answered_by = nullptr;         // As in RayPacket.
  const uint16_t* unasked = nullptr;         // As in RayPacket.
  const ClearToward* clear = nullptr;        // As in RayPacket.
  uint16_t* blocked = nullptr;               // As in RayPacket.
  ShaftSeed* seed = nullptr;                 // As in RayPacket; of shafts alone.
  const ShaftCut* cut = nullptr;             // As in RayPacket.
  alignas(64) float origin_x[kMaxRays], origin_y[kMaxRays], origin_z[kMaxRays];
  alignas(64) uint32_t origin_source[kMaxRays];  // kNoTriangle: none.
  alignas(64) uint32_t triangle[kMaxRays];       // Result: some blocker's id, or kNoTriangle.

  // The question of `lanes` lanes from `first` on, as another packet's. What answers them is said
  // where this one says it.
  void CopyLanes(int first, int lanes, ParallelPacket* to) const {
    to->direction = direction;
    to->mask = mask;
    to->direction_source = direction_source;
    to->unasked = nullptr;
    to->clear = nullptr;
    to->blocked = nullptr;
    to->seed = nullptr;
    to->cut = cut;
    to->answered_by = answered_by == nullptr ? nullptr : answered_by + first;
    to->sourceless = sourceless;
    to->meanwhile = nullptr;
    to->point_box = nullptr;
    to->count = lanes;
    std::copy_n(origin_x + first, lanes, to->origin_x);
    std::copy_n(origin_y + first, lanes, to->origin_y);
    std::copy_n(origin_z + first, lanes, to->origin_z);
    if (!sourceless) std::copy_n(origin_source + first, lanes, to->origin_source);
  }

  Vec3f origin(int lane) const { return {origin_x[lane], origin_y[lane], origin_z[lane]}; }
  PredicateRay ray(int lane) const { return PredicateRay::Ray(origin(lane), direction); }
  uint32_t source(int lane) const { return sourceless ? kNoTriangle : origin_source[lane]; }
  void PadLane(size_t lane, size_t as) {  // As in RayPacket.
    origin_x[lane] = origin_x[as];
    origin_y[lane] = origin_y[as];
    origin_z[lane] = origin_z[as];
    origin_source[lane] = kNoTriangle;
  }
  // The lane's ray by itself.
  TraceRay trace_ray(int lane) const {
    return {
        .ray = ray(lane), .mask = mask, .from_source = source(lane), .to_source = direction_source};
  }
};

struct WalkStats {
  uint64_t nodes = 0;
  uint64_t leaves = 0;
  uint64_t triangle_tests = 0;
  uint64_t doubt_double = 0;  // Pairs of triangle and ray that floats left open,
  uint64_t doubt_exact = 0;   // and that doubles did.
  // Of the walks that cull within leaves (leaf_culling.h).
  uint64_t culled_tests = 0;  // Pairs of triangle and ray that never came to a test.
  uint64_t ray_boxes = 0;     // Boxes made of a ray within a leaf, and made smaller after a hit.
  uint64_t ray_box_updates = 0;
  uint64_t box_tests = 0;       // Registers of lanes put to the root's box, or inner steps' boxes.
  uint64_t aperture_tests = 0;  // Triangles put to a packet's four corner rays.
  uint64_t edges_spared = 0;    // Pairs whose edges the corner rays had settled.
  // Relevant triangles tracing: tiles asked about, those whose lists answered all their rays, and
  // the triangles on those lists together.
  uint64_t tiles = 0;
  uint64_t tiles_answered = 0;
  uint64_t relevant_triangles = 0;
  ShaftStats shaft;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_TRACE_RAY_H_
