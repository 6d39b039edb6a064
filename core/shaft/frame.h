// SPDX-License-Identifier: Apache-2.0
//
// A shaft's frame: an orthonormal basis at the rays' common origin, whose third axis runs along the
// rays. A ray of direction D has depth w·D and slopes (u·D)/(w·D), (v·D)/(w·D); rays that belong
// together fill a rectangle of slopes. The frame is projective: it only holds rays whose depth is a
// good part of their length (kMinDepthShare).
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_SHAFT_FRAME_H_
#define SIGHTLINE_CORE_SHAFT_FRAME_H_

#include <cmath>

#include "core/geometry/vec3.h"

namespace sightline {

struct ShaftFrame {
  Vec3f u, v, w;  // As stored these define the frame; orthonormal up to 2^-22.
};

// The least w·D / |D| a shaft's rays may have: cos 66.4°. Slopes then stay below 2.3; wider
// sets are cut.
inline constexpr float kMinDepthShare = 0.4f;
inline constexpr float kMaxSlope = 2.3f;
// The most that both slopes' squares may add up to for that: |D|² = (w·D)²(1 + x² + y²). Less by a
// hundredth, where slopes and squares lose some 2^-20 in rounding.
inline constexpr float kMostSquaredSlopes = 1 / (kMinDepthShare * kMinDepthShare) - 1 - 0.01f;

// `axis`: where the rays lead, of any length but zero. `sideways`: a direction that u should
// follow, so that slope rectangles fit what is asked about (an image row); along `axis` or zero,
// any u will do. Returns false, and no frame, if `axis` has no direction.
inline bool MakeShaftFrame(Vec3d axis, Vec3d sideways, ShaftFrame* frame) {
  const double squared = Dot(axis, axis);
  if (!(squared > 0) || !std::isfinite(squared)) return false;
  // Across the axis, times its squared length, so that u need not wait for w.
  Vec3d u = sideways * squared - axis * Dot(axis, sideways);
  const Vec3d w = axis * (1.0 / std::sqrt(squared));
  // Cancellation leaves noise where `sideways` is nearly along the axis: then the coordinate axis
  // farthest from w. From kLeastShare on what is left of w in u is some 2^-32, a double's rounding
  // over that share: far below what floats hold of a frame.
  constexpr double kLeastShare = 0x1p-20;
  double kept = Dot(u, u);
  if (!(kept > kLeastShare * kLeastShare * squared * squared * Dot(sideways, sideways))) {
    const Vec3d a = {std::abs(w.x), std::abs(w.y), std::abs(w.z)};
    const Vec3d e = a.x <= a.y && a.x <= a.z ? Vec3d{1, 0, 0}
                    : a.y <= a.z             ? Vec3d{0, 1, 0}
                                             : Vec3d{0, 0, 1};
    u = e - w * Dot(w, e);
    kept = Dot(u, u);
  }
  u = u * (1.0 / std::sqrt(kept));
  frame->w = ToFloat(w);
  frame->u = ToFloat(u);
  frame->v = ToFloat(Cross(w, u));
  return true;
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_SHAFT_FRAME_H_
