// SPDX-License-Identifier: Apache-2.0
//
// The margins of shaft culling. A cull must never drop a triangle that the predicate would report,
// so each float quantity it compares carries its own rounding as a margin. u = 2^-24 throughout;
// |x|_1 is the sum of the absolute components, |x|_inf the largest.
//
// Rays with a common origin O
//
// Slopes (kSlopeMargin). s = fl((u·D)/(w·D)). The terms of the numerator add up to at most |D|
// (Cauchy-Schwarz), so it errs by at most 4.1u|D|, a segment's rounding of D included; so does the
// denominator, which is at least 0.4|D|. With |s| <= 2.3 the quotient (a product with the
// reciprocal) errs by 4.1u(1 + 2.3)/0.4 + 2u·2.3 < 39u; where the reciprocal is but good to 3.3u
// (InverseOf, for any hit), by 4.3u·2.3 instead, in all below 44u. Every rectangle of slopes is
// widened by 64u, and so holds its rays' true slopes.
//
// Rays between others (kOutlineMargin). A camera's rays are sums of a term by column and one by
// row, rounded: before the rounding (u per component; the doubles' own is far below) a tile's rays
// are weighted means of its corners', and so are their slopes. |D| moves by u|D|, a slope by at
// most u(1 + 2.3)/0.4 = 8.3u, for the ray and for the corners: with kSlopeMargin's 39u below 56u.
// The outline of a group of tiles is widened by 96u.
//
// Pixels between their block's corners (core/traverse/pixel_grid.h). A column's term C and a row's
// R are along the axes what doubles say, rounded: u|C|, u|R| each, and both are at most |D|, as the
// camera's basis is orthogonal up to 2^-16. Their sum errs by u|D| more, so numerator and depth
// each by 3u|D|; with |s| <= 2.3 the quotient errs by 3u(1 + 2.3)/0.4 + 2u·2.3 < 30u. The rays'
// own rounding moves their slopes by 8.3u, as above: together within kSlopeMargin. The largest
// depth of the corners is good to 3u|D| / 0.4|D| and the ray's own 2.5u: 10u, less than what
// kDepthScale has room for.
//
// Slopes of corners (kCornerMargin). p = fl(A - O) errs by u, its products with the axes by 3.1u:
// 4.1u|p|_1 each. With w·p >= 0.25|p|_1 (kMinCornerShare; farther out, no slope is taken) the
// quotient is below 4 and errs by 16.4u(1 + 4) + 2u·4 < 90u: the margin is 128u.
//
// Points against a plane through O with normal n = u - s·w (or its like): |n|_inf <= 1 + 2.3. n
// itself errs by 2u·3.3 per component, p - o by u, a chain of three fused multiply-adds by 3u: at
// most (6.6 + 3.3 + 9.9)u < 20u times |p - o|_1. kBoxMargin is 32u. For the faces of boxes the
// chain begins at the normal's product with O: n·p and n·o then err by (6.6 + 9.9)u|p|_1 and
// (6.6 + 3.3 + 9.9)u|o|_1, and kBoxMargin is taken of |p|_1 + |o|_1, for the scene's farthest
// corner: one margin for all boxes.
// Triangles are put to such planes along the axes: u·p - s·(w·p). Each product errs by 4.1u|p|_1 as
// above, the last operation by 3.3u: (4.1(1 + 2.3) + 3.3)u < 17u times |p|_1, within the same
// margin, which they take of the scene's farthest corner, too.
//
// Lines of wedges (wedge-inl.h): kBoxMargin again, per unit of |n|_1. With M the basis' rows and
// s = (slope, slope, 1) a ray's own, D is (w·D) M^-1 s. The corners have M^T s instead. Rounding
// moved each of M's rows by at most u, so M M^T is the unit matrix up to 2·sqrt(3)u as an operator,
// and |s| = |D|/(w·D) <= 2.5: the two differ by less than 9u, whatever n is, of a point's depth,
// which is at most |p - o|_1. M^T s lies between the corners, which are good to doubles. n·o is
// taken of n in doubles, n·p of n rounded: u|p|_1. The chain of two fused multiply-adds that begins
// at n·o, rounded once, adds 3u(|p|_1 + |o|_1): below 16u of that.
//
// Products that underflow lose up to 2^-149 each: kFloatUnderflow (predicate-inl.h) is added to the
// margins of planes. Slopes are taken at depths of at least kLeastDepth, where it cannot matter.
//
// Depths. w·(p - o) errs by the same reasoning by less than 5u|p - o|_1: kBoxMargin serves, too. A
// hit's distance is held between its triangle's slab entry and exit, each good to 4.1u relative, so
// the point it names lies in the box up to 5u|far corner - o|_1. On the other side stands a
// distance times a ray's depth: the depth is good to 5.4u|D| / 0.4|D| = 13.5u, its reciprocal,
// products and quotient add 4u: kDepthScale is 32u.
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
// Inverse distances of hits (kInverseMargin). 1/t = N·D / N·(A-O) is taken from the float stage's
// N·D ± its bound b and N·(A-O) ± its own. Where N·D > 2b the double quotient of HitDistance is
// good to 2^-28 relative, its rounding adds u, the hold between slab entry and exit at most 4.1u,
// the products here 4u: below 10u + 2^-28. kInverseMargin is 16u, on either side.
//
// Parallel rays, from origins P along D
//
// Everything is taken relative to a reference point R among the origins; r bounds |P-R|_1. Offsets
// are (u·(P-R), v·(P-R)), with u, v ⊥ D up to 4u. A hit H = P + tD has the offsets of its P up to
// 4u·t|D| <= 4u(|H-R|_1 + r), each offset errs by 4u times its 1-norm: below 16u(|H-R|_1 + r).
// kBoxMargin of that sum serves, for faces with |R|_1 added as above. The lines of strips likewise:
// n is perpendicular to D but for its rounding, 2u; over the corners M^T of the offsets stands for
// P - R, less its depth: 4u·r for the basis, 4u·r for the depth along D.
//
// Edge forms. With m = (B-A)×D the predicate's e = (A-P)·m = (A-R)·m - (P-R)·m. m errs by 3u·K per
// component, K = |B-A|_1|D|_inf >= |m|_inf. Per ray (kParallelUnits): each product is a triple
// product of differences, good to 8u of its permanent (predicate-inl.h); the chain that subtracts
// them rounds (A-R)·m three times more: 11u·K(|A-R|_1 + r) < 12u. Over a block (kEdgeMargin), -m·u
// and -m·v are coefficients: (A-R)·m errs by 7u·K|A-R|_1, m·u and m·v by 10.5u·K each, times r; the
// basis by 28u·K·r and m·w, which should be zero, by 7u·K·r; offsets by 7u·K·r each; centre ±
// radius by 4u(K|A-R|_1 + 3.5K·r): together 11u·K|A-R|_1 + 84u·K·r. The plane form N·(A-R) -
// N·(P-R) likewise with K = |B-A|_1|C-B|_1 and one more coefficient: + 21u·K·r. kEdgeMargin is
// 128u.
// m's products lose up to 2^-149 where they underflow, which A-R and P-R scale: the bound of a ray
// has kFloatUnderflow times |A-R|_1 + r beside kFloatUnderflow (ParallelEdgeBound), and that of a
// block kEdgeUnderflow, which is more than 2^-149 times any r. Offsets lose up to 1.5·2^-149 each
// where P-R is next to nothing, which the coefficients scale: |m| is below 2^63, so that
// kEdgeUnderflow covers that, too, but |N| may be 2^83. The plane's margin over a block has K times
// kLeastOffset for it: 128u·2^-100·K, where 2.6·2^-149·|N| would do.
//
// Sides of planes, of rays that run within the edges (PlaneBound, core/traverse/shaft_leaf-inl.h)
//
// s = N·(P-A) as computed errs by e <= b·|P-A|, where b·x is what BoundAlong says of a vector of
// absolute components x. Whether a ray is blocked hangs on s only if its line meets the triangle,
// in some H. With O and P on that line P - H = s/(N·(A-O)) (H-O), and along D it is s/(N·D) D, s
// exact. So e <= b·|H-A| + r|s|, where r = b·|H-O| / |N·(A-O)|, or b·|D| / |N·D|. H lies between
// the corners: |H-A| is at most the larger of |B-A| and |C-A|, |H-O| the largest of the corners',
// component by component. Where r is below 1, an s whose computed sign is wrong is computed as at
// most e - |s| <= b·|H-A|: one bound for all rays, of the triangle's own size, however far P is.
// That r is below 1 is certain where |N·(A-O)|, or |N·D|, is computed as twice the numerator.
//
// Receivers' cap (kCapMargin)
//
// Segments from O to points P stay in {x : G·(x-C) <= most}, most = max(G·(O-C), G·(P-C)), for
// whatever G and C are stored; rays from P along D with G·D <= 0 stay in {x : G·(x-C) <= max
// G·(P-C)}. G·(x-C) errs by 4u·sum |G_k||x_k - C_k|: kCapMargin is 5u of it, on both sides, for the
// points of what their box allows. With C among the points it is a margin of the neighbourhood's
// size, so that a surface's own triangles, which lie just behind points placed in front of it, are
// culled by their vertices.
// Put to a node's boxes, G is a normal like the others: no component is above 2, where theirs are
// within 3.3, and it is stored as it is, so that kBoxMargin has room.
//
// An area light's samples together (core/traverse/hull_leaf-inl.h)
//
// With q = P-C and m = B-A an edge's form is e(C, P) at the light's centre C; for a sample C + s·a
// + t·b + r it is e(C, P) + s·λa + t·λb + (m × r)·(P-A), λh = (m × h)·(P-A), |s|, |t| <= 1.
//
// Per sample. e(C, P) is the float stage's: off by at most 9u·K|q|_inf, K = |A-C|_1|m|_1. λh is
// taken as n·q - n·(A-C), n = m × h: n errs by 3u of its permanent, q and A-C by u, products by
// 3u, and the chain of fused multiply-adds rounds four times more: below 12u·|m|_1|h|_1(|q|_inf +
// |A-C|_inf). Two fused multiply-adds, or as many sums, add both up: 2.1u of all three. And (m ×
// r)·(P-A) is at most |r|_inf|m|_1|P-A|_1, |P-A|_1 <= 3|q|_inf + |A-C|_1. Together
//     12u·K|q|_inf + |m|_1(15u(|a|_1 + |b|_1) + |r|_inf)(3|q|_inf + |A-C|_1),
// norms as computed: kCentreUnits is 12u, kLeanUnits 32u, and kRestScale covers the norms'
// rounding.
//
// Over a block of rays, divided by the depth w·q: e(C, P) has an edge form's margin, and so has
// n·q, with |m|_1|h|_1 for K. n·(A-C) is multiplied by the inverse depth, which is within
// kDepthScale of what is computed of it, twice, as the block's nearest point is taken for the
// nearest there is; with its own roundings that is below 96u·|m|_1|h|_1|A-C|_inf over the depth.
// |q|_1 is at most sqrt(3)·2.5 of the depth, so that r costs |r|_inf|m|_1(4.4 + |A-C|_1 / depth).
// With S = |m|_1 (kEdgeMargin(|a|_1 + |b|_1) + 2|r|_inf), kRestPerDepth·S + S|A-C|_1 / depth
// covers all but e's own. Where S is next to nothing n has lost up to 2^-149 per component, which
// n·q scales by less than kEdgeUnderflow has room for, and n·(A-C) over the depth by up to 2^60:
// kFloatUnderflow beside S in the part that goes by |A-C|_1 / depth covers that.
//
// Over a block, of one sample. Its form's coefficients are those of C's and of the leans, two fused
// multiply-adds each: 2u of the three's absolute sum, over the block's slopes 2u(1 + 2·2.3) < 12u
// of K and of |m|_1|h|_1, and 2u of the latter's |A-C|_inf over the depth. The evaluation is as
// long as before. An edge form's own 93u (above) and 12u are within kEdgeMargin; the leans' parts
// have several times as much room.
//
// Thread safety: constants only.
#ifndef SIGHTLINE_CORE_SHAFT_MARGINS_H_
#define SIGHTLINE_CORE_SHAFT_MARGINS_H_

