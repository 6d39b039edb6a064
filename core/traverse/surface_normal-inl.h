// SPDX-License-Identifier: Apache-2.0
//
// Which way the surface faces that points lie on, told from a few of them.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_SURFACE_NORMAL_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SURFACE_NORMAL_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SURFACE_NORMAL_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SURFACE_NORMAL_INL_H_
#endif

#include <algorithm>
#include <cstdint>

#include "core/geometry/vec3.h"
#include "core/mesh/scene_geometry.h"
#include "core/traverse/shaft_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

// Normals that add up to less are of no surface that is flat.
constexpr double kFlat = 0.125;

// Normals of the surface under some of `count` points, each at the scale of its largest component,
// turned `along`, and added up: no component is above 2. Of their source triangles (null: none is
// known), or as neighbouring points have it where no source is known: points come in fours by four,
// row by row or along a Morton curve.
inline Vec3d SumOfNormals(const SceneGeometry& geometry, const uint32_t* sources,
                          const float* const (&rows)[3], int count, Vec3d along) {
  const auto point = [&](int lane) {
    lane = std::min(lane, count - 1);
    return Vec3d{rows[0][lane], rows[1][lane], rows[2][lane]};
  };
  Vec3d sum;
  for (int k = 2; k < 8; k += 4) {
    const int lane = count * k / 8;
    Vec3d n;
    if (sources != nullptr && sources[lane] < geometry.triangles.size()) {
      const auto [a, b, c] = geometry.Corners(sources[lane]);
      const Vec3d ad = ToDouble(a);
      n = Cross(ToDouble(b) - ad, ToDouble(c) - ad);
    } else {
      const int first = lane / kShaftBlockRays * kShaftBlockRays;
      const Vec3d p = point(first);
      // A row and a column of either order; the other's three points are in line.
      n = Cross(point(first + 3) - p, point(first + 12) - p);
      const Vec3d m = Cross(point(first + 5) - p, point(first + 10) - p);
      if (Dot(m, m) > Dot(n, n)) n = m;
    }
    const double size = MaxAbs(n);
    if (size > 0) sum = sum + n * ((Dot(n, along) < 0 ? -1.0 : 1.0) / size);
  }
  return sum;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
