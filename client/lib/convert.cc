// SPDX-License-Identifier: Apache-2.0
#include "client/lib/convert.h"

#include <bit>

#include "absl/strings/strip.h"

namespace sightline::client {

static_assert(std::endian::native == std::endian::little, "arrays are packed little-endian");

void ToProto(const Point3& p, v1::Vector3* out) {
  out->set_x(p[0]);
  out->set_y(p[1]);
  out->set_z(p[2]);
}

void ToProto(const Camera& camera, v1::Camera* out) {
  ToProto(camera.eye, out->mutable_eye());
  ToProto(camera.right, out->mutable_right());
  ToProto(camera.up, out->mutable_up());
  ToProto(camera.forward, out->mutable_forward());
  out->set_tan_half_fov_y(camera.tan_half_fov_y);
  out->set_width(camera.width);
  out->set_height(camera.height);
}

void ToProto(const Light& light, v1::Light* out) {
  switch (light.kind) {
    case Light::Kind::kPoint:
      ToProto(light.position, out->mutable_point()->mutable_position());
      break;
    case Light::Kind::kDirectional:
      ToProto(light.direction, out->mutable_directional()->mutable_direction());
      break;
    case Light::Kind::kRectangle: {
      v1::RectangularAreaLight* area = out->mutable_rectangular_area();
      ToProto(light.position, area->mutable_center());
      ToProto(light.half_u, area->mutable_half_u());
      ToProto(light.half_v, area->mutable_half_v());
      area->set_sample_count(light.samples);
      break;
    }
  }
  out->set_mask(light.mask);
  out->set_weight(light.weight);
}

v1::BuildPreset BuildPresetToProto(BuildPreset preset) {
  switch (preset) {
    case BuildPreset::kStatic:
      return v1::BUILD_PRESET_STATIC;
    case BuildPreset::kDynamic:
      return v1::BUILD_PRESET_DYNAMIC;
    case BuildPreset::kCompact:
      return v1::BUILD_PRESET_COMPACT;
  }
  return v1::BUILD_PRESET_UNSPECIFIED;
}

void ToProto(const KdTreeOptions& options, v1::KdTreeOptions* out) {
  if (options.traversal_cost != 0) out->set_traversal_cost(options.traversal_cost);
  out->set_perfect_splits(options.perfect_splits);
  out->set_min_leaf_triangles(options.min_leaf_triangles);
  out->set_max_leaf_triangles(options.max_leaf_triangles);
  out->set_max_depth(options.max_depth);
  if (options.max_references != 0) out->set_max_references(options.max_references);
  out->set_lay_out_leaves(options.lay_out_leaves);
}

void ToProto(const BinaryBvhOptions& options, v1::BinaryBvhOptions* out) {
  out->set_bins(options.bins);
  if (options.cost_ratio != 0) out->set_cost_ratio(options.cost_ratio);
  out->set_min_triangles(options.min_triangles);
  out->set_max_depth(options.max_depth);
  out->set_ignore_cost(options.ignore_cost);
  if (options.min_extent) out->set_min_extent(*options.min_extent);
}

namespace {

v1::Culling CullingToProto(Culling culling) {
  switch (culling) {
    case Culling::kBack:
      return v1::CULLING_BACK;
    case Culling::kFront:
      return v1::CULLING_FRONT;
    case Culling::kNone:
      break;
  }
  return v1::CULLING_NONE;
}

absl::Time TimeFromProto(const google::protobuf::Timestamp& time) {
  return absl::FromUnixSeconds(time.seconds()) + absl::Nanoseconds(time.nanos());
}

}  // namespace

void ToProto(const LeafCulling& culling, v1::LeafCulling* out) {
  out->set_side_planes(culling.side_planes);
  out->set_near_far_planes(culling.near_far_planes);
  out->set_aperture(culling.aperture);
  out->set_aperture_first(culling.aperture_first);
  out->set_skip_edges(culling.skip_edges);
  out->set_first_axis(culling.first_axis);
  out->set_ray_mask(culling.ray_mask);
  out->set_split_to_rays(culling.split_to_rays);
  out->set_frustum_rays(culling.frustum_rays == FrustumRays::kMasked ? v1::FRUSTUM_RAYS_MASKED
                        : culling.frustum_rays == FrustumRays::kRows ? v1::FRUSTUM_RAYS_ROWS
                                                                     : v1::FRUSTUM_RAYS_ALL);
  out->set_ray_box(culling.ray_box);
  out->set_ray_box_fixed(culling.ray_box_fixed);
  out->set_mailbox(culling.mailbox);
  out->set_cell_boxes(culling.cell_boxes);
  out->set_ray_box_min_triangles(culling.ray_box_min_triangles);
  out->set_node_test(culling.node_test == NodeTest::kCorners   ? v1::NODE_TEST_CORNERS
                     : culling.node_test == NodeTest::kAllRays ? v1::NODE_TEST_ALL_RAYS
                                                               : v1::NODE_TEST_FIRST_ACTIVE);
}

void ToProto(const QueryOptions& options, v1::QueryOptions* out) {
  switch (options.strategy) {
    case Strategy::kAuto:
      out->set_strategy(v1::STRATEGY_AUTO);
      break;
    case Strategy::kSingle:
      out->set_strategy(v1::STRATEGY_SINGLE);
      break;
    case Strategy::kPacket:
      out->set_strategy(v1::STRATEGY_PACKET);
      break;
    case Strategy::kBruteForce:
      out->set_strategy(v1::STRATEGY_BRUTE_FORCE);
      break;
    case Strategy::kShaft:
      out->set_strategy(v1::STRATEGY_SHAFT);
      break;
    case Strategy::kRtt:
      out->set_strategy(v1::STRATEGY_RTT);
      break;
  }
  switch (options.structure) {
    case Structure::kAuto:
      out->set_structure(v1::STRUCTURE_AUTO);
      break;
    case Structure::kBvh:
      out->set_structure(v1::STRUCTURE_BVH);
      break;
    case Structure::kKdTree:
      out->set_structure(v1::STRUCTURE_KD_TREE);
      break;
    case Structure::kBinaryBvh:
      out->set_structure(v1::STRUCTURE_BINARY_BVH);
      break;
  }
  out->mutable_rtt()->set_antialiasing(options.rtt_antialiasing);
  out->mutable_rtt()->set_shared_edges(options.rtt_shared_edges);
  out->mutable_rtt()->set_side_by_side(options.rtt_side_by_side);
  if (options.leaf_culling) ToProto(*options.leaf_culling, out->mutable_leaf_culling());
  // The wire's numbers.
  static_assert(static_cast<int>(Intersector::kExact) == v1::INTERSECTOR_EXACT);
  static_assert(static_cast<int>(Intersector::kMoellerTrumbore) ==
                v1::INTERSECTOR_MOELLER_TRUMBORE);
  static_assert(static_cast<int>(Intersector::kHavelHeroutDotProduct) ==
                v1::INTERSECTOR_HAVEL_HEROUT_DOT_PRODUCT);
  out->set_intersector(static_cast<v1::Intersector>(options.intersector));
  out->set_packet_side(options.packet_side);
  out->set_pixel_shadow_packets(options.pixel_shadow_packets);
  out->set_mask(options.mask);
  out->set_statistics(options.statistics);
}

void ToProto(const PointOptions& options, v1::PointOptions* out) {
  out->set_attach_distance(options.attach_distance);
  out->set_normal_offset(options.normal_offset);
}

void ToProto(const ObjectUpload& object, v1::ObjectHeader* out) {
  out->set_object_name(object.name);
  out->set_vertex_count(object.vertices.size() / 3);
  out->set_triangle_count(object.indices.size() / 3);
  if (object.transform) {
    for (double m : *object.transform) out->add_transform(m);
  }
  out->set_mask(object.mask);
  out->set_culling(CullingToProto(object.culling));
  out->set_dynamic(object.dynamic);
}

void ToProto(absl::Duration duration, google::protobuf::Duration* out) {
  out->set_seconds(absl::IDivDuration(duration, absl::Seconds(1), &duration));
  out->set_nanos(static_cast<int32_t>(absl::ToInt64Nanoseconds(duration)));
}

Point3 FromProto(const v1::Vector3& p) { return {p.x(), p.y(), p.z()}; }

absl::Duration FromProto(const google::protobuf::Duration& duration) {
  return absl::Seconds(duration.seconds()) + absl::Nanoseconds(duration.nanos());
}

SceneState FromProto(v1::SceneState state) {
  switch (state) {
    case v1::SCENE_STATE_BUILDING:
      return SceneState::kBuilding;
    case v1::SCENE_STATE_READY:
      return SceneState::kReady;
    case v1::SCENE_STATE_UPDATING:
      return SceneState::kUpdating;
    case v1::SCENE_STATE_FAILED:
      return SceneState::kFailed;
    case v1::SCENE_STATE_DELETED:
      return SceneState::kDeleted;
    case v1::SCENE_STATE_UNLOADED:
      return SceneState::kUnloaded;
    default:
      return SceneState::kUnknown;
  }
}

StoredScene FromProto(const v1::StoredScene& scene) {
  StoredScene out;
  out.name = scene.name();
  out.file_bytes = scene.file_bytes();
  if (scene.has_modify_time()) out.modify_time = TimeFromProto(scene.modify_time());
  out.state = FromProto(scene.state());
  out.state_message = scene.state_message();
  out.revision = scene.revision();
  return out;
}

Scene FromProto(const v1::Scene& scene) {
  Scene out;
  out.name = scene.name();
  out.revision = scene.revision();
  out.origin = FromProto(scene.origin());
  out.objects = scene.object_count();
  out.triangles = scene.triangle_count();
  out.vertices = scene.vertex_count();
  if (scene.has_bounds()) {
    out.bounds = {FromProto(scene.bounds().min()), FromProto(scene.bounds().max())};
  }
  const v1::BuildReport& report = scene.build_report();
  out.report.input_triangles = report.input_triangle_count();
  out.report.non_finite_triangles = report.non_finite_triangle_count();
  out.report.zero_area_triangles = report.zero_area_triangle_count();
  out.report.duplicate_triangles = report.duplicate_triangle_count();
  out.report.non_finite_vertices = report.non_finite_vertex_count();
  out.report.max_rounding = report.max_rounding();
  out.report.compile_time = FromProto(report.compile_duration());
  out.report.structure_time = FromProto(report.structure_duration());
  out.report.nodes = report.node_count();
  out.report.leaves = report.leaf_count();
  out.report.depth = report.depth();
  out.report.refitted = report.refitted();
  out.report.resident_bytes = report.resident_bytes();
  out.report.kd_tree_nodes = report.kd_tree().node_count();
  out.report.kd_tree_leaves = report.kd_tree().leaf_count();
  out.report.kd_tree_references = report.kd_tree().reference_count();
  out.report.kd_tree_bytes = report.kd_tree().bytes();
  out.report.kd_tree_depth = report.kd_tree().depth();
  out.report.kd_tree_time = FromProto(report.kd_tree().duration());
  out.report.binary_bvh_nodes = report.binary_bvh().node_count();
  out.report.binary_bvh_leaves = report.binary_bvh().leaf_count();
  out.report.binary_bvh_bytes = report.binary_bvh().bytes();
  out.report.binary_bvh_depth = report.binary_bvh().depth();
  out.report.binary_bvh_time = FromProto(report.binary_bvh().duration());
  out.state = FromProto(scene.state());
  out.state_message = scene.state_message();
  out.stored = scene.stored();
  out.builtin = scene.builtin_spec();
  if (scene.has_create_time()) out.create_time = TimeFromProto(scene.create_time());
  if (scene.has_update_time()) out.update_time = TimeFromProto(scene.update_time());
  return out;
}

SceneObject FromProto(const v1::SceneObject& object) {
  SceneObject out;
  out.index = object.index();
  out.name = object.object_name();
  out.triangles = object.triangle_count();
  out.vertices = object.vertex_count();
  out.mask = object.mask();
  out.culling = object.culling() == v1::CULLING_BACK    ? Culling::kBack
                : object.culling() == v1::CULLING_FRONT ? Culling::kFront
                                                        : Culling::kNone;
  out.dynamic = object.dynamic();
  return out;
}

PointSet FromProto(const v1::PointSet& set) {
  PointSet out;
  out.name = set.name();
  out.revision = set.revision();
  out.points = set.point_count();
  out.invalid_points = set.invalid_point_count();
  out.attached_points = set.attached_point_count();
  out.near_surface_points = set.near_surface_point_count();
  if (set.has_create_time()) out.create_time = TimeFromProto(set.create_time());
  if (set.has_expire_time()) out.expire_time = TimeFromProto(set.expire_time());
  out.resident_bytes = set.resident_bytes();
  return out;
}

Statistics FromProto(const v1::Statistics& statistics) {
  Statistics out;
  out.rays = statistics.ray_count();
  out.nodes = statistics.node_count();
  out.triangle_tests = statistics.triangle_test_count();
  out.leaves = statistics.leaf_count();
  out.double_tests = statistics.double_test_count();
  out.exact_tests = statistics.exact_test_count();
  out.answered_by_shaft = statistics.shaft_answered_count();
  out.answered_by_triangles = statistics.triangles_answered_count();
  out.answered_by_packet = statistics.packet_answered_count();
  out.answered_by_ray = statistics.ray_answered_count();
  switch (statistics.strategy()) {
    case v1::STRATEGY_SINGLE:
      out.strategy = Strategy::kSingle;
      break;
    case v1::STRATEGY_PACKET:
      out.strategy = Strategy::kPacket;
      break;
    case v1::STRATEGY_BRUTE_FORCE:
      out.strategy = Strategy::kBruteForce;
      break;
    case v1::STRATEGY_SHAFT:
      out.strategy = Strategy::kShaft;
      break;
    case v1::STRATEGY_RTT:
      out.strategy = Strategy::kRtt;
      break;
    default:
      break;
  }
  out.compute = absl::Nanoseconds(statistics.compute_nanos());
  out.queue = absl::Nanoseconds(statistics.queue_nanos());
  out.tiles = statistics.tile_count();
  out.tiles_answered = statistics.answered_tile_count();
  out.relevant_triangles = statistics.relevant_triangle_count();
  out.culled_tests = statistics.culled_test_count();
  out.shaft_triangles = statistics.shaft_triangle_count();
  out.shaft_relevant = statistics.shaft_relevant_count();
  out.shaft_pairs = statistics.shaft_pair_count();
  out.shaft_covers = statistics.shaft_cover_count();
  out.shaft_splits = statistics.shaft_split_count();
  out.shaft_singles = statistics.shaft_single_count();
  return out;
}

Capabilities FromProto(const v1::Capabilities& capabilities) {
  Capabilities out;
  out.version = capabilities.version();
  for (const int encoding : capabilities.encodings()) {
    out.stored_segments |= encoding == v1::ENCODING_STORED_FLOAT32;
  }
  const v1::Limits& in = capabilities.limits();
  Limits& limits = out.limits;
  limits.max_message_bytes = in.max_message_bytes();
  limits.target_reply_bytes = in.target_reply_bytes();
  limits.max_concurrent_streams = in.max_concurrent_streams();
  limits.stream_credit_rays = in.stream_credit_rays();
  limits.min_item_cost_rays = in.min_item_cost_rays();
  limits.max_item_rays = in.max_item_rays();
  limits.max_queued_rays = in.max_queued_rays();
  limits.max_lights = in.max_lights();
  limits.max_samples_per_light = in.max_samples_per_light();
  limits.max_light_samples = in.max_light_samples();
  limits.max_image_width = in.max_image_width();
  limits.max_image_height = in.max_image_height();
  limits.max_scenes = in.max_scenes();
  limits.max_objects_per_scene = in.max_objects_per_scene();
  limits.max_triangles_per_scene = in.max_triangles_per_scene();
  limits.max_vertices_per_scene = in.max_vertices_per_scene();
  limits.max_scene_bytes = in.max_scene_bytes();
  limits.max_points_per_set = in.max_points_per_set();
  limits.max_point_sets = in.max_point_sets();
  limits.max_point_set_bytes = in.max_point_set_bytes();
  limits.max_lease = FromProto(in.max_lease());
  limits.max_pin_duration = FromProto(in.max_pin_duration());
  limits.max_coordinate = in.max_coordinate();
  limits.max_concurrent_uploads = in.max_concurrent_uploads();
  limits.max_queued_rays_per_client = in.max_queued_rays_per_client();
  limits.max_bytes_per_scene = in.max_bytes_per_scene();
  limits.max_connections = in.max_connections();
  limits.max_connections_per_address = in.max_connections_per_address();
  limits.max_concurrent_uploads_per_client = in.max_concurrent_uploads_per_client();
  limits.max_streams_per_client = in.max_streams_per_client();
  limits.max_upload_idle = FromProto(in.max_upload_idle());
  limits.max_stream_stall = FromProto(in.max_stream_stall());
  out.instruction_set = capabilities.instruction_set();
  out.available_instruction_sets.assign(capabilities.available_instruction_sets().begin(),
                                        capabilities.available_instruction_sets().end());
  for (int strategy : capabilities.strategies()) {
    const std::string& name = v1::Strategy_Name(static_cast<v1::Strategy>(strategy));
    if (!name.empty()) out.strategies.emplace_back(absl::StripPrefix(name, "STRATEGY_"));
  }
  out.builtin_scenes.assign(capabilities.builtin_scenes().begin(),
                            capabilities.builtin_scenes().end());
  out.threads = capabilities.thread_count();
  return out;
}

}  // namespace sightline::client
