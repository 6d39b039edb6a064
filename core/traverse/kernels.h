// SPDX-License-Identifier: Apache-2.0
//
// The walks, compiled once per instruction set from one source each and chosen at run time.
//
// Every walk returns brute force's answer, bit for bit: occluded rays have a blocker (which one is
// not defined), closest hits are the least by (t, triangle).
//
// Thread safety: the functions are pure; the scene must not change while one runs.
//
//   const Kernels& kernels = KernelsFor(SimdTarget::kBest);
//   kernels.closest_single(scene, rays, hits, cancel, &stats);
#ifndef SIGHTLINE_CORE_TRAVERSE_KERNELS_H_
#define SIGHTLINE_CORE_TRAVERSE_KERNELS_H_

#include <cstdint>
#include <span>

#include "core/accel/indexed_geometry.h"
#include "core/base/cancel.h"
#include "core/geometry/box3.h"
#include "core/traverse/clear_leaves.h"
#include "core/traverse/light_hull.h"
#include "core/traverse/point_ground.h"
#include "core/traverse/rtt.h"
#include "core/traverse/shaft_cut.h"
#include "core/traverse/simd_target.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

// Functions over spans write hits[i] for rays[i] and return false, having left off, when `cancel`
// fires.
using TraceRaysFn = bool (*)(const IndexedGeometry& scene, std::span<const TraceRay> rays,
                             std::span<Hit> hits, const CancelToken* cancel, WalkStats* stats);
using TracePacketFn = bool (*)(const IndexedGeometry& scene, RayPacket& packet,
                               const CancelToken* cancel, WalkStats* stats);
// From `cut`, made for this packet among others, or from the root if it is null.
using TraceShaftFn = bool (*)(const IndexedGeometry& scene, RayPacket& packet, const ShaftCut* cut,
                              const CancelToken* cancel, WalkStats* stats);
// Two packets at once. False: it answers nothing, since no frame holds their rays, or `cancel`
// fired.
using TraceShaftPairFn = bool (*)(const IndexedGeometry& scene, PacketPair& packets,
                                  const ShaftCut* cut, const CancelToken* cancel, WalkStats* stats);
using TraceParallelFn = bool (*)(const IndexedGeometry& scene, ParallelPacket& packet,
                                 const ShaftCut* cut, const CancelToken* cancel, WalkStats* stats);
using TraceParallelPacketFn = bool (*)(const IndexedGeometry& scene, ParallelPacket& packet,
                                       const CancelToken* cancel, WalkStats* stats);
// A cut for packets with one origin (and all or none `segments`), or one direction. False: there is
// none, and each starts at the root.
using CutShaftFn = bool (*)(const IndexedGeometry& scene, std::span<const RayPacket> packets,
                            ShaftCut* cut);
using CutParallelFn = bool (*)(const IndexedGeometry& scene,
                               std::span<const ParallelPacket> packets, ShaftCut* cut);

// A cut for segments from all `origins` to the packets' targets, beginning at `from`, a cut of a
// hull that holds this one, or at the root if it is null. One without nodes says that nothing
// blocks any of them. False: there is none.
using CutHullFn = bool (*)(const IndexedGeometry& scene, std::span<const Vec3f> origins,
                           std::span<const RayPacket> packets, const ShaftCut* from, ShaftCut* cut);

// One walk for all samples of an area light: bit k of blocked[lane] says that something stands
// between sample k and the packet's point `lane`. `blocked` is as long as a packet, at 64 bytes. It
// need not find all: the rest is to be walked sample by sample, for those that are not blocked yet.
// It leaves more the less `budget` is (nothing is walked for 0), or if `cancel` fires. False: there
// is no cut, and nothing was found.
// `from` as in CutHullFn. The packet's origin is lost.
using TraceHullFn = bool (*)(const IndexedGeometry& scene, const LightHull& light,
                             RayPacket& packet, const ShaftCut* from, uint32_t budget,
                             HullRest* rest, uint16_t* blocked, const CancelToken* cancel,
                             WalkStats* stats);

// Which of up to sixteen boxes, none of them empty, nothing keeps from `origin`, a bit each: no
// segment from there to a point in the box is blocked, whatever triangles points name as their own.
// It need not find all, and gives up soon. `origin_source` and `mask` as in a packet.
using LitBoxesFn = uint32_t (*)(const IndexedGeometry& scene, Vec3f origin, uint32_t origin_source,
                                uint32_t mask, std::span<const Box3f> boxes, WalkStats* stats);

