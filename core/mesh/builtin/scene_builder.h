// SPDX-License-Identifier: Apache-2.0
//
// What a scene's generator writes to: objects by name, and the two questions that make its size a
// parameter, "how finely?" (Steps) and "how many?" (Items). Both grow with the scene's `detail`: 1
// is the scene as it was drawn, and the number of triangles is about proportional to it.
//
// Numbers are rounded up or down by a hash of the object's name and of the number, so that equal
// things do not all become finer at the same detail, and a budget can be met closely; the order of
// the questions does not matter (that of a call's arguments is open in C++). A builder without
// objects counts only, and so does one whose scene nobody wants any more.
//
// Thread safety: one thread per builder.
//
//   MeshBuilder& mesh = scene.Object("column-3");
//   AddLathe(mesh, ..., scene.Steps(24, 6));
#ifndef SIGHTLINE_CORE_MESH_BUILTIN_SCENE_BUILDER_H_
#define SIGHTLINE_CORE_MESH_BUILTIN_SCENE_BUILDER_H_

#include <bit>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/cancel.h"
#include "core/base/mix_bits.h"
#include "core/mesh/builtin/deterministic_math.h"
#include "core/mesh/builtin/mesh_builder.h"
#include "core/mesh/builtin/prng.h"

namespace sightline {

class SceneBuilder {
 public:
  // `objects` is appended to; null: count only. From the next object on, once `cancel` (may be
  // null) stops, nothing more is appended. REQUIRES: detail > 0.
  SceneBuilder(double detail, uint64_t seed, std::vector<ObjectInput>* objects,
               const CancelToken* cancel = nullptr)
      : detail_(detail),
        root_(std::sqrt(detail)),
        seed_(seed),
        cancel_(cancel),
        objects_(objects) {}

  uint64_t seed() const { return seed_; }
  double detail() const { return detail_; }
  bool counting() const { return objects_ == nullptr; }

  // Starts the next object, and from here on rounds for it: never call it among the arguments of a
  // call that also asks for Steps, Items or Swarm, whose order is open. The reference stays valid
  // until the next call. Names must be unique.
  MeshBuilder& Object(std::string_view name) {
    Close();
    object_key_ = HashString(name);
    if (cancel_ != nullptr && cancel_->cancelled()) objects_ = nullptr;
    ObjectInput* object = nullptr;
    if (objects_ != nullptr) {
      object = &objects_->emplace_back();
      object->name = std::string(name);
    }
    return mesh_.emplace(object);
  }
  MeshBuilder& Object(std::string_view name, int index) {
    return Object(std::string(name) + "-" + std::to_string(index));
  }

  // Subdivisions along one direction: base · √detail, at least `least`.
  int Steps(double base, int least) const { return Round(base, base * root_, least, 4096); }
  // A number of things, `least` .. `most`: base · √detail.
  int Items(double base, int least, int most) const {
    return Round(base, base * root_, least, most);
  }
  // A number of things that take all of the growth: base · detail.
  int Swarm(double base, int least) const { return Round(base, base * detail_, least, 1 << 24); }

  // All objects so far. REQUIRES: nothing is added after it but through Object.
  uint64_t Triangles() {
    Close();
    return triangles_;
  }

 private:
  int Round(double base, double value, int least, int most) const {
    const uint64_t hash = MixBits(object_key_ ^ MixBits(std::bit_cast<uint64_t>(base)));
    const double dither = static_cast<double>(hash >> 11) * 0x1p-53;
    return static_cast<int>(Clamp(std::floor(value + dither), least, most));
  }
  void Close() {
    if (!mesh_.has_value()) return;
    mesh_->Finish();
    triangles_ += mesh_->triangles();
    mesh_.reset();
  }

  const double detail_;
  const double root_;
  const uint64_t seed_;
  const CancelToken* const cancel_;
  std::vector<ObjectInput>* objects_;
  std::optional<MeshBuilder> mesh_;
  uint64_t triangles_ = 0;
  uint64_t object_key_ = 0;  // A hash of the open object's name.
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_BUILTIN_SCENE_BUILDER_H_
