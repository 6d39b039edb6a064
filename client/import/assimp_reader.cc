// SPDX-License-Identifier: Apache-2.0
#include "client/import/assimp_reader.h"

#include <assimp/scene.h>

#include <algorithm>
#include <assimp/Importer.hpp>
#include <stdexcept>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/import/child_process.h"
#include "client/import/object_assembly.h"
#include "client/import/polygon_fan.h"
#include "client/import/scene_wire.h"
#include "client/import/text_scanner.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// Deeper node trees than a modeller makes; assimp's own destructor recurses over them too.
constexpr int kMaxNodeDepth = 4096;

Affine3d ToAffine(const aiMatrix4x4& m) {
  return {{m.a1, m.a2, m.a3, m.a4, m.b1, m.b2, m.b3, m.b4, m.c1, m.c2, m.c3, m.c4}};
}

// Turns assimp's scene into ours. Runs in the child: errors are exceptions, which become its
// answer.
class SceneConverter {
 public:
  SceneConverter(const aiScene& in, const ImportOptions& options)
      : in_(in), fan_(0, options, &out_.report) {}

  ImportedScene Run(const std::string& extension) {
    out_.report.format = absl::StrCat("assimp ", extension);
    struct Visit {
      const aiNode* node;
      Affine3d parent;
      int depth;
    };
    std::vector<Visit> stack;
    if (in_.mRootNode != nullptr) stack.push_back({in_.mRootNode, {}, 0});
    while (!stack.empty()) {
      const Visit visit = stack.back();
      stack.pop_back();
      if (visit.depth > kMaxNodeDepth) throw std::runtime_error("nodes are nested too deep");
      const Affine3d world = Compose(visit.parent, ToAffine(visit.node->mTransformation));
      AddNode(*visit.node, world);
      for (unsigned i = visit.node->mNumChildren; i > 0; --i) {
        stack.push_back({visit.node->mChildren[i - 1], world, visit.depth + 1});
      }
    }
    return std::move(out_);
  }

 private:
  void AddNode(const aiNode& node, const Affine3d& world) {
    ObjectInput object;
    object.name = std::string(node.mName.C_Str(), node.mName.length);
    object.transform = world;
    for (unsigned i = 0; i < node.mNumMeshes; ++i) {
      if (node.mMeshes[i] >= in_.mNumMeshes) throw std::runtime_error("a node names no mesh");
      AddMesh(*in_.mMeshes[node.mMeshes[i]], &object);
    }
    if (object.indices.empty()) return;
    for (const Vec3d& v : object.vertices) out_.report.non_finite_vertices += !IsFinite(v);
    out_.objects.push_back(std::move(object));
  }

  void AddMesh(const aiMesh& mesh, ObjectInput* object) {
    std::vector<uint32_t> indices;
    std::vector<int64_t> corners;
    fan_.set_vertex_count(mesh.mNumVertices);
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      const aiFace& face = mesh.mFaces[f];
      if (face.mNumIndices == 1 || face.mNumIndices == 2) {
        ++out_.report.skipped_primitives;
        continue;
      }
      corners.assign(face.mIndices, face.mIndices + face.mNumIndices);
      if (const absl::Status added = fan_.Add(corners, &indices); !added.ok()) {
        throw std::length_error(std::string(added.message()));
      }
    }
    if (indices.empty()) return;
    const uint64_t first = object->vertices.size();
    if (first + mesh.mNumVertices > kMaxVertices)
      throw std::length_error("holds more vertices than 32 bits can number");
    for (unsigned v = 0; v < mesh.mNumVertices; ++v) {
      const aiVector3D& p = mesh.mVertices[v];
      object->vertices.push_back(CanonicalVertex({p.x, p.y, p.z}));
    }
    for (const uint32_t i : indices) object->indices.push_back(static_cast<uint32_t>(first + i));
  }

  const aiScene& in_;
  ImportedScene out_;
  PolygonFan fan_;
};

std::string ImportAndEncode(std::string_view bytes, const ImportOptions& options) {
  Assimp::Importer importer;
  const aiScene* scene =
      importer.ReadFileFromMemory(bytes.data(), bytes.size(), 0, options.extension.c_str());
  if (scene == nullptr) {
    throw std::runtime_error(
        absl::StrCat("assimp cannot read it: ", Quoted(importer.GetErrorString())));
  }
  return EncodeScene(SceneConverter(*scene, options).Run(options.extension));
}

// How much rounding to 24 bits may have moved a coordinate of the scene.
void WarnOfFloats(ImportedScene* scene) {
  double largest = 0;
  for (const ObjectInput& object : scene->objects) {
    for (const Vec3d& v : object.vertices) {
      const Vec3d world = object.transform.Apply(v);
      if (IsFinite(world)) largest = std::max(largest, MaxAbs(world));
    }
  }
  scene->report.float_precision_loss = true;
  scene->report.warnings.push_back(
      absl::StrFormat("read through assimp, which keeps 32-bit floats: the largest coordinate, "
                      "%.9g, is good to about %.2g",
                      largest, largest * 0x1p-24));
}

}  // namespace

bool AssimpKnows(const std::string& extension) {
  return !extension.empty() && Assimp::Importer().IsExtensionSupported("." + extension);
}

absl::StatusOr<ImportedScene> ReadWithAssimp(std::string_view bytes, const ImportOptions& options) {
  ChildLimits limits;
  limits.timeout_seconds = options.assimp_timeout_seconds;
  limits.cancel = options.cancel;
  SL_ASSIGN_OR_RETURN(const std::string encoded,
                      RunInChild([&] { return ImportAndEncode(bytes, options); }, limits));
  SL_ASSIGN_OR_RETURN(ImportedScene scene, DecodeScene(encoded));
  WarnOfFloats(&scene);
  return scene;
}

}  // namespace sightline
