// SPDX-License-Identifier: Apache-2.0
//
// Grows one object's arrays. A shape announces how many vertices and triangles it adds, then adds
// them by index, so vertices are shared, not repeated. Without an object it only counts: that is
// how a scene finds the tessellation that meets its budget before any vertex is made.
//
// Invariants: triangles() is what was announced; with an object, what was announced was added
// (Finish checks).
//
// Thread safety: one thread per builder.
//
//   if (!mesh.Begin(4, 2)) return;               // Counting only.
//   const uint32_t a = mesh.Vertex({0, 0, 0});   // ... b, c, d
//   mesh.Quad(a, b, c, d);
#ifndef SIGHTLINE_CORE_MESH_BUILTIN_MESH_BUILDER_H_
#define SIGHTLINE_CORE_MESH_BUILTIN_MESH_BUILDER_H_

#include <algorithm>
#include <cstdint>

#include "core/base/check.h"
#include "core/geometry/vec3.h"
#include "core/mesh/object.h"

namespace sightline {

class MeshBuilder {
 public:
  // `object` is appended to and outlives the builder; null: count only.
  explicit MeshBuilder(ObjectInput* object) : object_(object) {}

  bool counting() const { return object_ == nullptr; }
  uint64_t triangles() const { return triangles_; }

  // Announces a shape. False: it is only counted, add nothing.
  bool Begin(uint64_t vertices, uint64_t triangles) {
    vertices_ += vertices;
    triangles_ += triangles;
    if (counting()) return false;
    Grow(object_->vertices, vertices);
    Grow(object_->indices, 3 * triangles);
    return true;
  }

  // The index of a new vertex. REQUIRES: !counting().
  uint32_t Vertex(Vec3d p) {
    object_->vertices.push_back(p);
    return static_cast<uint32_t>(object_->vertices.size() - 1);
  }
  // `count` new vertices at once, for the caller to fill. REQUIRES: !counting().
  Vec3d* Vertices(uint64_t count) {
    const size_t first = object_->vertices.size();
    object_->vertices.resize(first + count);
    return object_->vertices.data() + first;
  }
  // The index that the next vertex gets. REQUIRES: !counting().
  uint32_t next() const { return static_cast<uint32_t>(object_->vertices.size()); }

  // Counter-clockwise seen from the front. REQUIRES: !counting().
  void Triangle(uint32_t a, uint32_t b, uint32_t c) {
    object_->indices.push_back(a);
    object_->indices.push_back(b);
    object_->indices.push_back(c);
  }
  void Quad(uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
    Triangle(a, b, c);
    Triangle(a, c, d);
  }

  // Checks that every shape added what it had announced.
  void Finish() const {
    if (counting()) return;
    SIGHTLINE_CHECK(object_->vertices.size() == vertices_);
    SIGHTLINE_CHECK(object_->indices.size() == 3 * triangles_);
  }

 private:
  // Doubles, as push_back would: reserving each small shape exactly would copy the array every
  // time.
  template <typename V>
  static void Grow(V& v, uint64_t more) {
    const uint64_t need = v.size() + more;
    if (need > v.capacity()) v.reserve(std::max<uint64_t>(need, 2 * v.capacity()));
  }

  ObjectInput* object_;
  uint64_t vertices_ = 0;
  uint64_t triangles_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_BUILTIN_MESH_BUILDER_H_
