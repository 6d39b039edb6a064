// SPDX-License-Identifier: Apache-2.0
#include "core/scene/scene.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <new>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/container/btree_map.h"
#include "absl/functional/function_ref.h"
#include "absl/strings/str_cat.h"
#include "core/accel/bvh_refit.h"
#include "core/accel/leaf_triangles.h"
#include "core/base/polled_blocks.h"
#include "core/base/status_macros.h"
#include "core/mesh/scene_compiler.h"

namespace sightline {
namespace {

// Share of the time that compiling takes, for the progress (kitchen, 1.44 M triangles: about a
// fifth).
constexpr double kCompileShare = 0.2;
// Names that are put in order, objects copied or edits applied between two looks at the cancel
// token: a few milliseconds at most.
constexpr size_t kPolledObjects = 4096;
// Of what is built where a kd-tree is built, too: the BVH's share (sphere of 1 M triangles).
constexpr double kBvhShare = 0.1;

// What a kd-tree so built is reckoned to take, and kept to. The default one takes 35 to 83 bytes a
// triangle (pine, hall, hotel, forest, sphere); twice that, and some. Those that cost less to walk
// take up to 131, and with perfect splits up to 305 (hall, forest, sphere). Whoever allows more
// references than the default is reckoned to use them.
uint64_t KdTreeBytes(uint64_t triangles, const KdBuildOptions& options) {
  const KdBuildOptions usual;
  const bool large = options.perfect_splits && options.traversal_cost < usual.traversal_cost;
  // BuildKdTree refuses what is out of range.
  const double asked = std::min(options.max_references, kMaxKdReferences);
  const double more = asked > usual.max_references ? asked / usual.max_references : 1;
  const uint64_t per_triangle = static_cast<uint64_t>(std::ceil((large ? 360 : 180) * more));
  // The smallest is a node and a leaf.
  return triangles * per_triangle + sizeof(KdNode) + sizeof(KdLeaf) + sizeof(uint32_t) +
         sizeof(Box3f);
}

class Stopwatch {
 public:
  double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  }

