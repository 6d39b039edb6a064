// SPDX-License-Identifier: Apache-2.0
//
// What the walks that cull within leaves do there, and over which tree: vertex culling of packets
// (papers 000 and 004) and ray-box culling of single rays (paper 001). All of it decides how fast
// an answer is found and never which, but for `intersector`: with another than the predicate,
// answers are that test's, off by no more than its bound (core/intersect/intersector_check.h).
//
// Thread safety: plain values.
//
//   LeafCulling culling;
//   culling.frustum = FrustumRays::kAll;
//   CulledKernelsFor(SimdTarget::kBest).closest_packet(scene, culling, packet, cancel, &stats);
#ifndef SIGHTLINE_CORE_TRAVERSE_LEAF_CULLING_H_
#define SIGHTLINE_CORE_TRAVERSE_LEAF_CULLING_H_

#include <array>
#include <cstdint>

#include "core/intersect/intersector.h"

namespace sightline {

enum class CulledTree : uint8_t {
  kBinaryBvh,  // IndexedGeometry::binary_bvh.
  kKdTree,     // IndexedGeometry::kd_tree, and kd_leaves where they are there.
  kBvh,        // IndexedGeometry::bvh, whose leaves hold at most sixteen triangles.
};

// The rays that the transient frustum of a leaf holds (paper 000).
enum class FrustumRays : uint8_t {
  kAll,     // All of the packet's ("maskless"): one frustum for all leaves.
  kRows,    // Of the registers with a lane that meets the leaf's box ("active rows only").
  kMasked,  // Those that meet the leaf's box.
};

// How a packet is put to a node's box (paper 004, section 3). Each ends with the lanes one by one.
enum class NodeTest : uint8_t {
  kAllRays,      // From the packet's first lanes on.
  kFirstActive,  // From the first lanes that met the parent on.
  kCorners,      // Those first lanes, then the four corner rays, then the rest.
};

// What becomes of a packet whose directions share a sign along no axis, so that it has no frustum.
enum class PacketSplit : uint8_t {
  kHalves,      // Two packets, which are tried again (paper 000).
  kSingleRays,  // Every ray by itself (paper 004).
};

// The most that ray_box_min_triangles may be: no leaf of use has as many.
inline constexpr uint32_t kMaxRayBoxMinTriangles = 1u << 20;

inline constexpr std::array kAllFrustumRays = {FrustumRays::kAll, FrustumRays::kRows,
                                               FrustumRays::kMasked};
inline constexpr std::array kAllNodeTests = {NodeTest::kAllRays, NodeTest::kFirstActive,
                                             NodeTest::kCorners};
inline constexpr std::array kAllPacketSplits = {PacketSplit::kHalves, PacketSplit::kSingleRays};

struct LeafCulling {
  // Nothing left out, nothing prepared for it: leaves are tested whole.
  static constexpr LeafCulling None() {
    LeafCulling c;
    c.side_planes = c.near_far = c.aperture = c.skip_edges = c.ray_mask = c.ray_box = false;
    c.frustum = FrustumRays::kAll;
    return c;
  }

  CulledTree tree = CulledTree::kBinaryBvh;
  Intersector intersector = Intersector::kExact;

  // ---- Packets
  bool side_planes = true;  // The four planes through the origin and the packet's corner rays.
  bool near_far = true;     // The near and far planes: with side_planes, the six-plane frustum.
  bool aperture = true;     // The triangle's edges against the four corner rays.
  // Near and far planes after the triangle's edges, not before.
  bool aperture_first = false;
  // Where all four corner rays pass within a triangle's edges, so do all rays: their own edge tests
  // are left out, and only distances are asked for. Needs `aperture`. A paper's intersector then
  // hits, too, where its own rounding beside an edge would have it miss.
  bool skip_edges = true;
  FrustumRays frustum = FrustumRays::kMasked;
  bool first_axis = false;  // The first axis that will do, not the one with the longest directions.
  bool ray_mask = true;     // Rays that miss the leaf's box are not put to its triangles.
  NodeTest node_test = NodeTest::kFirstActive;
  PacketSplit split = PacketSplit::kHalves;

  // ---- Single rays
  bool ray_box = true;                 // The ray's box within the leaf against the triangles'.
  uint32_t ray_box_min_triangles = 3;  // Leaves of fewer are tested whole. Paper 001: more than 2.
  bool ray_box_update = true;          // Shrunk to the hit after each hit.
  bool mailbox = false;                // Triangles tested lately are not tested again (kd-tree).

  // ---- Both, on the kd-tree
  // A leaf's box is the cell that the walk has come to, not the one stored with the leaf, which the
  // empty cells around it are folded into (paper 000, section 2).
  bool cell_boxes = false;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_LEAF_CULLING_H_
