// SPDX-License-Identifier: Apache-2.0
//
// Caps across the axes: how far along x, y and z the points reach that a set's rays end at, or
// begin at, on the side that the rays do not lead to. A triangle that stays behind such a cap
// blocks none of the rays, and neither does one that touches it: so a level floor that points stand
// on is left out whole, which lies in its own plane and is in doubt for every cull that carries a
// margin.
//
// Why touching does not count. A blocked segment has its ends strictly on opposite sides of the
// triangle's plane (core/intersect/predicate.h), so it passes the triangle at a point X strictly
// between them. If s·O > c and s·P >= c along an axis, for s = 1 or -1, then s·X > c, and no
// triangle that has s·x <= c at its corners holds X. A ray that leads from P along D is blocked at
// P + t·D with t > 0: the same where s·D > 0. Coordinates are compared as they are stored; nothing
// is rounded, and there is no margin.
//
// Thread safety: pure functions and plain values.

#if defined(SIGHTLINE_CORE_SHAFT_AXIS_CAPS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_SHAFT_AXIS_CAPS_INL_H_
#undef SIGHTLINE_CORE_SHAFT_AXIS_CAPS_INL_H_
#else
#define SIGHTLINE_CORE_SHAFT_AXIS_CAPS_INL_H_
#endif

#include <limits>

#include "core/geometry/vec3.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// One for each axis k: nothing matters that has sign[k]·x <= at[k] throughout. As they are made,
// they hold back nothing.
struct AxisCaps {
  float sign[3] = {1, 1, 1};
  float at[3] = {-std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity(),
                 -std::numeric_limits<float>::infinity()};
  // Rows of a box (least x, y, z, largest x, y, z) where sign·x is largest.
  int face[3] = {3, 4, 5};

  // Caps an axis for segments on whose points sign·x is at least `least`, and on whose other ends
  // `least_end`; `up` says that the sign is positive.
  void CapSegments(int axis, bool up, float least, float least_end) {
    if (least < least_end) Place(axis, up, least);
  }
  // The same for rays along a direction, whose sign is the cap's.
  void CapRays(int axis, float least, float direction) {
    if (direction != 0) Place(axis, direction > 0, least);
  }

  void Place(int axis, bool up, float least) {
    sign[axis] = up ? 1.0f : -1.0f;
    face[axis] = axis + (up ? 3 : 0);
    at[axis] = least;
  }
};

// The boxes that reach beyond all caps. `faces` has a row for each face, with a lane for each box.
template <class D>
HWY_INLINE hn::Mask<D> BeyondCaps(D d, const AxisCaps& caps,
                                  const float (*faces)[hn::MaxLanes(D())]) {
  const auto reach = [&](int k) HWY_ATTR {
    // A difference of floats has the right sign however it is rounded, as subnormals are kept
    // (core/base/float_environment.h).
    const D lanes;
    return hn::MulSub(hn::Load(lanes, faces[caps.face[k]]), hn::Set(lanes, caps.sign[k]),
                      hn::Set(lanes, caps.at[k]));
  };
  return hn::Gt(hn::Min(hn::Min(reach(0), reach(1)), reach(2)), hn::Zero(d));
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