 private:
  const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

// Adds the kd-tree to a scene that has all else.
absl::Status BuildKd(const KdBuildOptions& options, ThreadPool& pool, const CancelToken* cancel,
                     const std::function<void(double)>& progress, Scene* scene) {
  std::function<void(double)> kd_progress;
  if (progress) {
    constexpr double kBefore = kCompileShare + (1 - kCompileShare) * kBvhShare;
    kd_progress = [&progress](double share) { progress(kBefore + (1 - kBefore) * share); };
  }
  const Stopwatch time;
  KdBuildOptions bounded = options;
  const uint64_t most = KdTreeBytes(scene->geometry.triangles.size(), options);
  bounded.max_bytes = options.max_bytes == 0 ? most : std::min(options.max_bytes, most);
  SL_ASSIGN_OR_RETURN(scene->kd_tree,
                      BuildKdTree(scene->geometry, bounded, pool, cancel, kd_progress));
  if (options.lay_out_leaves) {
    const KdTree& tree = *scene->kd_tree;
    scene->kd_leaves = MakeLeafTriangles(scene->geometry, {tree.ids.data(), tree.ids.size()});
  }
  scene->report.kd_tree_seconds = time.seconds();
  ReportKdTree(*scene->kd_tree, &scene->report);
  return absl::OkStatus();
}

absl::Status BuildBinary(const BinaryBvhOptions& options, ThreadPool& pool,
                         const CancelToken* cancel, Scene* scene) {
  const Stopwatch time;
  SL_ASSIGN_OR_RETURN(scene->binary_bvh, BuildBinaryBvh(scene->geometry, options, pool, cancel));
  scene->report.binary_bvh_seconds = time.seconds();
  ReportBinaryBvh(*scene->binary_bvh, &scene->report);
  return absl::OkStatus();
}

// The tree of `moved_from` fitted to the scene's geometry, if that will do; else a new one.
absl::Status BuildOrRefit(const Scene* moved_from, const BvhBuildOptions& options, ThreadPool& pool,
                          const CancelToken* cancel, const std::function<void(double)>& progress,
                          Scene* scene) {
  const Stopwatch time;
  if (moved_from != nullptr && !moved_from->bvh.empty() && options.refit &&
      moved_from->bvh.has_leaf_rows() == options.leaf_rows &&
      CanRefit(moved_from->geometry, scene->geometry)) {
    SL_ASSIGN_OR_RETURN(scene->bvh, RefitBvh(moved_from->bvh, scene->geometry, pool, cancel));
    scene->report.bvh_refitted = scene->bvh.cost_growth <= kMaxRefitGrowth;
  }
  if (!scene->report.bvh_refitted) {
    SL_ASSIGN_OR_RETURN(scene->bvh, BuildBvh(scene->geometry, options, pool, cancel, progress));
  }
  scene->report.bvh_seconds = time.seconds();
  return absl::OkStatus();
}

// Compiles by `compile`, then builds; on a thread of the pool. Memory that runs out is the one
// exception that libraries below throw; it ends here. `moved_from`, if not null, has the same
// triangles with other vertices.
absl::StatusOr<std::shared_ptr<const Scene>> Build(
    std::string name, uint64_t revision, absl::FunctionRef<absl::StatusOr<SceneGeometry>()> compile,
    const Scene* moved_from, const SceneBuildOptions& options, ThreadPool& pool,
    const CancelToken* cancel, const std::function<void(double)>& progress) try {
  if (options.without_bvh && !options.kd_tree) {
    return absl::InvalidArgumentError(
        "a scene without a BVH needs a kd-tree: ask for one, or for the BVH");
  }
  auto scene = std::make_shared<Scene>();
  scene->name = std::move(name);
  scene->revision = revision;
  absl::Status status;
  // One block: the calling thread enters the pool, and everything below runs within it.
  pool.ParallelFor(1, 1, [&](size_t, size_t) {
    status = [&]() -> absl::Status {
      const Stopwatch compile_time;
      SL_ASSIGN_OR_RETURN(scene->geometry, compile());
      scene->report.compile_seconds = compile_time.seconds();
      if (options.accept != nullptr) SL_RETURN_IF_ERROR(options.accept(scene->geometry));
      std::function<void(double)> bvh_progress;
      if (progress) {
        progress(kCompileShare);
        const double bvh_share = (1 - kCompileShare) * (options.kd_tree ? kBvhShare : 1);
        bvh_progress = [&progress, bvh_share](double share) {
          progress(kCompileShare + bvh_share * share);
        };
      }
      if (!options.without_bvh) {
        SL_RETURN_IF_ERROR(
            BuildOrRefit(moved_from, options.bvh, pool, cancel, bvh_progress, scene.get()));
      }
      if (options.binary_bvh) {
        SL_RETURN_IF_ERROR(BuildBinary(*options.binary_bvh, pool, cancel, scene.get()));
      }
      return options.kd_tree ? BuildKd(*options.kd_tree, pool, cancel, progress, scene.get())
                             : absl::OkStatus();
    }();
  });
  SL_RETURN_IF_ERROR(status);
  scene->report.mesh = scene->geometry.report;
  scene->report.bvh_nodes = scene->bvh.nodes.size();
  scene->report.bvh_leaves = scene->bvh.leaf_count;
  scene->report.bvh_depth = scene->bvh.max_depth;
  scene->report.memory_bytes = scene->MemoryBytes();
  return scene;
} catch (const std::bad_alloc&) {
  return absl::ResourceExhaustedError(
      "out of memory while building a scene: free some, or split it");
} catch (const std::exception& e) {
  return absl::InternalError(absl::StrCat("building a scene failed: ", e.what()));
}

// The objects of a scene while edits are applied to them.
class EditedObjects {
 public:
  // Those of `base`, before any edit. Cancelled or DeadlineExceeded from `cancel`, here and below.
  static absl::StatusOr<EditedObjects> Of(const SceneGeometry& base, const CancelToken* cancel) {
    EditedObjects objects(base);
    objects.sources_.reserve(base.objects.size());
    const bool all =
        InPolledBlocks(base.objects.size(), kPolledObjects, cancel, [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            objects.by_name_[base.objects[i].name] = i;
            objects.sources_.push_back({{.base_object = static_cast<uint32_t>(i)}, false});
          }
        });
    if (!all) return cancel->ToStatus();
    return objects;
  }

