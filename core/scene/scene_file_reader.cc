// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <exception>
#include <new>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "core/accel/binary_bvh_validation.h"
#include "core/accel/bvh_validation.h"
#include "core/accel/kd_validation.h"
#include "core/accel/leaf_mates_validation.h"
#include "core/base/limit_error.h"
#include "core/base/polled_blocks.h"
#include "core/base/status_macros.h"
#include "core/base/utf8.h"
#include "core/mesh/geometry_validation.h"
#include "core/scene/scene_file.h"

namespace sightline {
namespace {

// Share of the time that the sums take, for the progress.
constexpr double kSumShare = 0.3;
// Objects that are read between two looks at the cancel token: a name and its letters each.
constexpr size_t kPolledObjects = 4096;
// What an error shows of a name that is none.
constexpr size_t kShownNameBytes = 64;

template <typename... Args>
absl::Status Fault(const SceneBytes& file, const Args&... args) {
  return absl::DataLossError(absl::StrCat(file.shown, ": ", args...));
}

// `status` with the file named in front.
absl::Status Named(const SceneBytes& file, const absl::Status& status) {
  return status.ok()
             ? status
             : absl::Status(status.code(), absl::StrCat(file.shown, ": ", status.message()));
}

absl::StatusOr<SceneFileHeader> ReadHeader(const SceneBytes& file) {
  SceneFileHeader header;
  if (file.bytes.size() < sizeof(header.magic) ||
      std::memcmp(file.bytes.data(), kSceneFileMagic, sizeof(kSceneFileMagic)) != 0) {
    return absl::InvalidArgumentError(
        absl::StrCat(file.shown, " is no native scene file: make one with sightline import"));
  }
  if (file.bytes.size() < sizeof(header)) {
    return Fault(file, "truncated: ", file.bytes.size(), " bytes are less than a header");
  }
  std::memcpy(&header, file.bytes.data(), sizeof(header));
  if (header.header_sum != HeaderSum(header)) {
    return Fault(file, "the header was changed: its sum is wrong");
  }
  const bool known =
      header.version == kSceneFileVersion || header.version == kSceneFileVersionWithoutBvh;
  if (!known || header.byte_order != kSceneFileByteOrder) {
    return absl::UnimplementedError(
        absl::StrCat(file.shown, " is of version ", header.version, ", and versions ",
                     kSceneFileVersion, " and ", kSceneFileVersionWithoutBvh,
                     " are read: write it again with this version's sightline import"));
  }
  if (header.file_bytes != file.bytes.size()) {
    return Fault(file, file.bytes.size() < header.file_bytes ? "truncated" : "something follows",
                 ": it has ", file.bytes.size(), " bytes, and says ", header.file_bytes);
  }
  if (header.section_count < kRequiredSections || header.section_count > kMaxSections) {
    return Fault(file, "it has ", header.section_count, " sections, not ", kRequiredSections,
                 " to ", kMaxSections);
  }
  return header;
}

// The table, each section of it within the file, right behind the one before.
absl::StatusOr<std::vector<SceneFileSection>> ReadTable(const SceneBytes& file,
                                                        const SceneFileHeader& header) {
  std::vector<SceneFileSection> table(header.section_count);
  const uint64_t table_bytes = table.size() * sizeof(SceneFileSection);
  uint64_t offset = sizeof(header) + PaddedSection(table_bytes);
  if (offset > file.bytes.size()) return Fault(file, "truncated within the table of sections");
  // With the padding, whose zeros the sum stands for.
  const auto padded = file.bytes.subspan(sizeof(header), PaddedSection(table_bytes));
  if (SectionSum(padded) != header.table_sum) {
    return Fault(file, "the table of sections was changed: its sum is wrong");
  }
  std::memcpy(table.data(), padded.data(), table_bytes);
  for (size_t i = 0; i < table.size(); ++i) {
    const SceneFileSection& section = table[i];
    const bool required = i < kRequiredSections;
    const auto name = SectionName(section.kind);
    if (required ? section.kind != i + 1
                 : section.kind < static_cast<uint32_t>(SectionKind::kFirstOptional) ||
                       section.kind <= table[i - 1].kind) {
      return Fault(file, "section ", i, " is of kind ", section.kind, ", out of order");
    }
    const uint32_t element = SectionElementBytes(static_cast<SectionKind>(section.kind));
    if (section.element_bytes == 0 || (element != 0 && section.element_bytes != element)) {
      return Fault(file, "elements of the ", name, " have ", section.element_bytes, " bytes");
    }
    const uint64_t left = file.bytes.size() - offset;
    if (section.offset != offset || section.count > left / section.element_bytes ||
        PaddedSection(section.count * section.element_bytes) > left) {
      return Fault(file, "the ", name, " do not lie within the file: ", section.count, " of ",
                   section.element_bytes, " bytes from ", section.offset);
    }
    offset += PaddedSection(section.count * section.element_bytes);
  }
  if (offset != file.bytes.size()) {
    return Fault(file, file.bytes.size() - offset, " bytes belong to no section");
  }
  if (table[0].count != 1) return Fault(file, "it has ", table[0].count, " scenes");
  return table;
}

// Reads the parts of a file whose header and table are good.
class Reader {
 public:
  Reader(const SceneBytes& file, const SceneFileInfo& info, const CancelToken* cancel)
      : file_(file), info_(info), cancel_(cancel) {}