// Whether all segments from `common` to points in the box, or all rays from them along it, are
// blocked by a triangle of the leaf, or by two that share an edge. `sources` are the points' own
// triangles, or none; `common_source` and `mask` as in a packet.
using CoverPointsFn = bool (*)(const IndexedGeometry& scene, ChildRef leaf, Vec3f common,
                               uint32_t common_source, uint32_t mask, const Box3f& box,
                               std::span<const uint32_t> sources, WalkStats* stats);
// The same of the points, which the box holds, by triangles that edge mates lead to from those of
// the leaves `seeds` (kNoLeaf: none): how many it takes, or 0. If any, *leaf becomes that of one
// which is before the middle of the box.
using CoverByPatchFn = uint32_t (*)(const IndexedGeometry& scene, Vec3f common,
                                    uint32_t common_source, uint32_t mask, const Box3f& box,
                                    std::span<const Vec3f> points,
                                    std::span<const uint32_t> sources,
                                    std::span<const uint32_t> seeds, uint32_t* leaf,
                                    WalkStats* stats);

// The grounds of grounds->count points, whose x, y and z are given, none of them a triangle of
// `sources` (by point, or null); and the leaves that are clear of them, unless `clear` is null.
// Returns how many points have one. REQUIRES: for `clear`, finite points.
using FindGroundsFn = uint32_t (*)(const IndexedGeometry& scene, const uint32_t* sources,
                                   PointGrounds* grounds, ClearLeaves* clear, WalkStats* stats);
// Which points their grounds block from `common`, a segment's other end, or a direction that rays
// run along: bit i % 16 of bits[i / 16] for point i, as many as a packet has. Returns how many.
// Besides, how far D leads up along the grounds' normals of sixteen points, of those that are not
// blocked, at least: rises[i / 16], at 64 bytes or null, +inf if all are. Objects are not asked
// (MustAskObjects).
using GroundBitsFn = size_t (*)(const PointGrounds& grounds, Vec3f common, uint16_t* bits,
                                float* rises);
// Those of the leaves that block nothing toward `common` from some block's points, but for those
// that GroundBitsFn said to be blocked when it made `rises`.
using ChooseClearFn = void (*)(const ClearLeaves& clear, Vec3f common, const float* rises,
                               ClearToward* toward);

// Relevant triangles tracing (rtt.h) over the kd-tree, which the scene must have: packets with one
// origin and one kind of target.
using TraceRttFn = bool (*)(const IndexedGeometry& scene, std::span<RayPacket> packets,
                            const RttOptions& options, const CancelToken* cancel, WalkStats* stats);

struct Kernels {
  TraceRaysFn occluded_single, closest_single;    // Depth-first over the BVH, one ray at a time.
  TraceRaysFn occluded_brute, closest_brute;      // Every triangle of the geometry; no structure.
  TracePacketFn occluded_packet, closest_packet;  // Depth-first, rays together.
  TraceParallelPacketFn occluded_parallel_packet;
  // The same over the kd-tree. REQUIRES: the scene has one.
  TraceRaysFn occluded_kd_single, closest_kd_single;
  TracePacketFn occluded_kd_packet, closest_kd_packet;
  TraceRttFn occluded_rtt, closest_rtt;
  TraceShaftFn occluded_shaft, closest_shaft;  // Depth-first, all rays as one convex shaft.
  // Null with AVX2, whose registers hold eight rays: two packets one after the other are as fast.
  TraceShaftPairFn occluded_shaft_pair;
  TraceParallelFn occluded_parallel_shaft;
  CutShaftFn cut_shaft;
  CutParallelFn cut_parallel_shaft;
  CutHullFn cut_hull;
  TraceHullFn trace_hull;
  LitBoxesFn lit_boxes;
  CoverPointsFn cover_points, cover_parallel_points;  // By segments; by rays.
  CoverByPatchFn cover_by_patch, cover_parallel_by_patch;
  FindGroundsFn find_grounds;
  GroundBitsFn ground_bits, parallel_ground_bits;  // Of segments; of rays.
  ChooseClearFn choose_clear, choose_parallel_clear;
};

// REQUIRES: SimdTargetAvailable(target).
const Kernels& KernelsFor(SimdTarget target);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_KERNELS_H_
