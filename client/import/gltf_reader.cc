// SPDX-License-Identifier: Apache-2.0
#include "client/import/gltf_reader.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/import/gltf_json.h"
#include "client/import/gltf_mesh.h"
#include "client/import/gltf_model.h"
#include "client/import/polygon_fan.h"
#include "client/import/text_scanner.h"
#include "client/import/tinygltf_api.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// The 3×4 part of glTF's column-major matrix; a last row other than 0 0 0 1 is not affine.
absl::StatusOr<Affine3d> FromMatrix(const std::vector<double>& m) {
  if (m[3] != 0 || m[7] != 0 || m[11] != 0 || m[15] != 1) {
    return absl::InvalidArgumentError("has a matrix that is not affine");
  }
  return Affine3d{{m[0], m[4], m[8], m[12], m[1], m[5], m[9], m[13], m[2], m[6], m[10], m[14]}};
}

// Translation · rotation · scale. Dividing by the squared norm makes a quaternion that was rounded
// to floats an exact rotation.
absl::StatusOr<Affine3d> FromParts(const sightline_tinygltf::Node& node) {
  Affine3d out;
  if (!node.rotation.empty()) {
    const double x = node.rotation[0], y = node.rotation[1], z = node.rotation[2],
                 w = node.rotation[3];
    const double norm = (x * x + y * y) + (z * z + w * w);
    if (!(norm > 0) || !std::isfinite(norm)) {
      return absl::InvalidArgumentError("has a rotation of no direction");
    }
    const double s = 2 / norm;
    out.m = {1 - s * (y * y + z * z), s * (x * y - w * z),     s * (x * z + w * y),     0,
             s * (x * y + w * z),     1 - s * (x * x + z * z), s * (y * z - w * x),     0,
             s * (x * z - w * y),     s * (y * z + w * x),     1 - s * (x * x + y * y), 0};
  }
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3 && !node.scale.empty(); ++column) {
      out.m[4 * row + column] *= node.scale[column];
    }
    if (!node.translation.empty()) out.m[4 * row + 3] = node.translation[row];
  }
  return out;
}

bool Mirrors(const Affine3d& a) {
  const Vec3d x{a.m[0], a.m[4], a.m[8]}, y{a.m[1], a.m[5], a.m[9]}, z{a.m[2], a.m[6], a.m[10]};
  return Dot(Cross(x, y), z) < 0;
}

class GltfSceneReader {
 public:
  GltfSceneReader(const sightline_tinygltf::Model& model, const ImportOptions& options)
      : model_(model),
        cancel_(options.cancel),
        mesh_reader_(model, options, &scene_.report),
        instances_(0, options, &scene_.report),
        meshes_(model.meshes.size()) {}

  absl::StatusOr<ImportedScene> Read(std::vector<std::string> warnings, std::string format);

 private:
  struct Visit {
    int node;
    Affine3d parent;
  };

  absl::StatusOr<std::vector<int>> RootNodes();
  absl::Status VisitNode(const Visit& visit, std::vector<Visit>* stack);
  absl::Status AddObject(int mesh, std::string name, const Affine3d& world);

  const sightline_tinygltf::Model& model_;
  const CancelToken* const cancel_;
  ImportedScene scene_;
  GltfMeshReader mesh_reader_;
  PolygonFan instances_;  // Counts triangles over all instances.
  std::vector<std::optional<GltfMesh>> meshes_;
  std::vector<char> visited_;
};

absl::StatusOr<std::vector<int>> GltfSceneReader::RootNodes() {
  if (!model_.scenes.empty()) {
    const int number = std::max(model_.defaultScene, 0);
    if (static_cast<size_t>(number) >= model_.scenes.size()) {
      return absl::InvalidArgumentError(
          absl::StrCat("its default scene is ", number, " of ", model_.scenes.size()));
    }
    if (model_.scenes.size() > 1) {
      scene_.report.warnings.push_back(
          absl::StrCat("scene ", number, " of ", model_.scenes.size(), " was read"));
    }
    return model_.scenes[number].nodes;
  }
  std::vector<char> is_child(model_.nodes.size(), 0);
  for (const sightline_tinygltf::Node& node : model_.nodes) {
    for (const int child : node.children) {
      if (child >= 0 && static_cast<size_t>(child) < is_child.size()) is_child[child] = 1;
    }
  }
  std::vector<int> roots;
  for (size_t i = 0; i < is_child.size(); ++i) {
    if (!is_child[i]) roots.push_back(static_cast<int>(i));
  }
  if (roots.empty() && !model_.nodes.empty()) {
    return absl::InvalidArgumentError("every one of its nodes is another's child");
  }
  return roots;
}

