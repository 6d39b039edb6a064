// SPDX-License-Identifier: Apache-2.0
//
// Any bytes through the mesh readers: an error or a scene that keeps its promises (import_types.h),
// never a crash. The first byte chooses the reader, '0' to '8' in the seed corpus; the rest is the
// file.
//
// assimp is left out: its readers are known to crash on hostile files, which is why they run in a
// child process; a fuzzer would only find assimp's bugs. What the child sends back is covered here
// ('8').
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <set>
#include <string>
#include <string_view>

#include "client/import/decompress.h"
#include "client/import/import.h"
#include "client/import/ply_reader.h"
#include "client/import/scene_wire.h"

namespace sightline {
namespace {

// Small, so that a limit is reached by small files too.
constexpr uint64_t kMaxBytes = uint64_t{1} << 20;
constexpr uint64_t kMaxTriangles = 5000;

void Require(bool condition) {
  if (!condition) std::abort();
}

bool SameBits(const ImportedScene& a, const ImportedScene& b) {
  if (a.objects.size() != b.objects.size() || a.report != b.report) return false;
  for (size_t i = 0; i < a.objects.size(); ++i) {
    const ObjectInput& p = a.objects[i];
    const ObjectInput& q = b.objects[i];
    const size_t bytes = p.vertices.size() * sizeof(Vec3d);
    if (p.name != q.name || p.indices != q.indices || p.vertices.size() != q.vertices.size() ||
        (bytes > 0 && std::memcmp(p.vertices.data(), q.vertices.data(), bytes) != 0)) {
      return false;
    }
  }
  return true;
}

void CheckScene(const ImportedScene& scene) {
  uint64_t triangles = 0;
  std::set<std::string> names;
  for (const ObjectInput& object : scene.objects) {
    Require(!object.indices.empty() && object.indices.size() % 3 == 0);
    triangles += object.indices.size() / 3;
    for (const uint32_t i : object.indices) Require(i < object.vertices.size());
    for (const Vec3d& v : object.vertices) {
      Require(IsFinite(v) || (v.x != v.x && v.y != v.y && v.z != v.z));
    }
    Require(!object.name.empty() && names.insert(object.name).second);
  }
  Require(triangles > 0 && triangles <= kMaxTriangles && triangles == scene.report.triangles);
}

void ReadMesh(std::string_view bytes, MeshFormat format) {
  ImportOptions options;
  options.max_file_bytes = kMaxBytes;
  options.max_triangles = kMaxTriangles;
  options.name = "fuzz";
  const absl::StatusOr<ImportedScene> scene = ImportBytes(bytes, format, options);
  if (!scene.ok()) {
    Require(scene.status().message().find('\n') == absl::string_view::npos);
    return;
  }
  CheckScene(*scene);
  const absl::StatusOr<ImportedScene> again = ImportBytes(bytes, format, options);
  Require(again.ok() && SameBits(*scene, *again));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size == 0) return 0;
  const std::string_view bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  switch (static_cast<uint8_t>(data[0] - '0') % 9) {
    case 0:
      ReadMesh(bytes, MeshFormat::kObj);
      break;
    case 1:
      ReadMesh(bytes, MeshFormat::kPly);
      (void)ReadPlyPoints(bytes);
      break;
    case 2:
      ReadMesh(bytes, MeshFormat::kStl);
      break;
    case 3:
      ReadMesh(bytes, MeshFormat::kOff);
      break;
    case 4:
      ReadMesh(bytes, MeshFormat::kGltf);
      break;
    case 5:
      ReadMesh(bytes, MeshFormat::kGlb);
      break;
    case 6: {
      const absl::StatusOr<std::string> plain = DecompressXz(bytes, kMaxBytes);
      Require(!plain.ok() || plain->size() <= kMaxBytes);
      break;
    }
    case 7: {
      const absl::StatusOr<std::string> plain = DecompressGzip(bytes, kMaxBytes);
      Require(!plain.ok() || plain->size() <= kMaxBytes);
      break;
    }
    default: {
      const absl::StatusOr<ImportedScene> scene = DecodeScene(bytes);
      if (!scene.ok()) break;
      for (const ObjectInput& object : scene->objects) {
        for (const uint32_t i : object.indices) Require(i < object.vertices.size());
      }
    }
  }
  return 0;
}

}  // namespace sightline