  absl::Status Apply(std::span<const SceneEdit> edits, const CancelToken* cancel) {
    absl::Status status;
    const bool all =
        InPolledBlocks(edits.size(), kPolledObjects, cancel, [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end && status.ok(); ++i) status = Apply(edits[i]);
        });
    return all || !status.ok() ? status : cancel->ToStatus();
  }

  absl::StatusOr<std::vector<ObjectSource>> Sources(const CancelToken* cancel) const {
    std::vector<ObjectSource> sources;
    sources.reserve(sources_.size());
    const bool all =
        InPolledBlocks(sources_.size(), kPolledObjects, cancel, [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            if (!sources_[i].removed) sources.push_back(sources_[i].source);
          }
        });
    if (!all) return cancel->ToStatus();
    return sources;
  }

 private:
  explicit EditedObjects(const SceneGeometry& base) : base_(base) {}

  absl::Status Apply(const SceneEdit& edit) {
    if (edit.kind == SceneEdit::Kind::kAdd) return Add(edit.object);
    const std::string& name = edit.object.name;
    const auto found = by_name_.find(name);
    if (found == by_name_.end()) {
      return absl::NotFoundError(absl::StrCat("the scene has no object \"", name, "\""));
    }
    Entry& entry = sources_[found->second];
    switch (edit.kind) {
      case SceneEdit::Kind::kRemove:
        entry.removed = true;
        by_name_.erase(found);
        return absl::OkStatus();
      case SceneEdit::Kind::kSetTransform:
        if (!IsDynamic(entry.source)) {
          return absl::FailedPreconditionError(
              absl::StrCat("object \"", name,
                           "\" is not dynamic, so its local coordinates were not kept: "
                           "set its vertices, or add it as dynamic"));
        }
        entry.source.transform = &edit.object.transform;
        return absl::OkStatus();
      case SceneEdit::Kind::kSetVertices:
        entry.source.vertices = &edit.object.vertices;
        return absl::OkStatus();
      case SceneEdit::Kind::kAdd:
        break;
    }
    return absl::InvalidArgumentError(
        absl::StrCat("unknown kind of edit: ", static_cast<int>(edit.kind)));
  }

  struct Entry {
    ObjectSource source;
    bool removed;
  };

  absl::Status Add(const ObjectInput& object) {
    // One without a name is named when it is compiled, and cannot be named by a later edit of this
    // list.
    if (!object.name.empty() && !by_name_.emplace(object.name, sources_.size()).second) {
      return absl::AlreadyExistsError(
          absl::StrCat("the scene has an object \"", object.name, "\" already"));
    }
    sources_.push_back({{.input = &object}, false});
    return absl::OkStatus();
  }

  bool IsDynamic(const ObjectSource& source) const {
    return source.input != nullptr ? source.input->dynamic
                                   : base_.objects[source.base_object].source_vertices != nullptr;
  }

  const SceneGeometry& base_;
  std::vector<Entry> sources_;
  // Of any hash, names could be made to collide.
  absl::btree_map<std::string_view, size_t> by_name_;
};

}  // namespace

void ReportKdTree(const KdTree& tree, BuildReport* report) {
  report->kd_tree_nodes = tree.nodes.size();
  report->kd_tree_leaves = tree.leaves.size();
  report->kd_tree_references = tree.ids.size();
  report->kd_tree_depth = tree.max_depth;
  report->kd_tree_bytes = tree.MemoryBytes();
}