namespace sightline {

inline constexpr float kSlopeMargin = 64 * 0x1p-24f;
inline constexpr float kOutlineMargin = 96 * 0x1p-24f;
inline constexpr float kCornerMargin = 128 * 0x1p-24f;
inline constexpr float kMinCornerShare = 0.25f;
inline constexpr float kBoxMargin = 32 * 0x1p-24f;
inline constexpr float kDepthScale = 1 + 32 * 0x1p-24f;
inline constexpr float kEdgeMargin = 128 * 0x1p-24f;
inline constexpr float kEdgeUnderflow = 0x1p-80f;
inline constexpr float kLeastDepth = 0x1p-60f;
inline constexpr float kLeastOffset = 0x1p-100f;
inline constexpr float kInverseMargin = 16 * 0x1p-24f;
inline constexpr float kParallelUnits = 12 * 0x1p-24f;
inline constexpr float kCapMargin = 5 * 0x1p-24f;
inline constexpr float kCentreUnits = 12 * 0x1p-24f;
inline constexpr float kLeanUnits = 32 * 0x1p-24f;
inline constexpr float kRestScale = 1 + 32 * 0x1p-24f;
inline constexpr float kRestPerDepth = 8;

}  // namespace sightline

#endif  // SIGHTLINE_CORE_SHAFT_MARGINS_H_
