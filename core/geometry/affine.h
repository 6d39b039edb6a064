// SPDX-License-Identifier: Apache-2.0
//
// Affine maps of world space in doubles: an object's placement. Row-major 3×4, p ↦ M·p + t.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_GEOMETRY_AFFINE_H_
#define SIGHTLINE_CORE_GEOMETRY_AFFINE_H_

#include <array>

#include "core/geometry/vec3.h"

namespace sightline {

struct Affine3d {
  // Row r is m[4r .. 4r+2], its translation m[4r+3].
  std::array<double, 12> m{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

  static Affine3d Identity() { return {}; }
  bool IsIdentity() const { return *this == Identity(); }

  // ((x·m0 + y·m1) + z·m2) + t per component, in this order. The identity returns p itself.
  Vec3d Apply(Vec3d p) const {
    return {((p.x * m[0] + p.y * m[1]) + p.z * m[2]) + m[3],
            ((p.x * m[4] + p.y * m[5]) + p.z * m[6]) + m[7],
            ((p.x * m[8] + p.y * m[9]) + p.z * m[10]) + m[11]};
  }
  friend bool operator==(const Affine3d&, const Affine3d&) = default;
};

// The map that applies `inner` first, then `outer`.
inline Affine3d Compose(const Affine3d& outer, const Affine3d& inner) {
  Affine3d r;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 4; ++j) {
      double s = (outer.m[4 * i] * inner.m[j] + outer.m[4 * i + 1] * inner.m[4 + j]) +
                 outer.m[4 * i + 2] * inner.m[8 + j];
      r.m[4 * i + j] = j == 3 ? s + outer.m[4 * i + 3] : s;
    }
  }
  return r;
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_GEOMETRY_AFFINE_H_
