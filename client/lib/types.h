// SPDX-License-Identifier: Apache-2.0
//
// What the client library takes and gives: plain structs of numbers, strings and arrays. No proto
// and no gRPC type is needed to use it. Units, ranges and meanings are those of proto/sightline/v1.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CLIENT_LIB_TYPES_H_
#define SIGHTLINE_CLIENT_LIB_TYPES_H_

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/time/time.h"

namespace sightline::client {

// x, y, z in world coordinates and scene units.
using Point3 = std::array<double, 3>;

inline constexpr uint32_t kNone = 0xFFFFFFFFu;  // No object, no triangle.

enum class Strategy { kAuto, kSingle, kPacket, kBruteForce, kShaft, kRtt };
enum class Structure { kAuto, kBvh, kKdTree, kBinaryBvh };
// What answered a ray: AnsweredBy of query_options.proto, which says more.
enum class AnsweredBy : uint8_t { kNoRay = 0, kShaft = 1, kTriangles = 2, kPacket = 3, kRay = 4 };
enum class Culling { kNone, kBack, kFront };
enum class BuildPreset { kStatic, kDynamic, kCompact };
enum class SceneState { kUnknown, kBuilding, kReady, kUpdating, kFailed, kDeleted, kUnloaded };

// ---- Scenes -------------------------------------------------------------------------------------

// One object of an upload. The arrays are the caller's and must outlive the call.
struct ObjectUpload {
  std::string name;
  std::span<const double> vertices;                 // [k, 3]
  std::span<const uint32_t> indices;                // [m, 3]
  std::optional<std::array<double, 12>> transform;  // Rows of a 3×4 matrix; unset: the identity.
  uint32_t mask = 0xFFFFFFFFu;
  Culling culling = Culling::kNone;
  bool dynamic = false;  // Its transform may be changed later.
};

// A kd-tree beside the BVH: KdTreeOptions of scene_service.proto, which says more. 0: the server's
// own choice.
struct KdTreeOptions {
  double traversal_cost = 0;  // 0.01 to 10.
  bool perfect_splits = false;
  uint32_t min_leaf_triangles = 0;
  uint32_t max_leaf_triangles = 0;
  uint32_t max_depth = 0;
  double max_references = 0;  // 1 to 64.
  bool lay_out_leaves = false;
};

// A binary BVH beside the BVH: BinaryBvhOptions of scene_service.proto, which says more. 0: the
// server's own choice.
struct BinaryBvhOptions {
  uint32_t bins = 0;      // 2 to 1024.
  double cost_ratio = 0;  // 0.001 to 1000.
  uint32_t min_triangles = 0;
  uint32_t max_depth = 0;
  bool ignore_cost = false;
  std::optional<double> min_extent;
};

// What a new scene is made of: objects, a built-in spec ("builtin:hall:1000000"), or a file of the
// server's repository; one of them.
struct SceneSource {
  std::string scene_id;  // Empty: the server makes one up.
  std::vector<ObjectUpload> objects;
  std::string builtin;
  std::string file_id;     // Its name without ".slscene"; with origin and build of its own.
  bool temporary = false;  // Not stored in the repository.
  std::optional<Point3> origin;
  BuildPreset build_preset = BuildPreset::kStatic;  // Costs and memory; the answers are the same.
  std::optional<KdTreeOptions> kd_tree;             // Unset: none is built.
  std::optional<BinaryBvhOptions> binary_bvh;       // Likewise.
  bool without_bvh = false;                         // The kd-tree alone, which must be set then.
};

struct BuildReport {
  uint64_t input_triangles = 0;
  uint64_t non_finite_triangles = 0;  // These and the zero-area ones are never hit.
  uint64_t zero_area_triangles = 0;
  uint64_t duplicate_triangles = 0;  // Kept.
  uint64_t non_finite_vertices = 0;
  double max_rounding = 0;        // Scene units.
  absl::Duration compile_time;    // To check, place and store the triangles.
  absl::Duration structure_time;  // To build the tree.
  uint64_t nodes = 0, leaves = 0;
  uint32_t depth = 0;
  bool refitted = false;  // The tree of the revision before, fitted to vertices that moved.
  uint64_t resident_bytes = 0;
  // Of the kd-tree; all 0 without one.
  uint64_t kd_tree_nodes = 0, kd_tree_leaves = 0, kd_tree_references = 0, kd_tree_bytes = 0;
  uint32_t kd_tree_depth = 0;
  absl::Duration kd_tree_time;  // Part of structure_time.
  // All 0 without a binary BVH.
  uint64_t binary_bvh_nodes = 0, binary_bvh_leaves = 0, binary_bvh_bytes = 0;
  uint32_t binary_bvh_depth = 0;
  absl::Duration binary_bvh_time;  // Part of structure_time.
};

struct Scene {
  std::string name;  // "scenes/hall"
  int64_t revision = 0;
  Point3 origin{};
  uint32_t objects = 0;
  uint64_t triangles = 0;  // As uploaded.
  uint64_t vertices = 0;
  std::optional<std::array<Point3, 2>> bounds;  // Smallest and largest corner.
  BuildReport report;
  SceneState state = SceneState::kUnknown;
  std::string state_message;
  bool stored = false;  // The repository has a file of this revision.
  std::string builtin;  // The built-in scene that this revision is, in full; empty: none.
  absl::Time create_time = absl::InfinitePast();
  absl::Time update_time = absl::InfinitePast();
};

// A scene file of the server's repository.
struct StoredScene {
  std::string name;  // "scenes/hall"
  uint64_t file_bytes = 0;
  absl::Time modify_time = absl::InfinitePast();
  SceneState state = SceneState::kUnknown;
  std::string state_message;
  int64_t revision = 0;  // That is served; 0: not loaded.
};

struct SceneObject {
  uint32_t index = 0;
  std::string name;
  uint64_t triangles = 0;
  uint64_t vertices = 0;
  uint32_t mask = 0;
  Culling culling = Culling::kNone;
  bool dynamic = false;
};

// One step of an edit; steps apply in order, all or none.
struct SceneEdit {
  enum class Kind { kAdd, kRemove, kSetTransform, kReplaceVertices };
  Kind kind = Kind::kAdd;
  // kAdd: all of it. Others: its name, and its transform or its vertices.
  ObjectUpload object;
};

struct SceneProgress {
  Scene scene;
  std::string stage;
  double progress = 0;  // 0 to 1.
};

// ---- Queries ------------------------------------------------------------------------------------

struct Camera {
  Point3 eye{}, right{}, up{}, forward{};
  double tan_half_fov_y = 0;
  uint32_t width = 0, height = 0;
};

struct Light {
  enum class Kind { kPoint, kDirectional, kRectangle };
  Kind kind = Kind::kPoint;
  Point3 position{};   // kPoint; kRectangle: its centre.
  Point3 direction{};  // kDirectional: from the lit point toward the light.
  Point3 half_u{}, half_v{};
  uint32_t samples = 1;  // kRectangle.
  uint32_t mask = 0xFFFFFFFFu;
  double weight = 1;