  absl::Status CheckSums() const {
    for (const SceneFileSection& section : info_.sections) {
      const uint64_t bytes = PaddedSection(section.count * section.element_bytes);
      const uint64_t sum = SectionSum(file_.bytes.subspan(section.offset, bytes), cancel_);
      if (cancel_ != nullptr) SL_RETURN_IF_ERROR(cancel_->ToStatus());
      if (sum != section.sum) {
        return Fault(file_, "the ", SectionName(section.kind), " were changed: their sum is wrong");
      }
    }
    return absl::OkStatus();
  }

  absl::Status Read(Scene* scene) {
    SceneFileScene record;
    std::memcpy(&record, Section(SectionKind::kScene).data(), sizeof(record));
    SceneGeometry& geometry = scene->geometry;
    for (int axis = 0; axis < 3; ++axis) {
      geometry.origin[axis] = record.origin[axis];
      geometry.bounds.lo[axis] = record.bounds[axis];
      geometry.bounds.hi[axis] = record.bounds[axis + 3];
    }
    geometry.vertices = Borrow<Vec3f>(SectionKind::kVertices);
    geometry.triangles = Borrow<std::array<uint32_t, 3>>(SectionKind::kTriangles);
    geometry.inert = Borrow<uint32_t>(SectionKind::kInert);
    SL_RETURN_IF_ERROR(ReadObjects(&geometry));
    MeshReport& report = geometry.report;
    report.triangles = geometry.triangles.size();
    report.vertices = geometry.vertices.size();
    report.non_finite_vertices = record.non_finite_vertices;
    report.non_finite_triangles = record.non_finite_triangles;
    report.zero_area_triangles = record.zero_area_triangles;
    report.duplicate_triangles = record.duplicate_triangles;
    report.inert_triangles = geometry.inert.size();
    report.largest_rounding = record.largest_rounding;
    SL_RETURN_IF_ERROR(Named(file_, ValidateGeometry(geometry, cancel_)));

    SL_RETURN_IF_ERROR(ReadBvh(record, scene));
    SL_RETURN_IF_ERROR(ReadKdTree(scene));
    if (info_.version == kSceneFileVersionWithoutBvh && !scene->kd_tree_alone()) {
      return Fault(file_, "it says that its kd-tree stands alone, and it does not");
    }
    SL_RETURN_IF_ERROR(ReadBinaryBvh(scene));

    if (!(record.compile_seconds >= 0 && record.structure_seconds >= 0) ||
        !std::isfinite(record.compile_seconds + record.structure_seconds)) {
      return Fault(file_, "the times of its build are none");
    }
    scene->report = {.mesh = report,
                     .compile_seconds = record.compile_seconds,
                     .bvh_seconds = record.structure_seconds,
                     .bvh_nodes = scene->bvh.nodes.size(),
                     .bvh_leaves = scene->bvh.leaf_count,
                     .bvh_depth = scene->bvh.max_depth,
                     .memory_bytes = MemoryBytes(*scene)};
    if (scene->kd_tree.has_value()) ReportKdTree(*scene->kd_tree, &scene->report);
    if (scene->binary_bvh.has_value()) ReportBinaryBvh(*scene->binary_bvh, &scene->report);
    return absl::OkStatus();
  }

