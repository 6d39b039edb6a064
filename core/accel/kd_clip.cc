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

}  // namespace

Box3f ClipToBox(const std::array<Vec3f, 3>& corners, const Box3f& box) {
  Polygon polygon;
  double largest = 0;
  for (const Vec3f& corner : corners) {
    polygon.corner[polygon.count++] = ToDouble(corner);
    largest = std::max(largest, static_cast<double>(MaxAbs(corner)));
  }
  largest = std::max<double>({largest, MaxAbs(box.lo), MaxAbs(box.hi)});
  const double pad = kClipPad * largest;
  for (int axis = 0; axis < 3 && polygon.count > 0; ++axis) {
    Cut(axis, 1, static_cast<double>(box.hi[axis]) + pad, &polygon);
    Cut(axis, -1, static_cast<double>(box.lo[axis]) - pad, &polygon);
  }
  Box3f clipped;
  if (polygon.count == 0) return clipped;
  Box3d hull;
  for (int i = 0; i < polygon.count; ++i) hull.Extend(polygon.corner[i]);
  for (int axis = 0; axis < 3; ++axis) {
    const float lo = std::max(box.lo[axis], RoundDown(hull.lo[axis] - pad));
    const float hi = std::min(box.hi[axis], RoundUp(hull.hi[axis] + pad));
    if (lo > hi) return Box3f();  // Only the padding reached it.
    clipped.lo[axis] = lo;
    clipped.hi[axis] = hi;
  }
  return clipped;
}

}  // namespace sightline