  static Light Point(Point3 p) { return {.kind = Kind::kPoint, .position = p}; }
  static Light Directional(Point3 d) { return {.kind = Kind::kDirectional, .direction = d}; }
  uint32_t SampleCount() const { return kind == Kind::kRectangle ? samples : 1; }
};

// The work done for an item, or for many.
struct Statistics {
  uint64_t rays = 0;
  uint64_t nodes = 0;
  uint64_t leaves = 0;
  uint64_t triangle_tests = 0;
  uint64_t double_tests = 0;            // Left in doubt by the float filter,
  uint64_t exact_tests = 0;             // and by the double filter.
  Strategy strategy = Strategy::kAuto;  // What answered; kAuto where several did.
  // RTT: tiles, those answered without rays, and the triangles on their lists.
  uint64_t tiles = 0, tiles_answered = 0, relevant_triangles = 0;
  uint64_t culled_tests = 0;  // Within leaves, by leaf_culling.
  // SHAFT: triangles of its leaves, those relevant to it, pairs of one and a block of 16 rays,
  // those of a block that is covered; sets of rays parted, and rays left to walk by themselves.
  uint64_t shaft_triangles = 0, shaft_relevant = 0, shaft_pairs = 0, shaft_covers = 0;
  uint64_t shaft_splits = 0, shaft_singles = 0;
  // Rays by what answered them: whole shafts, a shaft's relevant triangles, packets, themselves.
  uint64_t answered_by_shaft = 0, answered_by_triangles = 0;
  uint64_t answered_by_packet = 0, answered_by_ray = 0;
  absl::Duration compute;  // Summed over threads.
  absl::Duration queue;