 private:
  // Empty where there is none.
  std::span<const std::byte> Section(SectionKind kind) const {
    for (const SceneFileSection& section : info_.sections) {
      if (section.kind != static_cast<uint32_t>(kind)) continue;
      return file_.bytes.subspan(section.offset, section.count * section.element_bytes);
    }
    return {};
  }
  template <typename T>
  std::span<const T> Elements(SectionKind kind) const {
    const std::span<const std::byte> bytes = Section(kind);
    return {reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T)};
  }
  template <typename T>
  AlignedVector<T> Borrow(SectionKind kind) {
    borrowed_bytes_ += Elements<T>(kind).size_bytes();
    return AlignedVector<T>::Borrow(Elements<T>(kind), file_.owner);
  }

  // With what is held of the file although the scene does not use it.
  uint64_t MemoryBytes(const Scene& scene) const {
    return scene.MemoryBytes() + (file_.in_memory ? file_.bytes.size() - borrowed_bytes_ : 0);
  }

  absl::Status ReadBvh(const SceneFileScene& record, Scene* scene) {
    Bvh bvh;
    bvh.nodes = Borrow<BvhNode>(SectionKind::kBvhNodes);
    bvh.leaves = Borrow<float>(SectionKind::kBvhLeaves);
    bvh.leaf_ids = Borrow<uint32_t>(SectionKind::kBvhLeafIds);
    bvh.mates.rows = Borrow<LeafMate>(SectionKind::kLeafMateRows);
    bvh.mates.units = Borrow<uint8_t>(SectionKind::kLeafMateUnits);
    if (info_.version == kSceneFileVersionWithoutBvh) {
      if (bvh.MemoryBytes() == 0) return absl::OkStatus();
      return Fault(file_, "it says that it has no bvh, and has one");
    }
    const SceneGeometry& geometry = scene->geometry;
    bvh.bounds = geometry.bounds;
    bvh.leaf_count = record.leaf_count;
    bvh.max_depth = record.max_depth;
    bvh.triangle_count = static_cast<uint32_t>(geometry.triangles.size() - geometry.inert.size());
    SL_RETURN_IF_ERROR(Named(file_, ValidateBvh(bvh, geometry, cancel_)));
    SL_RETURN_IF_ERROR(Named(file_, ValidateLeafMates(bvh, geometry, cancel_)));
    const auto growths = Elements<SceneFileBvhGrowth>(SectionKind::kBvhGrowth);
    if (growths.size() > 1) return Fault(file_, "it has ", growths.size(), " bvh growths");
    if (!growths.empty()) bvh.cost_growth = growths[0].cost_growth;
    if (!(bvh.cost_growth > 0 && std::isfinite(bvh.cost_growth))) {
      return Fault(file_, "its bvh is said to cost ", bvh.cost_growth, " times what it did");
    }
    scene->bvh = std::move(bvh);
    return absl::OkStatus();
  }