void ReportBinaryBvh(const BinaryBvh& bvh, BuildReport* report) {
  report->binary_bvh_nodes = bvh.nodes.size();
  report->binary_bvh_leaves = bvh.leaf_count;
  report->binary_bvh_depth = bvh.max_depth;
  report->binary_bvh_bytes = bvh.MemoryBytes();
}

uint64_t EstimateSceneBytes(uint64_t triangles, uint64_t vertices,
                            const SceneBuildOptions& options) {
  uint64_t bytes = vertices * sizeof(Vec3f) + sizeof(Scene);
  uint64_t per_triangle = sizeof(std::array<uint32_t, 3>);
  if (!options.without_bvh) {
    // The BVH takes 42 to 56 bytes per triangle on the scenes measured (a full leaf 40, one of four
    // triangles the same, and an eighth of a node for each leaf); up to twice that for scattered
    // triangles. The smallest is a node and a leaf.
    per_triangle += 112;
    bytes += sizeof(BvhNode) + kUnitFloats * sizeof(float) * 4;
    if (options.bvh.mates) {
      // A mate for each edge of a lane, used or not, and a byte a unit: 12.4 to 13.2 on fourteen
      // scenes.
      per_triangle += 40;
      bytes += 4 * LeafMates::kUnitBytes;
    }
  }
  if (options.kd_tree) {
    bytes += KdTreeBytes(triangles, *options.kd_tree);
    // Rows and a box for each triangle that a leaf names.
    if (options.kd_tree->lay_out_leaves) {
      // BuildKdTree refuses what is out of range.
      const float asked = options.kd_tree->max_references;
      const float references = asked >= 1 ? std::min(asked, kMaxKdReferences) : 1;
      per_triangle += kLeafTriangleBytes * static_cast<uint64_t>(std::ceil(references));
      bytes += kMostLeafPaddingBytes;
    }
  }
  if (options.binary_bvh) {
    // At most two nodes, an id, its rows and its box each.
    per_triangle += 2 * sizeof(BinaryBvhNode) + sizeof(uint32_t) + kLeafTriangleBytes;
    bytes += kMostLeafPaddingBytes;
  }
  return triangles * per_triangle + bytes;
}

uint64_t EstimateObjectBytes(uint64_t objects, uint64_t name_bytes) {
  // A string that grows holds up to twice what it held within itself.
  return objects * (sizeof(ObjectRecord) + 2 * std::string().capacity()) + name_bytes;
}

absl::StatusOr<std::shared_ptr<const Scene>> BuildScene(
    std::string name, uint64_t revision, std::span<const ObjectInput> objects,
    std::optional<Vec3d> origin, const SceneBuildOptions& options, ThreadPool& pool,
    const CancelToken* cancel, const std::function<void(double)>& progress) {
  return Build(
      std::move(name), revision,
      [&] { return CompileScene(objects, origin, options.limits, cancel); }, nullptr, options, pool,
      cancel, progress);
}

absl::StatusOr<std::shared_ptr<const Scene>> EditScene(
    const Scene& base, uint64_t revision, std::span<const SceneEdit> edits,
    const SceneBuildOptions& options, ThreadPool& pool, const CancelToken* cancel,
    const std::function<void(double)>& progress) {
  const bool only_moves = std::all_of(edits.begin(), edits.end(), [](const SceneEdit& edit) {
    return edit.kind == SceneEdit::Kind::kSetTransform ||
           edit.kind == SceneEdit::Kind::kSetVertices;
  });
  return Build(
      base.name, revision,
      [&]() -> absl::StatusOr<SceneGeometry> {
        SL_ASSIGN_OR_RETURN(EditedObjects objects, EditedObjects::Of(base.geometry, cancel));
        SL_RETURN_IF_ERROR(objects.Apply(edits, cancel));
        SL_ASSIGN_OR_RETURN(const std::vector<ObjectSource> sources, objects.Sources(cancel));
        return CompileSources(sources, &base.geometry, std::nullopt, options.limits, cancel);
      },
      only_moves ? &base : nullptr, options, pool, cancel, progress);
}

}  // namespace sightline
