// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kd_clip.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace sightline {
namespace {

// A triangle cut by six planes has at most nine corners; rounding may add some to a needle.
constexpr int kMaxCorners = 24;
struct Polygon {
  Vec3d corner[kMaxCorners];
  int count = 0;
};

// Keeps what has sign·x[axis] <= sign·at. Keeps all where there is no room for the result.
void Cut(int axis, double sign, double at, Polygon* polygon) {
  const Polygon before = *polygon;
  if (2 * before.count > kMaxCorners) return;
  polygon->count = 0;
  for (int i = 0; i < before.count; ++i) {
    const Vec3d& p = before.corner[i];
    const Vec3d& q = before.corner[i + 1 == before.count ? 0 : i + 1];
    const double dp = sign * (p[axis] - at), dq = sign * (q[axis] - at);
    if (dp <= 0) polygon->corner[polygon->count++] = p;
    if ((dp < 0 && dq > 0) || (dp > 0 && dq < 0)) {
      const double f = dp / (dp - dq);
      polygon->corner[polygon->count++] = p + f * (q - p);
    }
  }
}

float RoundDown(double x) {
  const float f = static_cast<float>(x);
  return static_cast<double>(f) <= x ? f
                                     : std::nextafter(f, -std::numeric_limits<float>::infinity());
}
float RoundUp(double x) {
  const float f = static_cast<float>(x);
  return static_cast<double>(f) >= x ? f
                                     : std::nextafter(f, std::numeric_limits<float>::infinity());
}

// The largest coordinate, S.
double LargestOf(const std::array<Vec3f, 3>& corners, const Box3f& box) {
  double largest = std::max<double>(MaxAbs(box.lo), MaxAbs(box.hi));
  for (const Vec3f& corner : corners) {
    largest = std::max(largest, static_cast<double>(MaxAbs(corner)));
  }
  return largest;
}

// The hull of the triangle cut to `box` widened by `pad`; empty if nothing is left.
Box3d HullOfCut(const std::array<Vec3f, 3>& corners, const Box3f& box, double pad) {
  Polygon polygon;
  for (const Vec3f& corner : corners) polygon.corner[polygon.count++] = ToDouble(corner);
  for (int axis = 0; axis < 3 && polygon.count > 0; ++axis) {
    Cut(axis, 1, static_cast<double>(box.hi[axis]) + pad, &polygon);
    Cut(axis, -1, static_cast<double>(box.lo[axis]) - pad, &polygon);
  }
  Box3d hull;
  for (int i = 0; i < polygon.count; ++i) hull.Extend(polygon.corner[i]);
  return hull;
}

// Barely above the error: what the cut then leaves out is not in the box, and what a pad was wide
// enough to hold is held by more than the error twice.
constexpr double kCheckPad = 1.03 * kClipError;

}  // namespace

Box3f ClipToBox(const std::array<Vec3f, 3>& corners, const Box3f& box) {
  const double pad = kClipPad * LargestOf(corners, box);
  const Box3d hull = HullOfCut(corners, box, pad);
  Box3f clipped;
  if (hull.empty()) return clipped;
  for (int axis = 0; axis < 3; ++axis) {
    const float lo = std::max(box.lo[axis], RoundDown(hull.lo[axis] - pad));
    const float hi = std::min(box.hi[axis], RoundUp(hull.hi[axis] + pad));
    if (lo > hi) return Box3f();  // Only the padding reached it.
    clipped.lo[axis] = lo;
    clipped.hi[axis] = hi;
  }
  return clipped;
}

bool ClipMisses(const std::array<Vec3f, 3>& corners, const Box3f& box) {
  return HullOfCut(corners, box, kCheckPad * LargestOf(corners, box)).empty();
}

bool ClipHolds(const std::array<Vec3f, 3>& corners, const Box3f& box, const Box3f& kept) {
  const double largest = LargestOf(corners, box);
  const Box3d hull = HullOfCut(corners, box, kCheckPad * largest);
  if (hull.empty()) return true;
  const double off = kClipError * largest;
  for (int axis = 0; axis < 3; ++axis) {
    if (kept.lo[axis] > box.lo[axis] && !(hull.lo[axis] >= kept.lo[axis] + off)) return false;
    if (kept.hi[axis] < box.hi[axis] && !(hull.hi[axis] <= kept.hi[axis] - off)) return false;
  }
  return true;
}

}  // namespace sightline