  absl::Status ReadKdTree(Scene* scene) {
    const auto records = Elements<SceneFileKdTree>(SectionKind::kKdTree);
    if (records.empty()) return absl::OkStatus();
    if (records.size() != 1) return Fault(file_, "it has ", records.size(), " kd-trees");
    KdTree tree;
    tree.nodes = Borrow<KdNode>(SectionKind::kKdNodes);
    tree.leaves = Borrow<KdLeaf>(SectionKind::kKdLeaves);
    tree.ids = Borrow<uint32_t>(SectionKind::kKdIds);
    tree.reach = Borrow<Box3f>(SectionKind::kKdReach);
    for (int axis = 0; axis < 3; ++axis) {
      tree.bounds.lo[axis] = records[0].bounds[axis];
      tree.bounds.hi[axis] = records[0].bounds[axis + 3];
    }
    tree.triangle_count =
        static_cast<uint32_t>(scene->geometry.triangles.size() - scene->geometry.inert.size());
    tree.max_depth = records[0].max_depth;
    SL_RETURN_IF_ERROR(Named(file_, ValidateKdTree(tree, scene->geometry, cancel_)));
    if (records[0].leaves_laid_out > 1) {
      return Fault(file_, "its kd-tree has flags that are none");
    }
    if (records[0].leaves_laid_out == 1) {
      scene->kd_leaves = MakeLeafTriangles(scene->geometry, IdsOf(tree.ids));
    }
    scene->kd_tree = std::move(tree);
    return absl::OkStatus();
  }

  // To read, as all that is borrowed from a file.
  static std::span<const uint32_t> IdsOf(const AlignedVector<uint32_t>& ids) {
    return {ids.data(), ids.size()};
  }

  absl::Status ReadBinaryBvh(Scene* scene) {
    const auto records = Elements<SceneFileBinaryBvh>(SectionKind::kBinaryBvh);
    if (records.empty()) return absl::OkStatus();
    if (records.size() != 1) return Fault(file_, "it has ", records.size(), " binary bvhs");
    BinaryBvh bvh;
    bvh.nodes = Borrow<BinaryBvhNode>(SectionKind::kBinaryBvhNodes);
    bvh.ids = Borrow<uint32_t>(SectionKind::kBinaryBvhIds);
    bvh.leaf_count = records[0].leaf_count;
    bvh.max_depth = records[0].max_depth;
    SL_RETURN_IF_ERROR(Named(file_, ValidateBinaryBvh(bvh, scene->geometry, cancel_)));
    bvh.leaves = MakeLeafTriangles(scene->geometry, IdsOf(bvh.ids));
    scene->binary_bvh = std::move(bvh);
    return absl::OkStatus();
  }

  absl::Status ReadObjects(SceneGeometry* geometry) const {
    auto names = Elements<char>(SectionKind::kNames);
    auto sources = Elements<Vec3d>(SectionKind::kSourceVertices);
    const auto objects = Elements<SceneFileObject>(SectionKind::kObjects);
    geometry->objects.reserve(objects.size());
    uint64_t triangles = 0, vertices = 0;
    for (const SceneFileObject& object : objects) {
      if (geometry->objects.size() % kPolledObjects == 0) SL_RETURN_IF_ERROR(CheckCancel());
      ObjectRecord record;
      if (object.name_bytes > names.size()) return Fault(file_, "its names are cut short");
      record.name.assign(names.data(), object.name_bytes);
      names = names.subspan(object.name_bytes);
      if (!IsUtf8(record.name)) {
        return Fault(file_, "the name of object ", geometry->objects.size(), " is not UTF-8: \"",
                     absl::CHexEscape(record.name.substr(0, kShownNameBytes)), "\"");
      }
      if (object.culling > static_cast<uint32_t>(Culling::kFront) || object.dynamic > 1) {
        return Fault(file_, "object \"", record.name, "\" has flags that are none");
      }
      // Sums beyond 32 bits are found where the objects are compared with the arrays: the counts
      // are kept in 64 until then.
      record.first_triangle = static_cast<uint32_t>(triangles);
      record.first_vertex = static_cast<uint32_t>(vertices);
      record.triangle_count = object.triangle_count;
      record.vertex_count = object.vertex_count;
      triangles += object.triangle_count;
      vertices += object.vertex_count;
      if (triangles > geometry->triangles.size() || vertices > geometry->vertices.size()) {
        return Fault(file_, "its objects have more triangles or vertices than there are");
      }
      record.mask = object.mask;
      record.culling = static_cast<Culling>(object.culling);
      std::copy(std::begin(object.transform), std::end(object.transform),
                record.transform.m.begin());
      record.largest_rounding = object.largest_rounding;
      if (object.dynamic != 0) {
        if (object.vertex_count > sources.size()) {
          return Fault(file_, "its source vertices are cut short");
        }
        record.source_vertices = std::make_shared<const std::vector<Vec3d>>(
            CopyInPolledBlocks(sources.first(object.vertex_count), cancel_));
        if (object.vertex_count > kPolledBlock) SL_RETURN_IF_ERROR(CheckCancel());
        sources = sources.subspan(object.vertex_count);
      }
      geometry->uniform =
          geometry->uniform && record.mask == 0xFFFFFFFFu && record.culling == Culling::kNone;
      geometry->objects.push_back(std::move(record));
    }
    if (!names.empty() || !sources.empty()) {
      return Fault(file_, "it has more names or source vertices than objects");
    }
    return absl::OkStatus();
  }

