// SPDX-License-Identifier: Apache-2.0
#include "server/codec/query_codec.h"

#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/base/status_macros.h"
#include "core/traverse/leaf_culling.h"
#include "core/traverse/rtt.h"
#include "server/base/error.h"
#include "server/base/resource_name.h"
#include "server/codec/geometry_codec.h"
#include "server/codec/packed_array.h"

namespace sightline {
namespace {

absl::StatusOr<Strategy> DecodeStrategy(v1::Strategy strategy) {
  switch (strategy) {
    case v1::STRATEGY_UNSPECIFIED:
    case v1::STRATEGY_AUTO:
      return Strategy::kAuto;
    case v1::STRATEGY_SINGLE:
      return Strategy::kSingle;
    case v1::STRATEGY_PACKET:
      return Strategy::kPacket;
    case v1::STRATEGY_BRUTE_FORCE:
      return Strategy::kBruteForce;
    case v1::STRATEGY_SHAFT:
      return Strategy::kShaft;
    case v1::STRATEGY_RTT:
      return Strategy::kRtt;
    default:
      return InvalidField("options.strategy", static_cast<int>(strategy),
                          "is not a strategy that this server knows",
                          v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
  }
}

absl::StatusOr<Structure> DecodeStructure(v1::Structure structure) {
  switch (structure) {
    case v1::STRUCTURE_UNSPECIFIED:
    case v1::STRUCTURE_AUTO:
      return Structure::kAuto;
    case v1::STRUCTURE_BVH:
      return Structure::kBvh;
    case v1::STRUCTURE_KD_TREE:
      return Structure::kKdTree;
    case v1::STRUCTURE_BINARY_BVH:
      return Structure::kBinaryBvh;
    default:
      return InvalidField("options.structure", static_cast<int>(structure),
                          "is not a structure that this server knows",
                          v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
  }
}

// The wire's numbers are core's, after UNSPECIFIED.
constexpr int kFirstIntersector = v1::INTERSECTOR_EXACT;
static_assert(static_cast<int>(Intersector::kExact) + kFirstIntersector == v1::INTERSECTOR_EXACT);
static_assert(static_cast<int>(Intersector::kHavelHerout) + kFirstIntersector ==
              v1::INTERSECTOR_HAVEL_HEROUT);
static_assert(static_cast<int>(Intersector::kHavelHeroutDivided) + kFirstIntersector ==
              v1::INTERSECTOR_HAVEL_HEROUT_DIVIDED);
static_assert(static_cast<int>(Intersector::kWald) + kFirstIntersector == v1::INTERSECTOR_WALD);
static_assert(static_cast<int>(Intersector::kShevtsov) + kFirstIntersector ==
              v1::INTERSECTOR_SHEVTSOV);
static_assert(static_cast<int>(Intersector::kKenslerShirley) + kFirstIntersector ==
              v1::INTERSECTOR_KENSLER_SHIRLEY);
static_assert(static_cast<int>(Intersector::kMoellerTrumbore) + kFirstIntersector ==
              v1::INTERSECTOR_MOELLER_TRUMBORE);
static_assert(static_cast<int>(Intersector::kHavelHeroutDotProduct) + kFirstIntersector ==
              v1::INTERSECTOR_HAVEL_HEROUT_DOT_PRODUCT);

absl::StatusOr<Intersector> DecodeIntersector(v1::Intersector intersector) {
  if (intersector == v1::INTERSECTOR_UNSPECIFIED) return Intersector::kExact;
  if (!v1::Intersector_IsValid(intersector)) {
    return InvalidField("options.intersector", static_cast<int>(intersector),
                        "is not an intersector that this server knows",
                        v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
  }
  return static_cast<Intersector>(intersector - kFirstIntersector);
}

absl::StatusOr<LeafCulling> DecodeLeafCulling(const v1::LeafCulling& culling) {
  LeafCulling result;
  result.side_planes = culling.side_planes();
  result.near_far = culling.near_far_planes();
  result.aperture = culling.aperture();
  result.aperture_first = culling.aperture_first();
  result.skip_edges = culling.skip_edges();
  result.first_axis = culling.first_axis();
  result.ray_mask = culling.ray_mask();
  result.split = culling.split_to_rays() ? PacketSplit::kSingleRays : PacketSplit::kHalves;
  result.ray_box = culling.ray_box();
  result.ray_box_update = !culling.ray_box_fixed();
  result.mailbox = culling.mailbox();
  result.cell_boxes = culling.cell_boxes();
  switch (culling.frustum_rays()) {
    case v1::FRUSTUM_RAYS_UNSPECIFIED:
    case v1::FRUSTUM_RAYS_ALL:
      result.frustum = FrustumRays::kAll;
      break;
    case v1::FRUSTUM_RAYS_ROWS:
      result.frustum = FrustumRays::kRows;
      break;
    case v1::FRUSTUM_RAYS_MASKED:
      result.frustum = FrustumRays::kMasked;
      break;
    default:
      return InvalidField(
          "options.leaf_culling.frustum_rays", static_cast<int>(culling.frustum_rays()),
          "is not a choice of rays that this server knows", v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
  }
  switch (culling.node_test()) {
    case v1::NODE_TEST_UNSPECIFIED:
    case v1::NODE_TEST_FIRST_ACTIVE:
      result.node_test = NodeTest::kFirstActive;
      break;
    case v1::NODE_TEST_CORNERS:
      result.node_test = NodeTest::kCorners;
      break;
    case v1::NODE_TEST_ALL_RAYS:
      result.node_test = NodeTest::kAllRays;
      break;
    default:
      return InvalidField("options.leaf_culling.node_test", static_cast<int>(culling.node_test()),
                          "is not a test of nodes that this server knows",
                          v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
  }
  if (culling.ray_box_min_triangles() > kMaxRayBoxMinTriangles) {
    return InvalidField("options.leaf_culling.ray_box_min_triangles",
                        culling.ray_box_min_triangles(),
                        absl::StrCat("must be at most ", kMaxRayBoxMinTriangles));
  }
  if (culling.ray_box_min_triangles() > 0) {
    result.ray_box_min_triangles = culling.ray_box_min_triangles();
  }
  return result;
}

}  // namespace

absl::StatusOr<DecodedOptions> DecodeOptions(const v1::QueryOptions& options) {
  DecodedOptions result;
  SL_ASSIGN_OR_RETURN(result.query.strategy, DecodeStrategy(options.strategy()));
  SL_ASSIGN_OR_RETURN(result.query.structure, DecodeStructure(options.structure()));
  if (options.has_mask()) result.query.mask = options.mask();
  const uint32_t antialiasing = options.rtt().antialiasing();
  if (antialiasing > uint32_t{kMaxRttAntialiasing}) {
    return InvalidField("options.rtt.antialiasing", antialiasing,
                        absl::StrCat("must be at most ", kMaxRttAntialiasing));
  }
  if (antialiasing > 0) result.query.rtt_antialiasing = static_cast<int>(antialiasing);
  result.query.rtt_shared_edges = options.rtt().shared_edges();
  const uint32_t side_by_side = options.rtt().side_by_side();
  if (side_by_side > uint32_t{kMaxRttSideBySide}) {
    return InvalidField("options.rtt.side_by_side", side_by_side,
                        absl::StrCat("must be at most ", kMaxRttSideBySide));
  }
  result.query.rtt_side_by_side = static_cast<int>(side_by_side);
  if (options.has_leaf_culling()) {
    SL_ASSIGN_OR_RETURN(result.query.leaf_culling, DecodeLeafCulling(options.leaf_culling()));
  }
  SL_ASSIGN_OR_RETURN(result.query.intersector, DecodeIntersector(options.intersector()));
  if (options.packet_side() > 16) {
    return InvalidField("options.packet_side", options.packet_side(), "must be 2, 4, 8 or 16");
  }
  if (options.packet_side() > 0) {
    result.query.packet_side = static_cast<int>(options.packet_side());
  }
  result.query.pixel_shadow_packets = options.pixel_shadow_packets();
  result.statistics = options.statistics();
  return result;
}

v1::Strategy EncodeStrategy(Strategy strategy) {
  switch (strategy) {
    case Strategy::kAuto:
      return v1::STRATEGY_AUTO;
    case Strategy::kSingle:
      return v1::STRATEGY_SINGLE;
    case Strategy::kPacket:
      return v1::STRATEGY_PACKET;
    case Strategy::kBruteForce:
      return v1::STRATEGY_BRUTE_FORCE;
    case Strategy::kShaft:
      return v1::STRATEGY_SHAFT;
    case Strategy::kRtt:
      return v1::STRATEGY_RTT;
  }
  return v1::STRATEGY_UNSPECIFIED;
}

std::vector<Strategy> AvailableStrategies() {
  return {Strategy::kAuto,       Strategy::kSingle, Strategy::kPacket,
          Strategy::kBruteForce, Strategy::kShaft,  Strategy::kRtt};
}

absl::Status CheckSceneOptions(const Scene& scene, const QueryOptions& options) {
  absl::Status status = CheckOptions(scene, options);
  if (absl::IsInvalidArgument(status)) {
    // Each is good by itself: they do not go together.
    return WithReason(
        std::move(status), v1::ERROR_REASON_INVALID_FIELD,
        {{"field", "options"},
         {"value", absl::StrCat("strategy ", StrategyName(options.strategy), ", structure ",
                                StructureName(options.structure), ", intersector ",
                                IntersectorName(options.intersector))}});
  }
  if (!absl::IsFailedPrecondition(status)) return status;
  return WithReason(std::move(status), v1::ERROR_REASON_STRUCTURE_UNAVAILABLE,
                    {{"resource", SceneName(scene.name)}});
}

absl::StatusOr<PointOptions> DecodePointOptions(const v1::PointOptions& options) {
  if (!(std::isfinite(options.attach_distance()) && options.attach_distance() >= 0)) {
    return InvalidField("point_options.attach_distance", options.attach_distance(),
                        "must be finite and at least 0");
  }
  if (!std::isfinite(options.normal_offset())) {
    return InvalidField("point_options.normal_offset", options.normal_offset(), "must be finite");
  }
  return PointOptions{.attach_distance = options.attach_distance(),
                      .offset = options.normal_offset()};
}

absl::StatusOr<std::vector<uint32_t>> DecodedPoints::Sources(const SceneGeometry& geometry) const {
  std::vector<uint32_t> sources(objects.size(), kNoTriangle);
  for (size_t i = 0; i < objects.size(); ++i) {
    if (objects[i] == kNoTriangle) continue;
    SL_ASSIGN_OR_RETURN(sources[i], DecodeTriangle(absl::StrCat("points[", i, "].source"),
                                                   objects[i], triangles[i], geometry));
  }
  return sources;
}

absl::Status AppendPoints(absl::string_view field, const v1::PointArrays& arrays,
                          DecodedPoints* points) {
  const PointBytes bytes{.points = WireArray::Refer(arrays.points()),
                         .source_objects = WireArray::Refer(arrays.source_objects()),
                         .source_triangles = WireArray::Refer(arrays.source_triangles()),
                         .normals = WireArray::Refer(arrays.normals())};
  return AppendPoints(field, bytes, points);
}

absl::Status AppendPoints(absl::string_view field, const PointBytes& arrays,
                          DecodedPoints* points) {
  const size_t before = points->positions.size();
  SL_RETURN_IF_ERROR(AppendArray(arrays.points, absl::StrCat(field, ".points"), "float64 [n, 3]",
                                 &points->positions));
  const size_t count = points->positions.size();
  if (count == before) {
    return InvalidField(absl::StrCat(field, ".points"), "", "needs at least one point",
                        v1::ERROR_REASON_BAD_ARRAY_LENGTH);
  }
  const auto append = [&](absl::string_view name, const WireArray& bytes, absl::string_view shape,
                          auto* out) -> absl::Status {
    if (bytes.empty() && out->empty()) return absl::OkStatus();
    const std::string full = absl::StrCat(field, ".", name);
    SL_RETURN_IF_ERROR(AppendArray(bytes, full, shape, out));
    return CheckCount(full, out->size(), count, "points");
  };
  SL_RETURN_IF_ERROR(
      append("source_objects", arrays.source_objects, "uint32 [n]", &points->objects));
  SL_RETURN_IF_ERROR(
      append("source_triangles", arrays.source_triangles, "uint32 [n]", &points->triangles));
  SL_RETURN_IF_ERROR(append("normals", arrays.normals, "float64 [n, 3]", &points->normals));
  return CheckCount(absl::StrCat(field, ".source_triangles"), points->triangles.size(),
                    points->objects.size(), "source_objects");
}

absl::Status CheckSegments(size_t bytes, size_t stored_bytes) {
  if (bytes > 0 && stored_bytes > 0) {
    return InvalidField("item.segments_f32", absl::StrCat(stored_bytes, " bytes"),
                        "must be empty where item.segments is not");
  }
  if (stored_bytes > 0) {
    return CheckArrayLength<std::array<Vec3f, 2>>(stored_bytes, "item.segments_f32",
                                                  "float32 [n, 6]");
  }
  if (bytes == 0) {
    return InvalidField("item.segments", "", "needs at least one segment",
                        v1::ERROR_REASON_BAD_ARRAY_LENGTH);
  }
  return CheckArrayLength<std::array<Vec3d, 2>>(bytes, "item.segments", "float64 [n, 6]");
}

absl::Status DecodeSegments(absl::string_view bytes, std::vector<std::array<Vec3d, 2>>* segments) {
  return DecodeArray(bytes, "item.segments", "float64 [n, 6]", segments);
}

absl::StatusOr<absl::Duration> DecodeDuration(absl::string_view field, bool present,
                                              const google::protobuf::Duration& duration,
                                              absl::Duration unset, absl::Duration most) {
  if (!present) return unset;
  const absl::Duration value =
      absl::Seconds(duration.seconds()) + absl::Nanoseconds(duration.nanos());
  if (value > absl::ZeroDuration() && value <= most) return value;
  return InvalidField(field, absl::FormatDuration(value),
                      absl::StrCat("must be positive and at most ", absl::FormatDuration(most)));
}

}  // namespace sightline
