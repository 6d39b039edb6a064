// SPDX-License-Identifier: Apache-2.0
//
// Leaves beside a packet's points that block nothing of what leads up from them. Most of a walk for
// points on a surface goes into that very surface, to prove that it does not shade itself. The
// proof is much the same for all lights, and is found here once.
//
// Of a triangle and a point P, any vector n with n·(V - P) <= 0 for each corner V has all of the
// triangle behind the plane through P across n: what leads along D with n·D > 0 moves away from it,
// and is not blocked. Points come in blocks of sixteen, a leaf is clear of a block toward D if each
// of its triangles is, and each of them needs one of
//
// * up, the mean of the block's ground normals (point_ground.h): all of it is below all points;
// * `plane`, of the leaf and the block, for all triangles that lie aside: up, tilted away from
//   where the leaf is by the least angle that serves them all. A leaf seen at an angle t above the
//   horizon shuts out t/pi of all directions, not every direction as low as it;
// * N, its own normal, or -N: points that see it above their horizon are `before` it, or `behind`;
// * for each point P by itself n_P - w, with n_P its own ground's normal and |w| <= `own_tilt`, so
//   that n_P·D > own_tilt·|D| is enough.
//
// Segments to L differ in D from point to point: with all points within `reach` of `centre` and Q =
// L - centre, n·D >= n·Q - reach and |D| <= |Q| + reach.
//
// Rounding. u = 2^-24. Any stored n_P, up and tangents are as good as any others: what is proven
// is proven of their stored values. Products of up and tangents with V - centre err by 4u·|V -
// centre|_1, those with P - centre by 7u·reach, as |P - centre|_1 <= 1.74·reach. A plane is rounded
// three times in each component (what its length loses is common to all; it is that of what was
// rounded, so that |plane| <= 1 + 4u and n·Q bounds what its points have): it moves n·(V - P) by
// 4.3u·|V - P|_1. These sum up to less than 9u·|V - centre|_1 and 15u·reach; 32u of both are
// allowed for. Of a point by itself products with w, tangents first, err by 12u·|V - P|_1 where |w|
// < 1: kGroundSlack = 16u of it is allowed for. Which triangles lie below, w = 0, is settled in
// doubles with the normals in doubles, which floats are within u of: a ground's own triangle, and
// its neighbours', lie as closely below as P is above them. Toward D products and lengths lose
// 9u·(|Q|_1 + reach) and 4u of |D|: 2·kGroundSlack is more. Of N, `off` bounds what its cross
// product lost, and its length is good to 4u where no square underflows (2^-100 and up); smaller
// triangles have no N, as slivers have none.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_TRAVERSE_CLEAR_LEAVES_H_
#define SIGHTLINE_CORE_TRAVERSE_CLEAR_LEAVES_H_

#include <cstdint>

#include "core/accel/bvh.h"
#include "core/geometry/vec3.h"
#include "core/traverse/point_ground.h"

namespace sightline {

// What must be tilted further leaves too few directions.
inline constexpr float kMostClearTilt = 0.9f;

// A packet's. Rows may be read to the end of a vector.
struct alignas(64) ClearLeaves {
  static constexpr uint32_t kMost = PointGrounds::kMostLeaves;
  static constexpr int kBlocks = PointGrounds::kMaxPoints / 16;

  // By block, what leads away; and of which triangles points are before, or behind, whose unit
  // normals follow.
  struct alignas(64) Leaf {
    float plane_x[kBlocks], plane_y[kBlocks], plane_z[kBlocks];  // Zero where none will do.
    float own_tilt[kBlocks];  // -inf where no point is asked about by itself.
    alignas(64) uint16_t before[kBlocks], behind[kBlocks];
    bool sides;  // Whether there are any of these.
    alignas(64) float normal_x[kMaxLeafTriangles];
    float normal_y[kMaxLeafTriangles], normal_z[kMaxLeafTriangles];
    float off[kMaxLeafTriangles];  // Of the normals.
  };

  uint32_t count = 0;
  // By block.
  alignas(64) float up_x[kBlocks], up_y[kBlocks], up_z[kBlocks];
  alignas(64) float centre_x[kBlocks], centre_y[kBlocks], centre_z[kBlocks], reach[kBlocks];
  Vec3f centre;                      // Of all points,
  float radius = 0;                  // which lie within this of it.
  alignas(64) uint32_t leaf[kMost];  // ChildRef bits.
  Leaf leaves[kMost];
};

// Those toward some light: leaf[i] blocks nothing from the blocks of bits blocks[i], as far as they
// are asked about above their horizon. Behind the last are kNoLeaf, to the end of a vector.
struct alignas(64) ClearToward {
  uint32_t count = 0;
  alignas(64) uint32_t leaf[ClearLeaves::kMost + 16];
  uint16_t blocks[ClearLeaves::kMost];
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_CLEAR_LEAVES_H_
