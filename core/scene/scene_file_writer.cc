// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <exception>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/scene/scene_file.h"

namespace sightline {
namespace {

// Written at once, between two looks at the cancel token.
constexpr size_t kPieceBytes = size_t{16} << 20;

SceneFileScene DescribeScene(const Scene& scene) {
  const SceneGeometry& geometry = scene.geometry;
  SceneFileScene out = {};
  for (int axis = 0; axis < 3; ++axis) {
    out.origin[axis] = geometry.origin[axis];
    out.bounds[axis] = geometry.bounds.lo[axis];
    out.bounds[axis + 3] = geometry.bounds.hi[axis];
  }
  const MeshReport& report = geometry.report;
  out.largest_rounding = report.largest_rounding;
  out.revision = scene.revision;
  out.non_finite_vertices = report.non_finite_vertices;
  out.non_finite_triangles = report.non_finite_triangles;
  out.zero_area_triangles = report.zero_area_triangles;
  out.duplicate_triangles = report.duplicate_triangles;
  out.compile_seconds = scene.report.compile_seconds;
  out.structure_seconds = scene.report.bvh_seconds;
  out.leaf_count = scene.bvh.leaf_count;
  out.max_depth = scene.bvh.max_depth;
  return out;
}

SceneFileObject DescribeObject(const ObjectRecord& record) {
  SceneFileObject out = {};
  out.name_bytes = static_cast<uint32_t>(record.name.size());
  out.triangle_count = record.triangle_count;
  out.vertex_count = record.vertex_count;
  out.mask = record.mask;
  out.culling = static_cast<uint32_t>(record.culling);
  out.dynamic = record.source_vertices != nullptr ? 1 : 0;
  std::copy(record.transform.m.begin(), record.transform.m.end(), out.transform);
  out.largest_rounding = record.largest_rounding;
  return out;
}

SceneFileKdTree DescribeKdTree(const KdTree& tree, bool leaves_laid_out) {
  SceneFileKdTree out = {};
  for (int axis = 0; axis < 3; ++axis) {
    out.bounds[axis] = tree.bounds.lo[axis];
    out.bounds[axis + 3] = tree.bounds.hi[axis];
  }
  out.max_depth = tree.max_depth;
  out.leaves_laid_out = leaves_laid_out ? 1 : 0;
  return out;
}

// The file as spans of what is in memory, with the header and the table before them: nothing that
// grows with triangles or vertices is copied.
class Image {
 public:
  explicit Image(const Scene& scene)
      : scene_(DescribeScene(scene)),
        version_(scene.kd_tree_alone() ? kSceneFileVersionWithoutBvh : kSceneFileVersion) {
    Parts source_vertices;
    for (const ObjectRecord& record : scene.geometry.objects) {
      objects_.push_back(DescribeObject(record));
      names_ += record.name;
      if (record.source_vertices == nullptr) continue;
      source_vertices.push_back(std::as_bytes(std::span(*record.source_vertices)));
    }
    Add(SectionKind::kScene, std::span(&scene_, 1));
    Add(SectionKind::kObjects, std::span<const SceneFileObject>(objects_));
    Add(SectionKind::kNames, std::span<const char>(names_));
    Add(SectionKind::kSourceVertices, sizeof(Vec3d), std::move(source_vertices));
    Add(SectionKind::kVertices, std::span<const Vec3f>(scene.geometry.vertices));
    Add(SectionKind::kTriangles,
        std::span<const std::array<uint32_t, 3>>(scene.geometry.triangles));
    Add(SectionKind::kInert, std::span<const uint32_t>(scene.geometry.inert));
    Add(SectionKind::kBvhNodes, std::span<const BvhNode>(scene.bvh.nodes));
    Add(SectionKind::kBvhLeaves, std::span<const float>(scene.bvh.leaves));
    Add(SectionKind::kBvhLeafIds, std::span<const uint32_t>(scene.bvh.leaf_ids));
    if (scene.kd_tree.has_value()) {
      kd_tree_ = DescribeKdTree(*scene.kd_tree, scene.kd_leaves.has_value());
      Add(SectionKind::kKdTree, std::span<const SceneFileKdTree>(&kd_tree_, 1));
      Add(SectionKind::kKdNodes, std::span<const KdNode>(scene.kd_tree->nodes));
      Add(SectionKind::kKdLeaves, std::span<const KdLeaf>(scene.kd_tree->leaves));
      Add(SectionKind::kKdIds, std::span<const uint32_t>(scene.kd_tree->ids));
      Add(SectionKind::kKdReach, std::span<const Box3f>(scene.kd_tree->reach));
    }
    if (scene.binary_bvh.has_value()) {
      binary_bvh_ = {scene.binary_bvh->leaf_count, scene.binary_bvh->max_depth};
      Add(SectionKind::kBinaryBvh, std::span<const SceneFileBinaryBvh>(&binary_bvh_, 1));
      Add(SectionKind::kBinaryBvhNodes, std::span<const BinaryBvhNode>(scene.binary_bvh->nodes));
      Add(SectionKind::kBinaryBvhIds, std::span<const uint32_t>(scene.binary_bvh->ids));
    }
    if (const LeafMates& mates = scene.bvh.mates; !mates.empty()) {
      Add(SectionKind::kLeafMateRows, std::span<const LeafMate>(mates.rows));
      Add(SectionKind::kLeafMateUnits, std::span<const uint8_t>(mates.units));
    }
    if (scene.bvh.cost_growth != 1 && std::isfinite(scene.bvh.cost_growth)) {
      bvh_growth_ = {scene.bvh.cost_growth};
      Add(SectionKind::kBvhGrowth, std::span<const SceneFileBvhGrowth>(&bvh_growth_, 1));
    }
  }