  void Add(const Statistics& other) {
    const bool first = rays == 0 && nodes == 0 && triangle_tests == 0;
    strategy = first || strategy == other.strategy ? other.strategy : Strategy::kAuto;
    rays += other.rays;
    nodes += other.nodes;
    leaves += other.leaves;
    triangle_tests += other.triangle_tests;
    double_tests += other.double_tests;
    exact_tests += other.exact_tests;
    tiles += other.tiles;
    tiles_answered += other.tiles_answered;
    relevant_triangles += other.relevant_triangles;
    culled_tests += other.culled_tests;
    shaft_triangles += other.shaft_triangles;
    shaft_relevant += other.shaft_relevant;
    shaft_pairs += other.shaft_pairs;
    shaft_covers += other.shaft_covers;
    shaft_splits += other.shaft_splits;
    shaft_singles += other.shaft_singles;
    answered_by_shaft += other.answered_by_shaft;
    answered_by_triangles += other.answered_by_triangles;
    answered_by_packet += other.answered_by_packet;
    answered_by_ray += other.answered_by_ray;
    compute += other.compute;
    queue += other.queue;
  }
};

// The test that decides; those of query_options.proto.
enum class Intersector {
  kExact = 1,
  kHavelHerout,
  kHavelHeroutDivided,
  kWald,
  kShevtsov,
  kKenslerShirley,
  kMoellerTrumbore,
  kHavelHeroutDotProduct
};

enum class FrustumRays { kAll, kRows, kMasked };
enum class NodeTest { kFirstActive, kCorners, kAllRays };
// What single rays and packets leave out within leaves: LeafCulling of query_options.proto, which
// says more. As made, nothing. Suns and segments are single rays under PACKET, too.
struct LeafCulling {
  bool side_planes = false, near_far_planes = false, aperture = false, aperture_first = false;
  bool skip_edges = false, first_axis = false, ray_mask = false, split_to_rays = false;
  FrustumRays frustum_rays = FrustumRays::kAll;
  bool ray_box = false, ray_box_fixed = false, mailbox = false, cell_boxes = false;
  uint32_t ray_box_min_triangles = 0;  // 0: the server's own choice.
  NodeTest node_test = NodeTest::kFirstActive;
};

struct QueryOptions {
  int64_t revision = 0;  // 0: the one that is current when the query starts, for all of it.
  Strategy strategy = Strategy::kAuto;
  uint32_t mask = 0xFFFFFFFFu;
  bool statistics = false;
  Structure structure = Structure::kAuto;  // Speed alone; an error where the scene has no kd-tree.
  uint32_t rtt_antialiasing = 1;           // Rays a pixel, in either direction: 1 to 6.
  bool rtt_shared_edges = false;
  uint32_t rtt_side_by_side = 0;            // Tiles in one register, 1 to 4; 0: as many as fit.
  std::optional<LeafCulling> leaf_culling;  // SINGLE and PACKET alone.
  // Another than kExact with SINGLE, PACKET and BRUTE_FORCE alone (kHavelHeroutDotProduct not with
  // PACKET); answers are that test's then.
  Intersector intersector = Intersector::kExact;
  uint32_t packet_side = 0;  // PACKET: 2, 4, 8 or 16; 0: the server's own choice.
  // PACKET, tiles' shadows: packets of the pixels' own squares, misses moved to the first hit.
  bool pixel_shadow_packets = false;
};

// What became of a streamed query as a whole.
struct StreamSummary {
  int64_t revision = 0;
  uint64_t items = 0;
  uint64_t rays = 0;            // Asked for; the statistics count those traced.
  uint64_t bytes_received = 0;  // Of replies, before transport.
  uint64_t bytes_sent = 0;
  uint64_t resent_items = 0;  // Sent again after a failure.
  absl::Duration elapsed;
  Statistics statistics;
};

// ---- Tiles

struct TileRect {
  uint32_t x = 0, y = 0, width = 0, height = 0;
};

struct TileOutputs {
  bool hits = false;
  bool ids = false;
  bool depths = false;
  bool barycentrics = false;
  bool lit = false;              // Of every light sample at every hit.
  bool answered_by = false;      // What answered each pixel's ray...
  bool lit_answered_by = false;  // ... and, if `lit`, each light sample's at its hit.
  bool mirrors = false;          // Which pixels look into a mirror.
};

// What is seen in an object's surface; without a plane, that of its largest triangle.
struct Mirror {
  struct Plane {
    Point3 point, normal;
  };
  std::string object;
  std::optional<Plane> plane;
};

struct TileQuery {
  std::string scene;
  Camera camera;
  std::vector<Light> lights;
  std::vector<Mirror> mirrors;  // At most 64.
  TileOutputs outputs;
  QueryOptions options;
  uint32_t tile_size = 64;  // Pixels; tiles at the right and lower border are smaller.
};

// The answer for one tile; n = width · height pixels, row by row. Only what was asked for is
// filled.
struct Tile {
  size_t index = 0;  // In row-major order of the image's tiles.
  TileRect rect;
  std::vector<uint8_t> hit;                // n: 1 or 0.
  std::vector<uint32_t> object, triangle;  // n: kNone for a miss.
  std::vector<float> depth;                // n: +infinity for a miss.
  std::vector<float> u, v;                 // n.
  std::vector<uint8_t> lit;                // [S, n]: 1 lit, 0 blocked, 255 no hit or not valid.
  std::vector<uint8_t> answered_by;        // n: an AnsweredBy.
  std::vector<uint8_t> lit_answered_by;    // [S, n]
  std::vector<uint8_t> mirror;             // n: 1 where it is seen in a mirror.
  Statistics statistics;
};

// A whole picture; n = width · height.
struct TileImage {
  uint32_t width = 0, height = 0, samples = 0;
  std::vector<uint8_t> hit;
  std::vector<uint32_t> object, triangle;
  std::vector<float> depth, u, v;
  std::vector<uint8_t> lit;              // [S, n]
  std::vector<uint8_t> answered_by;      // n
  std::vector<uint8_t> lit_answered_by;  // [S, n]
  std::vector<uint8_t> mirror;           // n
  struct TileCost {
    TileRect rect;
    Statistics statistics;
  };
  std::vector<TileCost> costs;  // In row-major order of the tiles; with statistics.
  StreamSummary summary;
};

// ---- Shadows

// Points and what is known of the surface under them. The arrays are the caller's.
struct Points {
  std::span<const double> positions;           // [n, 3]
  std::span<const uint32_t> source_objects;    // Empty or [n].
  std::span<const uint32_t> source_triangles;  // Empty or [n].
  std::span<const double> normals;             // Empty or [n, 3].
};

struct PointOptions {
  double attach_distance = 0;
  double normal_offset = 0;
};

struct ShadowOutputs {
  bool lit = true;
  bool counts = false;
  bool weighted_sums = false;
  bool blockers = false;
  bool answered_by = false;
};

struct ShadowQuery {
  std::string scene;
  std::vector<Light> lights;
  Points points;          // Or:
  std::string point_set;  // "scenes/hall/pointSets/desk", all of it.
  PointOptions point_options;
  double t_min = 0;  // Segments end this share of their length before the point.
  ShadowOutputs outputs;
  QueryOptions options;
  uint32_t points_per_item = 16384;
};

// The answer for points offset .. offset + n - 1, or for all (offset 0).
struct Shadows {
  uint64_t offset = 0;
  uint64_t points = 0;
  uint32_t samples = 0;
  std::vector<uint8_t> lit;               // [S, n]: 1 lit, 0 blocked, 255 not valid.
  std::vector<uint8_t> valid;             // n: 1 or 0; the points alone.
  std::vector<uint32_t> invalid_samples;  // Of lights that are not finite or out of range.
  std::vector<uint32_t> counts;           // n
  std::vector<double> weighted_sums;      // n
  std::vector<uint32_t> blocker_object, blocker_triangle;  // [S, n]
  std::vector<float> blocker_distance;                     // [S, n]
  std::vector<uint8_t> answered_by;                        // [S, n]: an AnsweredBy.
  uint64_t near_surface_points = 0;
  Statistics statistics;
  StreamSummary summary;  // Of the whole query, in the array of all alone.
};

// ---- Segments

struct SegmentQuery {
  std::string scene;
  std::span<const double> segments;  // [n, 6]: from, to.
  // Instead of them, what the scene stores of them (stored_segments.h): [n, 6], relative to
  // `origin`, which is required then.
  std::span<const float> stored_segments;
  // The scene's (Scene::origin), if it is known: segments then travel as the scene stores them, in
  // half the bytes, and get the same answers; FAILED_PRECONDITION (ORIGIN_MISMATCH) if it is not
  // the scene's. Unset: read from the server, where the query names no revision.
  std::optional<Point3> origin;
  bool blocked = true;
  bool blockers = false;
  QueryOptions options;
  uint32_t segments_per_item = 65536;
};

struct Segments {
  uint64_t offset = 0;
  uint64_t segments = 0;
  std::vector<uint8_t> blocked;  // n: 1 blocked, 0 free, 255 not valid.
  std::vector<uint8_t> valid;    // n: 1 or 0.
  std::vector<uint32_t> blocker_object, blocker_triangle;
  std::vector<float> blocker_distance;
  Statistics statistics;
  StreamSummary summary;
};

// ---- Point sets

struct PointSetSource {
  std::string scene;         // "scenes/hall"
  std::string point_set_id;  // Empty: the server makes one up.
  int64_t revision = 0;
  absl::Duration lease = absl::Minutes(10);
  PointOptions point_options;
  Points points;  // Or:
  // What it sees becomes the points, row by row of its picture: packets of them are runs of its
  // rows, or neighbours in space where these pay, whatever packet_side says, and not squares of
  // pixels.
  std::optional<Camera> camera;
  QueryOptions options;  // For the camera's rays.
};

struct PointSet {
  std::string name;
  int64_t revision = 0;
  uint64_t points = 0;
  uint64_t invalid_points = 0;
  uint64_t attached_points = 0;
  uint64_t near_surface_points = 0;
  absl::Time create_time = absl::InfinitePast();
  absl::Time expire_time = absl::InfinitePast();
  uint64_t resident_bytes = 0;
};

// ---- Server

struct Limits {
  uint64_t max_message_bytes = 0, target_reply_bytes = 0;
  uint32_t max_concurrent_streams = 0;
  int64_t stream_credit_rays = 0, min_item_cost_rays = 0, max_item_rays = 0, max_queued_rays = 0;
  uint32_t max_lights = 0, max_samples_per_light = 0, max_light_samples = 0;
  uint32_t max_image_width = 0, max_image_height = 0;
  uint32_t max_scenes = 0, max_objects_per_scene = 0;
  uint64_t max_triangles_per_scene = 0, max_vertices_per_scene = 0, max_scene_bytes = 0;
  uint64_t max_points_per_set = 0;
  uint32_t max_point_sets = 0;
  uint64_t max_point_set_bytes = 0;
  absl::Duration max_lease, max_pin_duration;
  double max_coordinate = 0;
  uint32_t max_concurrent_uploads = 0;
  int64_t max_queued_rays_per_client = 0;
  uint64_t max_bytes_per_scene = 0;
  uint32_t max_connections = 0, max_connections_per_address = 0;
  uint32_t max_concurrent_uploads_per_client = 0, max_streams_per_client = 0;
  absl::Duration max_upload_idle, max_stream_stall;
};

struct Capabilities {
  std::string version;
  Limits limits;
  std::string instruction_set;
  std::vector<std::string> available_instruction_sets;
  std::vector<std::string> strategies;  // "AUTO", "SINGLE", ...
  std::vector<std::string> builtin_scenes;
  uint32_t threads = 0;
  bool stored_segments = false;  // It reads segments in their stored form.
};

enum class Health { kUnknown, kServing, kNotServing, kServiceUnknown };

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_TYPES_H_