  absl::Status CheckCancel() const {
    return cancel_ == nullptr ? absl::OkStatus() : cancel_->ToStatus();
  }

  const SceneBytes& file_;
  const SceneFileInfo& info_;
  const CancelToken* const cancel_;
  uint64_t borrowed_bytes_ = 0;
};

absl::Status CheckLimit(const SceneBytes& file, const char* what, uint64_t count, uint64_t limit,
                        const char* remedy = "raise it, or split the scene") {
  if (count <= limit) return absl::OkStatus();
  return LimitError(absl::StrCat("max_", what), limit,
                    absl::StrCat(file.shown, ": the scene has ", count, " ", what), remedy);
}

// Of triangles or vertices, of which no scene has more than kMaxGeometryItems.
absl::Status CheckItems(const SceneBytes& file, const char* what, uint64_t count, uint64_t limit) {
  SL_RETURN_IF_ERROR(
      CheckLimit(file, what, count, kMaxGeometryItems, "split the scene: no limit goes further"));
  return CheckLimit(file, what, count, limit);
}

}  // namespace

absl::StatusOr<SceneBytes> MapSceneFile(const Folder& folder, const std::string& name) {
  SL_ASSIGN_OR_RETURN(std::shared_ptr<const MappedFile> file, folder.Map(name));
  const std::span<const std::byte> bytes = file->bytes();
  return SceneBytes{bytes, std::move(file), absl::StrCat(folder.path(), "/", name)};
}

absl::StatusOr<SceneBytes> ReadSceneFile(const Folder& folder, const std::string& name,
                                         MemoryCheck room, const CancelToken* cancel) {
  SL_ASSIGN_OR_RETURN(std::shared_ptr<const FileImage> file, folder.Read(name, room, cancel));
  const std::span<const std::byte> bytes = file->bytes();
  return SceneBytes{bytes, std::move(file), absl::StrCat(folder.path(), "/", name),
                    /*in_memory=*/true};
}