  void Sum(const CancelToken* cancel) {
    uint64_t offset = sizeof(SceneFileHeader) + PaddedSection(table_.size() * sizeof(table_[0]));
    for (size_t i = 0; i < table_.size(); ++i) {
      table_[i].offset = offset;
      table_[i].sum = SectionSum(sections_[i], cancel);
      offset += PaddedSection(SectionBytes(i));
    }
    std::memcpy(header_.magic, kSceneFileMagic, sizeof(kSceneFileMagic));
    header_.version = version_;
    header_.byte_order = kSceneFileByteOrder;
    header_.file_bytes = offset;
    header_.section_count = static_cast<uint32_t>(table_.size());
    header_.table_sum = SectionSum(std::as_bytes(std::span(table_)));
    header_.header_sum = HeaderSum(header_);
  }

  absl::Status Write(FileReplacement* file, const CancelToken* cancel,
                     const std::function<void(double)>& progress) const {
    SL_RETURN_IF_ERROR(file->Append(std::as_bytes(std::span(&header_, 1))));
    const auto table = std::as_bytes(std::span(table_));
    SL_RETURN_IF_ERROR(Append(table, file, cancel, {}));
    SL_RETURN_IF_ERROR(Pad(table.size(), file));
    uint64_t before = 0;
    for (size_t i = 0; i < sections_.size(); ++i) {
      for (const std::span<const std::byte> part : sections_[i]) {
        SL_RETURN_IF_ERROR(Append(part, file, cancel, [&](uint64_t written) {
          if (progress) {
            progress(static_cast<double>(before + written) /
                     static_cast<double>(header_.file_bytes));
          }
        }));
        before += part.size();
      }
      SL_RETURN_IF_ERROR(Pad(SectionBytes(i), file));
    }
    return absl::OkStatus();
  }

 private:
  // A section's bytes, in that order.
  using Parts = std::vector<std::span<const std::byte>>;

  template <typename T>
  void Add(SectionKind kind, std::span<const T> elements) {
    Add(kind, sizeof(T), {std::as_bytes(elements)});
  }
  void Add(SectionKind kind, uint32_t element_bytes, Parts parts) {
    SIGHTLINE_CHECK_EQ(element_bytes, SectionElementBytes(kind));
    uint64_t bytes = 0;
    for (const std::span<const std::byte> part : parts) bytes += part.size();
    sections_.push_back(std::move(parts));
    table_.push_back({.kind = static_cast<uint32_t>(kind),
                      .element_bytes = element_bytes,
                      .count = bytes / element_bytes});
  }
  uint64_t SectionBytes(size_t i) const { return table_[i].count * table_[i].element_bytes; }

  static absl::Status Append(std::span<const std::byte> bytes, FileReplacement* file,
                             const CancelToken* cancel,
                             const std::function<void(uint64_t)>& written) {
    for (size_t done = 0; done < bytes.size();) {
      if (cancel != nullptr) SL_RETURN_IF_ERROR(cancel->ToStatus());
      const size_t piece = std::min(kPieceBytes, bytes.size() - done);
      SL_RETURN_IF_ERROR(file->Append(bytes.subspan(done, piece)));
      done += piece;
      if (written) written(done);
    }
    return absl::OkStatus();
  }
  // Behind a section of so many bytes.
  static absl::Status Pad(uint64_t bytes, FileReplacement* file) {
    static constexpr std::array<std::byte, kSectionAlignment> kZeros{};
    return file->Append(std::span(kZeros).first(PaddedSection(bytes) - bytes));
  }

  const SceneFileScene scene_;
  const uint32_t version_;
  SceneFileKdTree kd_tree_ = {};
  SceneFileBinaryBvh binary_bvh_ = {};
  SceneFileBvhGrowth bvh_growth_ = {};
  std::vector<SceneFileObject> objects_;
  std::string names_;
  SceneFileHeader header_ = {};
  std::vector<SceneFileSection> table_;
  std::vector<Parts> sections_;  // Of table_'s rows.
};

}  // namespace

absl::Status WriteSceneFile(const Scene& scene, const Folder& folder, const std::string& name,
                            ThreadPool& pool, const CancelToken* cancel,
                            const std::function<void(double)>& progress) try {
  if (!IsSceneFileRevision(scene.revision)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "revision ", scene.revision, " of scene \"", scene.name, "\" is outside 1 .. ",
        kMaxSceneFileRevision, ", which a file can have: build it anew as revision 1"));
  }
  Image image(scene);
  // One block: the calling thread enters the pool, and the sums run within it.
  pool.ParallelFor(1, 1, [&](size_t, size_t) { image.Sum(cancel); });
  if (cancel != nullptr) SL_RETURN_IF_ERROR(cancel->ToStatus());
  SL_ASSIGN_OR_RETURN(FileReplacement file, folder.Replace(name));
  SL_RETURN_IF_ERROR(image.Write(&file, cancel, progress));
  return file.Commit();
} catch (const std::bad_alloc&) {
  return absl::ResourceExhaustedError(
      absl::StrCat("out of memory while writing ", folder.path(), "/", name, ": free some"));
} catch (const std::exception& e) {
  return absl::InternalError(
      absl::StrCat("writing ", folder.path(), "/", name, " failed: ", e.what()));
}

}  // namespace sightline
