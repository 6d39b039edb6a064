// SPDX-License-Identifier: Apache-2.0
//
// The triangles that the leaves of a tree name, corners and boxes beside each other, for trees
// whose leaves are ranges of ids of any length (binary_bvh.h, kd_tree.h). Built once from the
// tree's array of ids, so that a walk reads a leaf's triangles in order instead of gathering them.
//
// Layout: `rows` are the ten rows of a BVH's leaf (core/accel/bvh.h), each `stride` floats long,
// and `boxes` six more: lower faces by axis, then upper ones. Place i of each row is that of
// ids[i]: sixteen from any place may be loaded, those past the end being unused ones (id
// kNoTriangle, boxes empty). A tree that names a triangle twice has it twice.
//
// Thread safety: immutable after construction.
//
//   const LeafTriangles leaves = MakeLeafTriangles(geometry, tree.ids);
//   const float* first_x = leaves.rows.data() + leaf.first;
#ifndef SIGHTLINE_CORE_ACCEL_LEAF_TRIANGLES_H_
#define SIGHTLINE_CORE_ACCEL_LEAF_TRIANGLES_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/accel/bvh.h"
#include "core/base/aligned_vector.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

inline constexpr size_t kLeafTriangleBytes = 16 * sizeof(float);  // A triangle named.
// What is held beyond those, at most.
inline constexpr size_t kMostLeafPaddingBytes = (2 * kLeafPadding - 1) * kLeafTriangleBytes;

struct LeafTriangles {
  AlignedVector<float> rows;   // 10 × stride: 40 bytes a triangle named.
  AlignedVector<float> boxes;  // 6 × stride: 24 bytes, as paper 001 counts them.
  size_t stride = 0;

  size_t MemoryBytes() const { return (rows.size() + boxes.size()) * sizeof(float); }
};

// Runs in parallel within the pool of the calling thread. Boxes are minima and maxima of stored
// floats: exact.
LeafTriangles MakeLeafTriangles(const SceneGeometry& geometry, std::span<const uint32_t> ids);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_LEAF_TRIANGLES_H_
