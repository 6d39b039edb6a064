// SPDX-License-Identifier: Apache-2.0
//
// The box of what of a triangle lies in a box: what perfect splits keep of it. Private to
// core/accel.
//
// Conservative: the result holds every point that is in both, exactly (kClipPad). Coordinates
// within 2^41.
//
// Thread safety: functions only.
//
//   Box3f left = ClipToBox(geometry.Corners(id), cell);  // Empty: the triangle is not in the cell.
#ifndef SIGHTLINE_CORE_ACCEL_KD_CLIP_H_
#define SIGHTLINE_CORE_ACCEL_KD_CLIP_H_

#include <array>

#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"

namespace sightline {

// How far the box is widened before the triangle is cut to it, and the result afterwards, in units
// of the largest coordinate S. A cut replaces a corner by p + (q - p)·f with 0 <= f <= 1 in
// doubles: difference, product and sum round by u = 2^-53 each, of at most 2S, 2S and S, and the
// error of f, which carries three roundings, moves the point along the edge by at most 3u·2S in
// each coordinate: 11uS. Corners move no further than that from the polygon they cut, and six cuts
// follow one another: kClipError. So what is in both lies more than that inside every widened
// plane, and within that of the polygon computed. The pad is four times as large, so that whoever
// checks what a pad has made, with errors of its own, can tell for certain: ClipMisses, ClipHolds.
inline constexpr double kClipError = 66 * 0x1p-53;
inline constexpr double kClipPad = 0x1p-45;
static_assert(kClipPad > 3.5 * kClipError);

// Within `box`, rounded outward. Empty if nothing of the triangle is in the box.
Box3f ClipToBox(const std::array<Vec3f, 3>& corners, const Box3f& box);

// Whether surely nothing of the triangle is in `box`, which its own box holds. True of every part
// of a box whose ClipToBox is empty.
bool ClipMisses(const std::array<Vec3f, 3>& corners, const Box3f& box);

// Whether `kept` surely holds what of the triangle is in `box`, which its own box holds. True of
// ClipToBox of any box around `box`, cut to `box`, and of ClipToBox of parts of it that hold what
// of the triangle is in it.
bool ClipHolds(const std::array<Vec3f, 3>& corners, const Box3f& box, const Box3f& kept);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_KD_CLIP_H_
