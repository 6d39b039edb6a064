// SPDX-License-Identifier: Apache-2.0
//
// The margins of shaft culling. A cull must never drop a triangle that the predicate would report,
// so each float quantity it compares carries its own rounding as a margin. u = 2^-24 throughout;
// |x|_1 is the sum of the absolute components, |x|_inf the largest.
//
// Slopes (kSlopeMargin). s = fl((u·D)/(w·D)). The numerator errs by at most 3.1u|D|_1 <= 5.4u|D|,
// so does the denominator, which is at least 0.4|D|; with |s| <= 2.3 the quotient errs by 5.4u(1
// + 2.3)/0.4 + u·2.3 < 47u. Every rectangle of slopes is widened by 64u, and so holds its rays'
// true slopes.
//
// Boxes against a plane through the origin with normal n = u - s·w (or its like): |n|_inf <= 1
// + 2.3. n itself errs by 2u·3.3 per component, face - o by u, a chain of three fused multiply-adds
// by 3u: at most (6.6 + 3.3 + 9.9)u < 20u times |far corner - o|_1. kBoxMargin is 32u.
//
// Depths. w·(p - o) errs by the same reasoning by less than 5u|p - o|_1: kBoxMargin serves, too. A
// hit's distance is held between its triangle's slab entry and exit, each good to 4.1u relative, so
// the point it names lies in the box up to 5u|far corner - o|_1; kDepthScale on the other side
// covers the product of distance and depth.
//
// Vertices against the same planes: as boxes, with the vertex in place of the far corner.
//
// Edge forms over a block of rays (kEdgeMargin). The form c = (A-O)×(B-A) as computed errs by 9u·K,
// K = |A-O|_1·|B-A|_1, per unit of |D|_inf (predicate-inl.h). Divided by the depth w·D >= 0.4|D|,
// |D|_inf/(w·D) <= 2.5. Its frame components c·u, c·v, c·w err by 3.1u|c|_1 <= 3.1u·K each, the
// basis departs from orthonormal by 2u per component: together 2.5·(9 + 12)u·K + 3.1u(1 + 2·2.3)K <
// 70u·K. Evaluating centre ± radius takes four fused multiply-adds on terms below (1 + 2·2.3)K:
// 4·5.6u·K < 23u·K. kEdgeMargin is 128u. kEdgeUnderflow covers products that underflow, as long as
// depths are at least kLeastDepth.
//
// Plane forms over a block's rays: N = (B-A)×(C-B), K = |B-A|_1·|C-B|_1: N·D/(w·D) as above;
// N·(A-O) errs by 9u·K|A-O|_inf.
//
// Thread safety: constants only.
#ifndef SIGHTLINE_CORE_SHAFT_MARGINS_H_
#define SIGHTLINE_CORE_SHAFT_MARGINS_H_

namespace sightline {

inline constexpr float kSlopeMargin = 64 * 0x1p-24f;
inline constexpr float kBoxMargin = 32 * 0x1p-24f;
inline constexpr float kDepthScale = 1 + 16 * 0x1p-24f;
inline constexpr float kEdgeMargin = 128 * 0x1p-24f;
inline constexpr float kEdgeUnderflow = 0x1p-80f;
inline constexpr float kLeastDepth = 0x1p-60f;

}  // namespace sightline

#endif  // SIGHTLINE_CORE_SHAFT_MARGINS_H_
