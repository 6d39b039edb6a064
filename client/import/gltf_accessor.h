// SPDX-License-Identifier: Apache-2.0
//
// Checked reading of one glTF accessor: every element that it claims lies within its buffer view,
// and the view within its buffer, before the first is read. Elements are read on demand, so that
// nothing is allocated by a count.
//
// Invariant: for i < count(), every read stays within the model's buffers.
//
// Thread safety: immutable; the model must outlive it.
//
//   absl::StatusOr<GltfAccessor> positions =
//       GltfAccessor::Open(model, primitive.attributes["POSITION"], BufferBytes(model));
//   Vec3d p = positions->Position(7);
#ifndef SIGHTLINE_CLIENT_IMPORT_GLTF_ACCESSOR_H_
#define SIGHTLINE_CLIENT_IMPORT_GLTF_ACCESSOR_H_

#include <cstddef>
#include <cstdint>

#include "absl/status/statusor.h"
#include "core/geometry/vec3.h"

namespace sightline_tinygltf {
class Model;
}

namespace sightline {

// Of all the model's buffers together.
uint64_t BufferBytes(const sightline_tinygltf::Model& model);

class GltfAccessor {
 public:
  // InvalidArgument, naming the accessor, for whatever reaches out of its place. `buffer_bytes` is
  // BufferBytes(model), which whoever opens many accessors asks for once.
  static absl::StatusOr<GltfAccessor> Open(const sightline_tinygltf::Model& model, int number,
                                           uint64_t buffer_bytes);

  // InvalidArgument unless it holds what an index list, or a list of positions, may hold.
  absl::Status CheckIndices() const;
  absl::Status CheckPositions() const;

  uint64_t count() const { return count_; }
  // Elements that replace others (a sparse accessor's); 0 otherwise.
  uint64_t sparse_count() const { return sparse_count_; }

  // REQUIRES: CheckIndices() is OK, i < count().
  uint64_t Index(uint64_t i) const;
  // REQUIRES: CheckPositions() is OK, i < count(). Normalized integers as the specification maps
  // them, in doubles: c / 127, c / 255, ..., not below -1.
  Vec3d Position(uint64_t i) const;

 private:
  // A run of elements in a buffer.
  struct Run {
    const uint8_t* data = nullptr;  // Null: all zero.
    size_t stride = 0;
  };
  static absl::StatusOr<Run> OpenRun(const sightline_tinygltf::Model& model, int view,
                                     uint64_t offset, uint64_t count, size_t element_size,
                                     bool may_stride);
  // Where element i is stored: among the replacements or in the base; null for zeros.
  const uint8_t* Element(uint64_t i) const;
  double Component(const uint8_t* at) const;

  int number_ = 0;
  int component_type_ = 0;
  int components_ = 0;
  bool normalized_ = false;
  uint64_t count_ = 0;
  Run base_;
  uint64_t sparse_count_ = 0;
  int sparse_index_type_ = 0;
  Run sparse_indices_, sparse_values_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_GLTF_ACCESSOR_H_
