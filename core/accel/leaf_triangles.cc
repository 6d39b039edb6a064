// SPDX-License-Identifier: Apache-2.0
#include "core/accel/leaf_triangles.h"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>

#include "core/accel/bvh.h"
#include "core/base/parallel.h"
#include "core/geometry/box3.h"

namespace sightline {
namespace {

constexpr size_t kGrain = 1 << 14;

}  // namespace

LeafTriangles MakeLeafTriangles(const SceneGeometry& geometry, std::span<const uint32_t> ids) {
  LeafTriangles leaves;
  leaves.stride = (ids.size() + 2 * kLeafPadding - 1) / kLeafPadding * kLeafPadding;
  const size_t stride = leaves.stride;
  leaves.rows.resize(kLeafRows * stride, 0.0f);
  leaves.boxes.ResizeUninitialized(6 * stride);
  float* const rows = leaves.rows.data();
  float* const boxes = leaves.boxes.data();
  ParallelFor(stride, kGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      Box3f box;
      uint32_t id = kNoTriangle;
      if (i < ids.size()) {
        id = ids[i];
        const std::array<Vec3f, 3> corners = geometry.Corners(id);
        for (size_t c = 0; c < 3; ++c) {
          box.Extend(corners[c]);
          for (int k = 0; k < 3; ++k) rows[(3 * c + k) * stride + i] = corners[c][k];
        }
      }
      rows[9 * stride + i] = std::bit_cast<float>(id);
      for (int k = 0; k < 3; ++k) {
        boxes[k * stride + i] = box.lo[k];
        boxes[(3 + k) * stride + i] = box.hi[k];
      }
    }
  });
  return leaves;
}

}  // namespace sightline
