// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "server/base/error.h"
#include "server/codec/geometry_codec.h"
#include "server/codec/packed_array.h"
#include "server/codec/query_codec.h"
#include "server/codec/result_codec.h"
#include "server/codec/scene_codec.h"

namespace sightline {
namespace {

using testing::ElementsAre;
using testing::Pair;

template <typename T>
std::string Bytes(const std::vector<T>& values) {
  std::string bytes;
  EncodeArray(std::span<const T>(values), &bytes);
  return bytes;
}

template <typename T>
std::vector<T> Values(const std::string& bytes) {
  std::vector<T> values;
  EXPECT_TRUE(DecodeArray(bytes, "test", "[n]", &values).ok());
  return values;
}

// As a client reads it.
template <typename Message>
Message ReadBack(const WireMessage& encoded) {
  Message message;
  EXPECT_TRUE(message.ParseFromString(encoded.ToString()));
  return message;
}

void ExpectInvalid(const absl::Status& status, absl::string_view named,
                   v1::ErrorReason reason = v1::ERROR_REASON_INVALID_FIELD) {
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << status;
  EXPECT_TRUE(absl::StrContains(status.message(), named)) << status << " does not name " << named;
  EXPECT_EQ(ReasonOf(status), reason) << status;
}

// As a client gets it.
std::map<std::string, std::string> MetadataOf(const absl::Status& status) {
  v1::ItemStatus item;
  ToItemStatus(status, &item);
  return {item.metadata().begin(), item.metadata().end()};
}

v1::Camera GoodCamera() {
  v1::Camera camera;
  camera.mutable_eye();
  camera.mutable_right()->set_x(1);
  camera.mutable_up()->set_z(1);
  camera.mutable_forward()->set_y(1);
  camera.set_tan_half_fov_y(0.5);
  camera.set_width(64);
  camera.set_height(48);
  return camera;
}

// Two objects of two and three triangles, and an empty one between them.
SceneGeometry ThreeObjects() {
  SceneGeometry geometry;
  geometry.vertices.resize(3);
  geometry.triangles.resize(5);
  ObjectRecord a, empty, b;
  a.triangle_count = 2;
  empty.first_triangle = 2;
  b.first_triangle = 2;
  b.triangle_count = 3;
  geometry.objects = {a, empty, b};
  return geometry;
}

TEST(PackedArrayTest, RoundTripsAtAnyAlignment) {
  const std::vector<Vec3d> points = {{1, 2, 3}, {-0.0, 1e300, 5e-324}};
  const std::string bytes = "x" + Bytes(points);
  std::vector<Vec3d> back;
  ASSERT_TRUE(DecodeArray(absl::string_view(bytes).substr(1), "f", "", &back).ok());
  ASSERT_EQ(back.size(), 2u);
  const auto before = std::as_bytes(std::span(points)), after = std::as_bytes(std::span(back));
  EXPECT_TRUE(std::equal(after.begin(), after.end(), before.begin(), before.end()));
}

TEST(PackedArrayTest, RefusesBrokenLengthsNamingThem) {
  std::vector<Vec3d> out;
  const absl::Status status = DecodeArray(std::string(25, 'x'), "item.points", "[n, 3]", &out);
  ExpectInvalid(status, "item.points = 25 bytes", v1::ERROR_REASON_BAD_ARRAY_LENGTH);
}

TEST(CameraTest, RefusesWhatIsNoCamera) {
  const Limits limits;
  EXPECT_TRUE(DecodeCamera(GoodCamera(), limits).ok());
  const auto check = [&](const char* named, const auto& spoil) {
    v1::Camera camera = GoodCamera();
    spoil(camera);
    ExpectInvalid(DecodeCamera(camera, limits).status(), named);
  };
  check("camera.eye", [](v1::Camera& c) { c.clear_eye(); });
  check("camera.eye", [](v1::Camera& c) { c.mutable_eye()->set_x(std::nan("")); });
  check("camera.eye", [](v1::Camera& c) { c.mutable_eye()->set_x(1e300); });
  check("camera.forward", [](v1::Camera& c) { c.mutable_forward()->set_y(0); });
  check("camera.right", [](v1::Camera& c) { c.mutable_right()->set_x(2); });
  check("right and up are not orthogonal", [](v1::Camera& c) { *c.mutable_up() = c.right(); });
  check("camera.width = 0", [](v1::Camera& c) { c.set_width(0); });
  check("camera.height = 0", [](v1::Camera& c) { c.set_height(0); });
  for (const double tan : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    check("camera.tan_half_fov_y", [&](v1::Camera& c) { c.set_tan_half_fov_y(tan); });
  }
  v1::Camera turned = GoodCamera();
  *turned.mutable_up() = turned.right();
  EXPECT_THAT(
      MetadataOf(DecodeCamera(turned, limits).status()),
      ElementsAre(Pair("field", "camera"), Pair("value",
                                                "right (1, 0, 0), up (1, 0, 0), forward (0, 1, 0), "
                                                "tan_half_fov_y 0.5")));
  v1::Camera wide = GoodCamera();
  wide.set_width(100000);
  EXPECT_EQ(DecodeCamera(wide, limits).status().code(), absl::StatusCode::kResourceExhausted);
}

TEST(MirrorTest, ObjectsAreNamedAndPlanesWhole) {
  SceneGeometry geometry = ThreeObjects();
  geometry.objects[2].name = "glass";
  google::protobuf::RepeatedPtrField<v1::Mirror> mirrors;
  v1::Mirror* const mirror = mirrors.Add();
  mirror->set_object_name("glass");
  auto decoded = DecodeMirrors(mirrors, "hall", geometry);
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  ASSERT_EQ(decoded->size(), 1u);
  EXPECT_EQ(decoded->front().object, 2u);
  EXPECT_FALSE(decoded->front().plane.has_value());
  mirror->mutable_plane()->mutable_point()->set_x(3);
  ExpectInvalid(DecodeMirrors(mirrors, "hall", geometry).status(),
                "header.mirrors[0].plane.normal = (unset)");
  mirror->mutable_plane()->mutable_normal()->set_z(-2);
  decoded = DecodeMirrors(mirrors, "hall", geometry);
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  EXPECT_EQ(decoded->front().plane->point.x, 3);
  EXPECT_EQ(decoded->front().plane->normal.z, -2);
  mirrors.Add()->set_object_name("door");
  const absl::Status status = DecodeMirrors(mirrors, "hall", geometry).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(status.message()),
              testing::HasSubstr("header.mirrors[1].object_name = \"door\""));
  EXPECT_THAT(MetadataOf(status),
              ElementsAre(Pair("field", "header.mirrors[1].object_name"),
                          Pair("resource", "scenes/hall"), Pair("value", "door")));
}

TEST(LightTest, RefusesWhatIsNoLight) {
  Limits limits;
  limits.max_lights = 2;
  limits.max_light_samples = 100;
  limits.max_samples_per_light = 60;
  google::protobuf::RepeatedPtrField<v1::Light> lights;
  lights.Add();
  ExpectInvalid(CheckLights(lights, limits).status(), "lights[0].kind");
  lights[0].mutable_rectangular_area();
  ExpectInvalid(CheckLights(lights, limits).status(), "lights[0].rectangular_area.sample_count");
  lights[0].mutable_rectangular_area()->set_sample_count(60);
  EXPECT_EQ(*CheckLights(lights, limits), 60u);
  *lights.Add() = lights[0];
  const absl::Status samples = CheckLights(lights, limits).status();
  EXPECT_TRUE(absl::StrContains(samples.message(), "max_light_samples = 100")) << samples;
  lights[1].mutable_rectangular_area()->set_sample_count(61);
  EXPECT_TRUE(absl::StrContains(CheckLights(lights, limits).status().message(),
                                "max_samples_per_light = 60"));
  lights[1].mutable_point();
  lights[1].set_weight(std::nan(""));
  ExpectInvalid(CheckLights(lights, limits).status(), "lights[1].weight");
  lights.Add();
  EXPECT_TRUE(absl::StrContains(CheckLights(lights, limits).status().message(), "max_lights = 2"));
}

TEST(LightTest, NonFiniteLightsAreInvalidSamplesNotErrors) {
  google::protobuf::RepeatedPtrField<v1::Light> lights;
  lights.Add()->mutable_point()->mutable_position()->set_x(std::nan(""));
  v1::Light* area = lights.Add();
  area->mutable_rectangular_area()->set_sample_count(4);
  area->set_weight(2);
  area->mutable_source()->set_object(2);
  area->mutable_source()->set_triangle(1);
  const absl::StatusOr<SampleSet> samples = DecodeLights(lights, ThreeObjects());
  ASSERT_TRUE(samples.ok()) << samples.status();
  ASSERT_EQ(samples->samples.size(), 5u);
  EXPECT_FALSE(samples->samples[0].valid);
  EXPECT_TRUE(samples->samples[1].valid);
  EXPECT_EQ(samples->samples[1].source_triangle, 3u);
  EXPECT_THAT(samples->weights, ElementsAre(1.0, 0.5, 0.5, 0.5, 0.5));
  area->mutable_source()->set_triangle(3);
  ExpectInvalid(DecodeLights(lights, ThreeObjects()).status(), "lights[1].source.triangle = 3");
}

TEST(LightTest, MoreSamplesThanTheEngineTakesAreNamed) {
  google::protobuf::RepeatedPtrField<v1::Light> lights;
  lights.Add()->mutable_rectangular_area()->set_sample_count(0xFFFFFFFFu);
  EXPECT_THAT(MetadataOf(DecodeLights(lights, ThreeObjects()).status()),
              ElementsAre(Pair("field", "lights[0].rectangular_area.sample_count"),
                          Pair("value", "4294967295")));
}

TEST(OptionsCodecTest, WhatDoesNotGoTogetherIsTold) {
  const absl::Status status =
      CheckSceneOptions(Scene(), {.strategy = Strategy::kRtt, .structure = Structure::kBvh});
  ExpectInvalid(status, "strategy RTT");
  EXPECT_THAT(MetadataOf(status),
              ElementsAre(Pair("field", "options"),
                          Pair("value", "strategy RTT, structure BVH, intersector EXACT")));
}

TEST(OptionsCodecTest, StrategiesAreKnownOrRefused) {
  for (const Strategy strategy : AvailableStrategies()) {
    v1::QueryOptions options;
    options.set_strategy(EncodeStrategy(strategy));
    EXPECT_EQ(DecodeOptions(options)->query.strategy, strategy);
  }
  v1::QueryOptions options;
  EXPECT_EQ(DecodeOptions(options)->query.mask, 0xFFFFFFFFu);
  options.set_mask(0);
  EXPECT_EQ(DecodeOptions(options)->query.mask, 0u);
  options.set_strategy(static_cast<v1::Strategy>(99));
  ExpectInvalid(DecodeOptions(options).status(), "99", v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
}

TEST(OptionsCodecTest, StructuresAndTilesAreKnownOrRefused) {
  v1::QueryOptions options;
  EXPECT_EQ(DecodeOptions(options)->query.structure, Structure::kAuto);
  EXPECT_EQ(DecodeOptions(options)->query.rtt_antialiasing, 1);
  options.set_structure(v1::STRUCTURE_KD_TREE);
  options.mutable_rtt()->set_antialiasing(6);
  options.mutable_rtt()->set_shared_edges(true);
  EXPECT_EQ(DecodeOptions(options)->query.structure, Structure::kKdTree);
  EXPECT_EQ(DecodeOptions(options)->query.rtt_antialiasing, 6);
  EXPECT_TRUE(DecodeOptions(options)->query.rtt_shared_edges);
  EXPECT_EQ(DecodeOptions(options)->query.rtt_side_by_side, 0);
  options.mutable_rtt()->set_side_by_side(4);
  EXPECT_EQ(DecodeOptions(options)->query.rtt_side_by_side, 4);
  options.mutable_rtt()->set_side_by_side(5);
  ExpectInvalid(DecodeOptions(options).status(), "options.rtt.side_by_side = 5");
  options.mutable_rtt()->clear_side_by_side();
  options.mutable_rtt()->set_antialiasing(7);
  ExpectInvalid(DecodeOptions(options).status(), "options.rtt.antialiasing = 7");
  options.mutable_rtt()->clear_antialiasing();
  EXPECT_FALSE(DecodeOptions(options)->query.leaf_culling.has_value());
  v1::LeafCulling* const culling = options.mutable_leaf_culling();
  EXPECT_FALSE(DecodeOptions(options)->query.leaf_culling->side_planes)
      << "nothing set, nothing done";
  EXPECT_EQ(DecodeOptions(options)->query.leaf_culling->ray_box_min_triangles, 3u);
  culling->set_side_planes(true);
  culling->set_ray_box_fixed(true);
  culling->set_ray_box_min_triangles(9);
  culling->set_frustum_rays(v1::FRUSTUM_RAYS_ROWS);
  EXPECT_TRUE(DecodeOptions(options)->query.leaf_culling->side_planes);
  EXPECT_FALSE(DecodeOptions(options)->query.leaf_culling->ray_box_update);
  EXPECT_EQ(DecodeOptions(options)->query.leaf_culling->ray_box_min_triangles, 9u);
  EXPECT_EQ(DecodeOptions(options)->query.leaf_culling->frustum, FrustumRays::kRows);
  culling->set_ray_box_min_triangles(1u << 21);
  ExpectInvalid(DecodeOptions(options).status(),
                "options.leaf_culling.ray_box_min_triangles = 2097152");
  culling->set_ray_box_min_triangles(0);
  culling->set_frustum_rays(static_cast<v1::FrustumRays>(7));
  ExpectInvalid(DecodeOptions(options).status(), "options.leaf_culling.frustum_rays = 7",
                v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
  culling->clear_frustum_rays();
  EXPECT_EQ(DecodeOptions(options)->query.leaf_culling->node_test, NodeTest::kFirstActive);
  culling->set_node_test(v1::NODE_TEST_CORNERS);
  EXPECT_EQ(DecodeOptions(options)->query.leaf_culling->node_test, NodeTest::kCorners);
  culling->set_node_test(static_cast<v1::NodeTest>(4));
  ExpectInvalid(DecodeOptions(options).status(), "options.leaf_culling.node_test = 4",
                v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
  options.clear_leaf_culling();
  options.set_structure(static_cast<v1::Structure>(9));
  ExpectInvalid(DecodeOptions(options).status(), "options.structure = 9",
                v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
}

TEST(OptionsCodecTest, IntersectorsAndPacketsAreKnownOrRefused) {
  v1::QueryOptions options;
  EXPECT_EQ(DecodeOptions(options)->query.intersector, Intersector::kExact);
  EXPECT_EQ(DecodeOptions(options)->query.packet_side, 16);
  for (const Intersector intersector : kPaperIntersectors) {
    v1::Intersector wire = v1::INTERSECTOR_UNSPECIFIED;
    ASSERT_TRUE(
        v1::Intersector_Parse(absl::StrCat("INTERSECTOR_", IntersectorName(intersector)), &wire));
    options.set_intersector(wire);
    EXPECT_EQ(DecodeOptions(options)->query.intersector, intersector);
  }
  options.set_intersector(static_cast<v1::Intersector>(9));
  ExpectInvalid(DecodeOptions(options).status(), "options.intersector = 9",
                v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
  options.clear_intersector();
  options.set_packet_side(4);
  EXPECT_EQ(DecodeOptions(options)->query.packet_side, 4);
  EXPECT_FALSE(DecodeOptions(options)->query.pixel_shadow_packets);
  options.set_pixel_shadow_packets(true);
  EXPECT_TRUE(DecodeOptions(options)->query.pixel_shadow_packets);
  options.set_packet_side(17);
  ExpectInvalid(DecodeOptions(options).status(), "options.packet_side = 17");
}

TEST(SceneCodecTest, BinaryBvhOptionsAreCheckedByName) {
  v1::BinaryBvhOptions options;
  EXPECT_EQ(DecodeBinaryBvh(options)->bins, BinaryBvhOptions().bins);
  EXPECT_EQ(DecodeBinaryBvh(options)->min_extent, BinaryBvhOptions().min_extent);
  EXPECT_TRUE(DecodeBinaryBvh(options)->stop_by_cost);
  options.set_bins(1024);
  options.set_cost_ratio(0.1);
  options.set_min_triangles(8);
  options.set_max_depth(20);
  options.set_ignore_cost(true);
  options.set_min_extent(0);
  const absl::StatusOr<BinaryBvhOptions> decoded = DecodeBinaryBvh(options);
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  EXPECT_EQ(decoded->bins, 1024);
  EXPECT_EQ(decoded->cost_ratio, 0.1f);
  EXPECT_EQ(decoded->min_triangles, 8);
  EXPECT_EQ(decoded->max_depth, 20);
  EXPECT_FALSE(decoded->stop_by_cost);
  EXPECT_EQ(decoded->min_extent, 0);
  options.set_bins(1025);
  ExpectInvalid(DecodeBinaryBvh(options).status(), "header.binary_bvh.bins is 1025");
  EXPECT_THAT(MetadataOf(DecodeBinaryBvh(options).status()),
              ElementsAre(Pair("field", "header.binary_bvh.bins"), Pair("value", "1025")));
  options.set_bins(8);
  options.set_max_depth(0xFFFFFFFFu);
  ExpectInvalid(DecodeBinaryBvh(options).status(), "header.binary_bvh.max_depth");
}

TEST(SceneCodecTest, KdTreeOptionsAreCheckedByName) {
  v1::KdTreeOptions options;
  EXPECT_EQ(DecodeKdTree(options)->traversal_cost, KdBuildOptions().traversal_cost);
  options.set_traversal_cost(0.1);
  options.set_min_leaf_triangles(4);
  options.set_max_depth(30);
  options.set_perfect_splits(true);
  options.set_lay_out_leaves(true);
  const absl::StatusOr<KdBuildOptions> decoded = DecodeKdTree(options);
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  EXPECT_FLOAT_EQ(decoded->traversal_cost, 0.1f);
  EXPECT_EQ(decoded->min_leaf_triangles, 4);
  EXPECT_EQ(decoded->max_depth, 30);
  EXPECT_TRUE(decoded->perfect_splits);
  EXPECT_TRUE(decoded->lay_out_leaves);
  options.set_max_depth(4'000'000'000u);
  ExpectInvalid(DecodeKdTree(options).status(), "header.kd_tree.max_depth");
  options.set_max_depth(0);
  options.set_traversal_cost(0);
  ExpectInvalid(DecodeKdTree(options).status(), "header.kd_tree.traversal_cost = 0");
  EXPECT_THAT(MetadataOf(DecodeKdTree(options).status()),
              ElementsAre(Pair("field", "header.kd_tree.traversal_cost"), Pair("value", "0")));
}

TEST(PointCodecTest, ArraysMustAgree) {
  v1::PointArrays arrays;
  DecodedPoints points;
  ExpectInvalid(AppendPoints("p", arrays, &points), "p.points", v1::ERROR_REASON_BAD_ARRAY_LENGTH);
  arrays.set_points(Bytes<Vec3d>({{1, 2, 3}, {4, 5, 6}}));
  points = {};
  EXPECT_TRUE(AppendPoints("p", arrays, &points).ok());
  arrays.set_source_objects(Bytes<uint32_t>({0, kNoTriangle}));
  points = {};
  ExpectInvalid(AppendPoints("p", arrays, &points), "p.source_triangles",
                v1::ERROR_REASON_BAD_ARRAY_LENGTH);
  arrays.set_source_triangles(Bytes<uint32_t>({1, 77}));
  points = {};
  ASSERT_TRUE(AppendPoints("p", arrays, &points).ok());
  EXPECT_THAT(*points.Sources(ThreeObjects()), ElementsAre(1u, kNoTriangle));
  arrays.set_normals(Bytes<Vec3d>({{0, 0, 1}}));
  points = {};
  ExpectInvalid(AppendPoints("p", arrays, &points), "p.normals", v1::ERROR_REASON_BAD_ARRAY_LENGTH);
  // A later chunk must bring what the first brought.
  arrays.clear_normals();
  points = {};
  ASSERT_TRUE(AppendPoints("p", arrays, &points).ok());
  arrays.clear_source_objects();
  arrays.clear_source_triangles();
  ExpectInvalid(AppendPoints("p", arrays, &points), "p.source_objects",
                v1::ERROR_REASON_BAD_ARRAY_LENGTH);
}

TEST(PointCodecTest, SourcesMustExist) {
  DecodedPoints points;
  points.positions.resize(1);
  points.objects = {3};
  points.triangles = {0};
  ExpectInvalid(points.Sources(ThreeObjects()).status(), "points[0].source.object = 3");
  points.objects = {1};
  ExpectInvalid(points.Sources(ThreeObjects()).status(), "points[0].source.triangle = 0");
}

TEST(PointCodecTest, OptionsMustBeFinite) {
  v1::PointOptions options;
  options.set_attach_distance(-1);
  ExpectInvalid(DecodePointOptions(options).status(), "attach_distance = -1");
  options.set_attach_distance(std::nan(""));
  ExpectInvalid(DecodePointOptions(options).status(), "attach_distance");
  options.set_attach_distance(0);
  options.set_normal_offset(std::numeric_limits<double>::infinity());
  ExpectInvalid(DecodePointOptions(options).status(), "normal_offset");
}

TEST(DurationTest, MustBePositiveAndShort) {
  google::protobuf::Duration duration;
  const auto decode = [&] {
    return DecodeDuration("d", true, duration, absl::Seconds(1), absl::Seconds(10));
  };
  ExpectInvalid(decode().status(), "d = 0");
  duration.set_seconds(-5);
  ExpectInvalid(decode().status(), "d = -5s");
  duration.set_seconds(11);
  ExpectInvalid(decode().status(), "d = 11s");
  duration.set_seconds(std::numeric_limits<int64_t>::max());
  EXPECT_FALSE(decode().ok());
  duration.set_seconds(10);
  EXPECT_EQ(*decode(), absl::Seconds(10));
  EXPECT_EQ(*DecodeDuration("d", false, duration, absl::Seconds(1), absl::Seconds(10)),
            absl::Seconds(1));
}

TEST(ResultCodecTest, TrianglesAreNumberedWithinTheirObjects) {
  std::string objects, triangles;
  EncodeTriangles(ThreeObjects(), std::vector<uint32_t>{4, 0, kNoTriangle, 1, 2}, &objects,
                  &triangles);
  EXPECT_THAT(Values<uint32_t>(objects), ElementsAre(2u, 0u, kNoTriangle, 0u, 2u));
  EXPECT_THAT(Values<uint32_t>(triangles), ElementsAre(2u, 0u, kNoTriangle, 1u, 0u));
}

TEST(ResultCodecTest, BitsAreLeastSignificantFirstAndPadded) {
  std::string bits;
  EncodeBits(std::vector<uint8_t>{1, 0, 1, 0, 0, 0, 0, 0, 1}, &bits);
  EXPECT_EQ(bits, std::string("\x05\x01", 2));
}

TEST(ResultCodecTest, NothingUnaskedIsSent) {
  ShadowResult result;
  result.lit_bits = {1, 2};
  result.lit_counts = {3};
  v1::ShadowOutputs wanted;
  wanted.set_lit_counts(true);
  const auto out = ReadBack<v1::ShadowResult>(
      EncodeShadows(ThreeObjects(), result, std::vector<uint8_t>{1}, {}, wanted));
  EXPECT_TRUE(out.lit_bits().empty());
  EXPECT_TRUE(out.valid_bits().empty());
  EXPECT_THAT(Values<uint32_t>(out.lit_counts()), ElementsAre(3u));
}

TEST(ResultCodecTest, InvalidPointsAndSamplesAreNamed) {
  ShadowResult result;
  result.lit_bits = {0, 0};
  std::vector<LightSample> samples(2);
  samples[1].valid = false;
  v1::ShadowOutputs wanted = WantedShadows({});
  EXPECT_TRUE(wanted.lit_bits());
  const auto out = ReadBack<v1::ShadowResult>(
      EncodeShadows(ThreeObjects(), result, std::vector<uint8_t>{1, 0, 1}, samples, wanted));
  EXPECT_EQ(out.valid_bits(), std::string("\x05", 1));
  EXPECT_THAT(out.invalid_samples(), ElementsAre(1u));
}

// Points 1, 4 and 9 of ten; two samples.
TEST(ResultCodecTest, ShadowsOfSomePointsAreSpreadOverAll) {
  ShadowResult of_hits;
  of_hits.lit_bits = {0b101, 0b010};
  of_hits.lit_counts = {1, 1, 1};
  of_hits.weighted_sums = {0.5, 0.25, 0.125};
  of_hits.blocker = {7, 8, 9, 1, 2, 3};
  of_hits.blocker_t = {.7f, .8f, .9f, .1f, .2f, .3f};
  const std::vector<uint32_t> places = {1, 4, 9};
  const ShadowOutputs outputs = {
      .bits = true, .counts = true, .weighted_sums = true, .blockers = true};
  ShadowResult all = NothingLit(10, 2, outputs);
  SpreadShadows(of_hits, places, 10, 2, outputs, &all);
  EXPECT_THAT(all.lit_bits, ElementsAre(0b00000010, 0b10, 0b00010000, 0));
  EXPECT_THAT(all.lit_counts, ElementsAre(0, 1, 0, 0, 1, 0, 0, 0, 0, 1));
  EXPECT_EQ(all.weighted_sums[9], 0.125);
  EXPECT_EQ(all.weighted_sums[0], 0.0);
  EXPECT_EQ(all.blocker[10 + 4], 2u);
  EXPECT_EQ(all.blocker[0], kNoTriangle);
  EXPECT_EQ(all.blocker_t[9], .9f);
  EXPECT_TRUE(std::isinf(all.blocker_t[10]));
  // Others come in any order, and leave alone what is there.
  ShadowResult rest;
  rest.lit_bits = {0b10, 0b01};
  SpreadShadows(rest, std::vector<uint32_t>{8, 0}, 10, 2, {.bits = true}, &all);
  EXPECT_THAT(all.lit_bits, ElementsAre(0b00000011, 0b10, 0b00010000, 0b1));
  // What stood in for a pixel has no place.
  ShadowResult one;
  one.lit_bits = {0b11, 0b01};
  one.lit_counts = {2, 1};
  SpreadShadows(one, std::vector<uint32_t>{kNoPixel, 7}, 10, 2, {.bits = true, .counts = true},
                &all);
  EXPECT_THAT(all.lit_bits, ElementsAre(0b10000011, 0b10, 0b00010000, 0b1));
  EXPECT_THAT(all.lit_counts, ElementsAre(0, 1, 0, 0, 1, 0, 0, 1, 0, 1));
  const ShadowResult none = NothingLit(10, 2, {.bits = true, .blockers = true});
  EXPECT_THAT(none.lit_bits, ElementsAre(0, 0, 0, 0));
  EXPECT_EQ(none.blocker.size(), 20u);
}

}  // namespace
}  // namespace sightline