absl::StatusOr<SceneFileInfo> InspectSceneFile(const SceneBytes& file) {
  SL_ASSIGN_OR_RETURN(const SceneFileHeader header, ReadHeader(file));
  SceneFileInfo info;
  SL_ASSIGN_OR_RETURN(info.sections, ReadTable(file, header));
  const auto count = [&info](SectionKind kind) {
    return info.sections[static_cast<uint32_t>(kind) - 1].count;
  };
  info.version = header.version;
  info.file_bytes = header.file_bytes;
  info.objects = count(SectionKind::kObjects);
  info.triangles = count(SectionKind::kTriangles);
  info.vertices = count(SectionKind::kVertices);
  // Names and source vertices are copied.
  info.scene_bytes = header.file_bytes + sizeof(Scene) +
                     info.objects * (sizeof(ObjectRecord) + std::string().capacity()) +
                     count(SectionKind::kNames) +
                     count(SectionKind::kSourceVertices) * sizeof(Vec3d);
  bool kd_leaves = false;
  for (const SceneFileSection& section : info.sections) {
    const auto kind = static_cast<SectionKind>(section.kind);
    if (kind == SectionKind::kKdTree && section.count == 1) {
      SceneFileKdTree tree;
      std::memcpy(&tree, file.bytes.data() + section.offset, sizeof(tree));
      kd_leaves = tree.leaves_laid_out != 0;
    }
    // Leaves' triangles are laid out again.
    if (kind == SectionKind::kBinaryBvhIds || (kind == SectionKind::kKdIds && kd_leaves)) {
      info.scene_bytes += section.count * kLeafTriangleBytes + kMostLeafPaddingBytes;
    }
  }
  SceneFileScene scene;
  std::memcpy(&scene, file.bytes.data() + info.sections[0].offset, sizeof(scene));
  info.revision = scene.revision;
  if (!IsSceneFileRevision(info.revision)) {
    return Fault(file, "its revision is ", info.revision, ", not 1 to ", kMaxSceneFileRevision);
  }
  return info;
}

uint64_t SceneCheckBytes(const SceneFileInfo& info, int threads) {
  const auto count = [&info](SectionKind kind) -> uint64_t {
    for (const SceneFileSection& section : info.sections) {
      if (section.kind == static_cast<uint32_t>(kind)) return section.count;
    }
    return 0;
  };
  // One after the other.
  const uint64_t units = count(SectionKind::kBvhLeafIds) / kUnitTriangles +
                         count(SectionKind::kBvhLeaves) / kUnitFloats;
  uint64_t most = BvhValidationBytes(info.triangles, count(SectionKind::kBvhNodes), units);
  if (count(SectionKind::kKdTree) > 0) {
    const bool perfect = count(SectionKind::kKdReach) > 0;
    most = std::max(most, KdValidationBytes(info.triangles, count(SectionKind::kKdNodes),
                                            count(SectionKind::kKdIds), perfect, threads));
  }
  // A depth for each node, then a bit for each triangle.
  const uint64_t binary = count(SectionKind::kBinaryBvhNodes) * sizeof(uint32_t);
  return std::max({most, binary, info.triangles / 8});
}

absl::StatusOr<std::shared_ptr<const Scene>> LoadScene(
    const SceneBytes& file, std::string name, const LoadOptions& options, ThreadPool& pool,
    const CancelToken* cancel, const std::function<void(double)>& progress) try {
  SL_ASSIGN_OR_RETURN(const SceneFileInfo info, InspectSceneFile(file));
  SL_RETURN_IF_ERROR(CheckLimit(file, "objects", info.objects, options.limits.max_objects));
  SL_RETURN_IF_ERROR(CheckItems(file, "triangles", info.triangles, options.limits.max_triangles));
  SL_RETURN_IF_ERROR(CheckItems(file, "vertices", info.vertices, options.limits.max_vertices));
  auto scene = std::make_shared<Scene>();
  scene->name = std::move(name);
  scene->revision = options.revision != 0 ? options.revision : info.revision;
  absl::Status status;
  // One block: the calling thread enters the pool, and everything below runs within it.
  pool.ParallelFor(1, 1, [&](size_t, size_t) {
    Reader reader(file, info, cancel);
    status = reader.CheckSums();
    if (progress) progress(kSumShare);
    if (status.ok()) status = reader.Read(scene.get());
    if (progress) progress(1.0);
  });
  SL_RETURN_IF_ERROR(status);
  return scene;
} catch (const std::bad_alloc&) {
  return absl::ResourceExhaustedError(
      absl::StrCat("out of memory while reading ", file.shown, ": free some"));
} catch (const std::exception& e) {
  return absl::InternalError(absl::StrCat("reading ", file.shown, " failed: ", e.what()));
}

}  // namespace sightline