absl::Status GltfSceneReader::AddObject(int mesh_number, std::string name, const Affine3d& world) {
  if (mesh_number < 0 || static_cast<size_t>(mesh_number) >= model_.meshes.size()) {
    return absl::InvalidArgumentError(absl::StrCat("node ", Quoted(name), " names mesh ",
                                                   mesh_number, " of ", model_.meshes.size()));
  }
  SL_RETURN_IF_ERROR(CheckWanted(cancel_, 0));
  std::optional<GltfMesh>& mesh = meshes_[mesh_number];
  if (!mesh.has_value()) {
    SL_ASSIGN_OR_RETURN(mesh, mesh_reader_.Read(mesh_number));
  }
  if (mesh->indices.empty()) return absl::OkStatus();
  SL_RETURN_IF_ERROR(instances_.Charge(mesh->indices.size() / 3));
  ObjectInput object;
  object.name = std::move(name);
  object.vertices = mesh->vertices;
  object.indices = mesh->indices;
  object.transform = world;
  if (Mirrors(world)) {
    for (size_t i = 0; i + 2 < object.indices.size(); i += 3) {
      std::swap(object.indices[i + 1], object.indices[i + 2]);
    }
  }
  for (const Vec3d& v : object.vertices) scene_.report.non_finite_vertices += !IsFinite(v);
  scene_.objects.push_back(std::move(object));
  return absl::OkStatus();
}

absl::Status GltfSceneReader::VisitNode(const Visit& visit, std::vector<Visit>* stack) {
  if (visit.node < 0 || static_cast<size_t>(visit.node) >= model_.nodes.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("names node ", visit.node, " of ", model_.nodes.size()));
  }
  if (visited_[visit.node]) {
    return absl::InvalidArgumentError(
        absl::StrCat("node ", visit.node, " is its own ancestor or has two parents"));
  }
  visited_[visit.node] = 1;
  const sightline_tinygltf::Node& node = model_.nodes[visit.node];
  absl::StatusOr<Affine3d> local = node.matrix.empty() ? FromParts(node) : FromMatrix(node.matrix);
  if (!local.ok()) {
    return absl::Status(local.status().code(),
                        absl::StrCat("node ", visit.node, " ", local.status().message()));
  }
  const Affine3d world = Compose(visit.parent, *local);
  if (node.mesh >= 0) {
    std::string name = node.name;
    if (name.empty() && static_cast<size_t>(node.mesh) < model_.meshes.size()) {
      name = model_.meshes[node.mesh].name;
    }
    if (name.empty()) name = absl::StrCat("node-", visit.node);
    SL_RETURN_IF_ERROR(AddObject(node.mesh, std::move(name), world));
  }
  // In reverse, so that the stack yields them in the file's order.
  for (auto child = node.children.rbegin(); child != node.children.rend(); ++child) {
    stack->push_back({*child, world});
  }
  return absl::OkStatus();
}

absl::StatusOr<ImportedScene> GltfSceneReader::Read(std::vector<std::string> warnings,
                                                    std::string format) {
  scene_.report.format = std::move(format);
  scene_.report.warnings = std::move(warnings);
  visited_.assign(model_.nodes.size(), 0);
  SL_ASSIGN_OR_RETURN(const std::vector<int> roots, RootNodes());
  std::vector<Visit> stack;
  for (auto root = roots.rbegin(); root != roots.rend(); ++root) stack.push_back({*root, {}});
  while (!stack.empty()) {
    const Visit visit = stack.back();
    stack.pop_back();
    SL_RETURN_IF_ERROR(VisitNode(visit, &stack));
  }
  if (model_.nodes.empty()) {
    for (size_t i = 0; i < model_.meshes.size(); ++i) {
      SL_RETURN_IF_ERROR(AddObject(static_cast<int>(i), model_.meshes[i].name, {}));
    }
  }
  return std::move(scene_);
}

}  // namespace

absl::StatusOr<ImportedScene> ReadGltf(std::string_view bytes, MeshFormat format,
                                       const ImportOptions& options) {
  SL_ASSIGN_OR_RETURN(GltfSource source, PrepareGltf(bytes, format, options));
  sightline_tinygltf::Model model;
  SL_RETURN_IF_ERROR(ParseGltf(source, format, options, &model));
  return GltfSceneReader(model, options)
      .Read(std::move(source.warnings), format == MeshFormat::kGlb ? "glb" : "gltf");
}

}  // namespace sightline
