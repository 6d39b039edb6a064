// SPDX-License-Identifier: Apache-2.0
#include "server/codec/scene_codec.h"

#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/resource_name.h"
#include "server/codec/geometry_codec.h"

namespace sightline {
namespace {

// What core says of its options, "NAME = VALUE is ..." or "NAME is VALUE; ...", as of a field of
// `message`.
absl::Status OptionOf(absl::string_view message, const absl::Status& status) {
  if (status.ok()) return status;
  const std::vector<absl::string_view> words =
      absl::StrSplit(status.message(), absl::MaxSplits(' ', 3));
  ErrorMetadata metadata = {{"field", absl::StrCat(message, ".", words[0])}};
  if (words.size() > 2) metadata.emplace_back("value", absl::StripSuffix(words[2], ";"));
  return MakeError(status.code(), v1::ERROR_REASON_INVALID_FIELD,
                   absl::StrCat(message, ".", status.message()), metadata);
}

v1::SceneState EncodeState(const SceneView& view) {
  if (view.unloaded) return v1::SCENE_STATE_UNLOADED;
  if (view.deleted) return v1::SCENE_STATE_DELETED;
  const bool serves = view.status.latest != nullptr;
  switch (view.status.state) {
    case SceneState::kBuilding:
      return serves ? v1::SCENE_STATE_UPDATING : v1::SCENE_STATE_BUILDING;
    case SceneState::kReady:
      return v1::SCENE_STATE_READY;
    case SceneState::kEvicted:
      return v1::SCENE_STATE_UNLOADED;
    case SceneState::kFailed:
      return serves ? v1::SCENE_STATE_READY : v1::SCENE_STATE_FAILED;
  }
  return v1::SCENE_STATE_UNSPECIFIED;
}

void EncodeReport(const BuildReport& report, v1::BuildReport* out) {
  out->set_input_triangle_count(report.mesh.triangles);
  out->set_non_finite_triangle_count(report.mesh.non_finite_triangles);
  out->set_zero_area_triangle_count(report.mesh.zero_area_triangles);
  out->set_duplicate_triangle_count(report.mesh.duplicate_triangles);
  out->set_non_finite_vertex_count(report.mesh.non_finite_vertices);
  out->set_max_rounding(report.mesh.largest_rounding);
  EncodeDuration(absl::Seconds(report.compile_seconds), out->mutable_compile_duration());
  EncodeDuration(
      absl::Seconds(report.bvh_seconds + report.kd_tree_seconds + report.binary_bvh_seconds),
      out->mutable_structure_duration());
  out->set_node_count(report.bvh_nodes);
  out->set_leaf_count(report.bvh_leaves);
  out->set_depth(static_cast<uint32_t>(report.bvh_depth));
  out->set_resident_bytes(report.memory_bytes);
  out->set_refitted(report.bvh_refitted);
  if (report.binary_bvh_nodes > 0) {
    v1::BinaryBvhReport* binary_bvh = out->mutable_binary_bvh();
    binary_bvh->set_node_count(report.binary_bvh_nodes);
    binary_bvh->set_leaf_count(report.binary_bvh_leaves);
    binary_bvh->set_depth(static_cast<uint32_t>(report.binary_bvh_depth));
    binary_bvh->set_bytes(report.binary_bvh_bytes);
    EncodeDuration(absl::Seconds(report.binary_bvh_seconds), binary_bvh->mutable_duration());
  }
  if (report.kd_tree_nodes == 0) return;
  v1::KdTreeReport* kd_tree = out->mutable_kd_tree();
  kd_tree->set_node_count(report.kd_tree_nodes);
  kd_tree->set_leaf_count(report.kd_tree_leaves);
  kd_tree->set_reference_count(report.kd_tree_references);
  kd_tree->set_depth(static_cast<uint32_t>(report.kd_tree_depth));
  kd_tree->set_bytes(report.kd_tree_bytes);
  EncodeDuration(absl::Seconds(report.kd_tree_seconds), kd_tree->mutable_duration());
}

v1::Culling EncodeCulling(Culling culling) {
  switch (culling) {
    case Culling::kNone:
      return v1::CULLING_NONE;
    case Culling::kBack:
      return v1::CULLING_BACK;
    case Culling::kFront:
      return v1::CULLING_FRONT;
  }
  return v1::CULLING_UNSPECIFIED;
}

// Beyond an int is beyond every range, too.
int Number(uint32_t value) {
  return static_cast<int>(std::min<uint32_t>(value, std::numeric_limits<int>::max()));
}

}  // namespace

void EncodeTime(absl::Time time, google::protobuf::Timestamp* out) {
  const int64_t seconds = absl::ToUnixSeconds(time);
  out->set_seconds(seconds);
  out->set_nanos(
      static_cast<int32_t>(absl::ToInt64Nanoseconds(time - absl::FromUnixSeconds(seconds))));
}

void EncodeDuration(absl::Duration duration, google::protobuf::Duration* out) {
  const int64_t seconds = absl::IDivDuration(duration, absl::Seconds(1), &duration);
  out->set_seconds(seconds);
  out->set_nanos(static_cast<int32_t>(absl::ToInt64Nanoseconds(duration)));
}

void EncodeScene(const SceneView& view, v1::Scene* out) {
  out->set_name(SceneName(view.status.name));
  out->set_state(EncodeState(view));
  if (!view.status.error.ok()) {
    out->set_state_message(std::string(view.status.error.message()));
  } else if (!view.status.keep_error.ok()) {
    out->set_state_message(absl::StrCat("not stored: ", view.status.keep_error.message()));
  }
  out->set_stored(view.status.kept);
  if (view.create_time != absl::InfinitePast()) {
    EncodeTime(view.create_time, out->mutable_create_time());
    EncodeTime(view.update_time, out->mutable_update_time());
  }
  if (view.status.latest == nullptr || view.deleted) return;
  const Scene& scene = *view.status.latest;
  out->set_revision(static_cast<int64_t>(scene.revision));
  EncodeVector(scene.geometry.origin, out->mutable_origin());
  out->set_object_count(static_cast<uint32_t>(scene.geometry.objects.size()));
  out->set_triangle_count(scene.geometry.triangles.size());
  out->set_vertex_count(scene.geometry.vertices.size());
  if (!scene.geometry.bounds.empty()) {
    Box3d world;
    world.lo = ToDouble(scene.geometry.bounds.lo) + scene.geometry.origin;
    world.hi = ToDouble(scene.geometry.bounds.hi) + scene.geometry.origin;
    EncodeBox(world, out->mutable_bounds());
  }
  EncodeReport(scene.report, out->mutable_build_report());
  out->set_builtin_spec(view.builtin);
}

void EncodeStoredScene(const StoredScene& scene, v1::StoredScene* out) {
  out->set_name(SceneName(scene.file.scene_id));
  out->set_file_bytes(scene.file.bytes);
  EncodeTime(scene.file.modify_time, out->mutable_modify_time());
  if (!scene.view.has_value()) {
    out->set_state(scene.failed ? v1::SCENE_STATE_FAILED : v1::SCENE_STATE_UNLOADED);
    out->set_state_message(scene.note);
    return;
  }
  v1::Scene loaded;
  EncodeScene(*scene.view, &loaded);
  out->set_state(loaded.state());
  out->set_state_message(loaded.state_message());
  out->set_revision(loaded.revision());
}

void EncodeObject(const Scene& scene, uint32_t index, v1::SceneObject* out) {
  const ObjectRecord& record = scene.geometry.objects[index];
  out->set_index(index);
  out->set_object_name(record.name);
  out->set_triangle_count(record.triangle_count);
  out->set_vertex_count(record.vertex_count);
  out->set_mask(record.mask);
  out->set_culling(EncodeCulling(record.culling));
  out->set_dynamic(record.source_vertices != nullptr);
  for (const double number : record.transform.m) out->add_transform(number);
}

absl::StatusOr<Culling> DecodeCulling(v1::Culling culling) {
  switch (culling) {
    case v1::CULLING_UNSPECIFIED:
    case v1::CULLING_NONE:
      return Culling::kNone;
    case v1::CULLING_BACK:
      return Culling::kBack;
    case v1::CULLING_FRONT:
      return Culling::kFront;
    default:
      return InvalidField("object.culling", static_cast<int>(culling),
                          "is not a culling that this server knows",
                          v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
  }
}

absl::StatusOr<KdBuildOptions> DecodeKdTree(const v1::KdTreeOptions& options) {
  KdBuildOptions result;
  if (options.has_traversal_cost()) {
    result.traversal_cost = static_cast<float>(options.traversal_cost());
  }
  if (options.has_max_references()) {
    result.max_references = static_cast<float>(options.max_references());
  }
  result.perfect_splits = options.perfect_splits();
  if (options.min_leaf_triangles() > 0) {
    result.min_leaf_triangles = Number(options.min_leaf_triangles());
  }
  result.max_leaf_triangles = Number(options.max_leaf_triangles());
  result.max_depth = Number(options.max_depth());
  result.lay_out_leaves = options.lay_out_leaves();
  SL_RETURN_IF_ERROR(OptionOf("header.kd_tree", ValidateKdOptions(result)));
  return result;
}

absl::StatusOr<BinaryBvhOptions> DecodeBinaryBvh(const v1::BinaryBvhOptions& options) {
  BinaryBvhOptions result;
  if (options.bins() > 0) result.bins = Number(options.bins());
  if (options.has_cost_ratio()) result.cost_ratio = static_cast<float>(options.cost_ratio());
  if (options.min_triangles() > 0) result.min_triangles = Number(options.min_triangles());
  if (options.max_depth() > 0) result.max_depth = Number(options.max_depth());
  result.stop_by_cost = !options.ignore_cost();
  if (options.has_min_extent()) result.min_extent = static_cast<float>(options.min_extent());
  SL_RETURN_IF_ERROR(OptionOf("header.binary_bvh", ValidateBinaryBvhOptions(result)));
  return result;
}

absl::StatusOr<std::optional<BvhPreset>> DecodePreset(v1::BuildPreset preset) {
  switch (preset) {
    case v1::BUILD_PRESET_UNSPECIFIED:
      return std::optional<BvhPreset>();
    case v1::BUILD_PRESET_STATIC:
      return std::optional<BvhPreset>(BvhPreset::kStatic);
    case v1::BUILD_PRESET_DYNAMIC:
      return std::optional<BvhPreset>(BvhPreset::kDynamic);
    case v1::BUILD_PRESET_COMPACT:
      return std::optional<BvhPreset>(BvhPreset::kCompact);
    default:
      return InvalidField("header.build_preset", static_cast<int>(preset),
                          "is not a preset that this server knows",
                          v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
  }
}

}  // namespace sightline
