// SPDX-License-Identifier: Apache-2.0
#include "core/accel/leaf_rows.h"

#include <array>
#include <cstring>

#include "core/accel/bvh.h"
#include "core/geometry/float4.h"

namespace sightline {

// Four triangles at a time: their corners are transposed in registers.
void WriteLeafRows(const SceneGeometry& geometry, std::span<const uint32_t> ids, size_t stride,
                   float* rows) {
  const auto store = [](float* to, Float4 v) { std::memcpy(to, &v, sizeof(v)); };
  for (size_t first = 0; first < stride; first += kUnitTriangles) {
    Float4 corners[3][kUnitTriangles] = {};
    uint32_t unit_ids[kUnitTriangles] = {kNoTriangle, kNoTriangle, kNoTriangle, kNoTriangle};
    for (size_t lane = 0; lane < kUnitTriangles && first + lane < ids.size(); ++lane) {
      const uint32_t id = ids[first + lane];
      unit_ids[lane] = id;
      const std::array<uint32_t, 3>& triangle = geometry.triangles[id];
      for (size_t c = 0; c < 3; ++c) {
        corners[c][lane] = LoadVertex(geometry.vertices[triangle[c]]);
      }
    }
    for (size_t c = 0; c < 3; ++c) {
      const auto& v = corners[c];
      const Float4 xy01 = __builtin_shufflevector(v[0], v[1], 0, 4, 1, 5);
      const Float4 xy23 = __builtin_shufflevector(v[2], v[3], 0, 4, 1, 5);
      const Float4 z01 = __builtin_shufflevector(v[0], v[1], 2, 6, 2, 6);
      const Float4 z23 = __builtin_shufflevector(v[2], v[3], 2, 6, 2, 6);
      float* const row = rows + 3 * c * stride + first;
      store(row, __builtin_shufflevector(xy01, xy23, 0, 1, 4, 5));
      store(row + stride, __builtin_shufflevector(xy01, xy23, 2, 3, 6, 7));
      store(row + 2 * stride, __builtin_shufflevector(z01, z23, 0, 1, 4, 5));
    }
    std::memcpy(rows + 9 * stride + first, unit_ids, sizeof(unit_ids));
  }
}

}  // namespace sightline
