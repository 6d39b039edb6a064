// SPDX-License-Identifier: Apache-2.0
//
// Puts one object together from its header and chunks. Trusts no count: memory grows with what
// arrives, never with what was announced.
//
// Invariant: what is held never exceeds the announced counts, which never exceed the limits.
//
// Thread safety: one thread at a time.
//
//   ObjectAssembler assembler;
//   SL_RETURN_IF_ERROR(assembler.Start(header));
//   SL_RETURN_IF_ERROR(assembler.Add(chunk));
//   if (assembler.complete()) objects.push_back(assembler.Take());
#ifndef SIGHTLINE_SERVER_SCENES_OBJECT_ASSEMBLER_H_
#define SIGHTLINE_SERVER_SCENES_OBJECT_ASSEMBLER_H_

#include <cstdint>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "core/mesh/object.h"
#include "sightline/v1/scene_service.pb.h"

namespace sightline {

// InvalidArgument for a name longer than any object's; `field` is where it stands.
absl::Status CheckObjectName(absl::string_view field, absl::string_view name);

// What the assembler will hold of a chunk.
uint64_t BytesOf(const v1::MeshChunk& chunk);

class ObjectAssembler {
 public:
  // Begins an object, whatever was there before.
  absl::Status Start(const v1::ObjectHeader& header);
  // Begins new vertices for an object that exists.
  absl::Status StartVertices(const std::string& name, uint64_t vertex_count);
  absl::Status Add(const v1::MeshChunk& chunk);

  bool started() const { return started_; }
  bool complete() const {
    return object_.vertices.size() == vertex_count_ &&
           object_.indices.size() == 3 * triangle_count_;
  }
  // InvalidArgument saying what is missing; OK when nothing is, or nothing was started.
  absl::Status CheckComplete() const;
  // REQUIRES: started() and complete().
  ObjectInput Take();

 private:
  enum class Form { kUnknown, kDouble, kFloat };

  absl::Status AddFloatVertices(const std::string& bytes);

  ObjectInput object_;
  uint64_t vertex_count_ = 0, triangle_count_ = 0;
  Form form_ = Form::kUnknown;
  bool started_ = false;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SCENES_OBJECT_ASSEMBLER_H_
