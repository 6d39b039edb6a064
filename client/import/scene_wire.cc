// SPDX-License-Identifier: Apache-2.0
#include "client/import/scene_wire.h"

#include <cstring>
#include <type_traits>
#include <vector>

#include "client/import/text_scanner.h"

namespace sightline {
namespace {

// The counts that travel, in this order.
constexpr uint64_t ImportReport::*kCounts[] = {
    &ImportReport::polygons,           &ImportReport::polygons_fanned,
    &ImportReport::skipped_primitives, &ImportReport::faces_too_few_corners,
    &ImportReport::faces_bad_index,    &ImportReport::non_finite_vertices,
};

template <typename T>
void Put(const T* values, size_t count, std::string* out) {
  static_assert(std::is_trivially_copyable_v<T>);
  const uint64_t size = count;
  out->append(reinterpret_cast<const char*>(&size), sizeof(size));
  if (count > 0) out->append(reinterpret_cast<const char*>(values), count * sizeof(T));
}

class Reader {
 public:
  explicit Reader(std::string_view bytes) : bytes_(bytes) {}

  // Fails where a list is longer than the bytes that are left.
  template <typename Container>
  bool Get(Container* out) {
    using T = typename Container::value_type;
    uint64_t count = 0;
    if (!Take(sizeof(count), &count)) return false;
    if (count > bytes_.size() / sizeof(T)) return false;
    out->resize(count);
    return Take(count * sizeof(T), out->data());
  }
  bool GetBytes(size_t size, void* out) {
    uint64_t count = 0;
    return Take(sizeof(count), &count) && count == size && Take(size, out);
  }
  bool AtEnd() const { return bytes_.empty(); }
  size_t remaining() const { return bytes_.size(); }

 private:
  bool Take(size_t size, void* out) {
    if (size > bytes_.size()) return false;
    if (size > 0) std::memcpy(out, bytes_.data(), size);
    bytes_.remove_prefix(size);
    return true;
  }
  std::string_view bytes_;
};

bool DecodeObject(Reader* reader, ObjectInput* object) {
  if (!reader->Get(&object->name) || !reader->Get(&object->vertices) ||
      !reader->Get(&object->indices) ||
      !reader->GetBytes(sizeof(object->transform.m), object->transform.m.data())) {
    return false;
  }
  for (Vec3d& v : object->vertices) v = CanonicalVertex(v);
  for (const uint32_t i : object->indices) {
    if (i >= object->vertices.size()) return false;
  }
  return object->indices.size() % 3 == 0;
}

}  // namespace

std::string EncodeScene(const ImportedScene& scene) {
  std::string out;
  Put(scene.report.format.data(), scene.report.format.size(), &out);
  for (const auto count : kCounts) Put(&(scene.report.*count), 1, &out);
  const uint64_t objects = scene.objects.size();
  Put(&objects, 1, &out);
  for (const ObjectInput& object : scene.objects) {
    Put(object.name.data(), object.name.size(), &out);
    Put(object.vertices.data(), object.vertices.size(), &out);
    Put(object.indices.data(), object.indices.size(), &out);
    Put(reinterpret_cast<const char*>(object.transform.m.data()), sizeof(object.transform.m), &out);
  }
  return out;
}

absl::StatusOr<ImportedScene> DecodeScene(std::string_view bytes) {
  const absl::Status malformed = absl::DataLossError("made its reader answer with nonsense");
  Reader reader(bytes);
  ImportedScene scene;
  if (!reader.Get(&scene.report.format)) return malformed;
  std::vector<uint64_t> one;
  for (const auto count : kCounts) {
    if (!reader.Get(&one) || one.size() != 1) return malformed;
    scene.report.*count = one[0];
  }
  if (!reader.Get(&one) || one.size() != 1 || one[0] > reader.remaining()) return malformed;
  const uint64_t objects = one[0];
  for (uint64_t i = 0; i < objects; ++i) {
    ObjectInput object;
    if (!DecodeObject(&reader, &object)) return malformed;
    scene.objects.push_back(std::move(object));
  }
  if (!reader.AtEnd()) return malformed;
  return scene;
}

}  // namespace sightline
