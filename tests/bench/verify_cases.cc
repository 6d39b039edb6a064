// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/verify_cases.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/accel/binary_bvh_builder.h"
#include "core/accel/bvh_builder.h"
#include "core/accel/kd_builder.h"
#include "core/accel/leaf_triangles.h"
#include "core/base/check.h"
#include "core/mesh/builtin/builtin.h"
#include "core/mesh/rebase.h"

namespace sightline::bench {
namespace {

constexpr double kFarAway = 1e6;
// In sizes of the scene: some thousand directions of floats span it there.
constexpr double kExtremeDistance = 0x1p13;
// The farthest coordinate of a scene that is scaled; lights and eyes stand farther still.
constexpr double kMostScaled = 0x1p36;

// 2^uniform, so that every order of magnitude is as likely.
double LogUniform(double low, double high, Random& random) {
  return std::exp2(random.Uniform(std::log2(low), std::log2(high)));
}

Vec3d Direction(Random& random) {
  while (true) {
    const Vec3d d{random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(-1, 1)};
    const double length = Length(d);
    if (length > 0.1 && length <= 1) return d * (1 / length);
  }
}

Vec3d Axis(Random& random) {
  Vec3d axis{0, 0, 0};
  axis[static_cast<int>(random.Below(3))] = random.Chance(0.5) ? 1 : -1;
  return axis;
}

// Corners with whole coordinates of a small cube: many meet, lie in one plane, repeat or have no
// area. One axis may be flattened, all may be shrunk.
ObjectInput LatticeSoup(uint64_t triangles, Random& random) {
  const uint64_t side = 2 + random.Below(15);
  Vec3d scale{1, 1, 1};
  if (random.Chance(0.3)) scale[static_cast<int>(random.Below(3))] = 0x1p-12;
  if (random.Chance(0.3)) scale = scale * 0x1p-10;
  ObjectInput soup;
  for (uint64_t i = 0; i < 3 * triangles; ++i) {
    Vec3d v;
    for (int axis = 0; axis < 3; ++axis) {
      v[axis] = static_cast<double>(random.Below(side)) * scale[axis];
    }
    soup.vertices.push_back(v);
    soup.indices.push_back(static_cast<uint32_t>(i));
  }
  soup.name = "soup";
  // One that can surely be hit.
  const uint32_t first = static_cast<uint32_t>(soup.vertices.size());
  for (const Vec3d v : {Vec3d{0, 0, 0}, Vec3d{scale.x, 0, 0}, Vec3d{0, scale.y, scale.z}}) {
    soup.vertices.push_back(v);
  }
  for (uint32_t k = 0; k < 3; ++k) soup.indices.push_back(first + k);
  return soup;
}

std::vector<ObjectInput> RandomObjects(uint64_t max_triangles, Random& random, std::string* name) {
  if (!random.Chance(0.25)) {
    const auto infos = BuiltinScenes();
    const BuiltinInfo& info = infos[random.Below(infos.size())];
    if (info.min_triangles <= max_triangles) {
      const uint64_t triangles = static_cast<uint64_t>(LogUniform(
          static_cast<double>(info.min_triangles), static_cast<double>(max_triangles), random));
      const BuiltinSpec spec{std::string(info.name),
                             std::clamp(triangles, info.min_triangles, max_triangles),
                             1 + random.Below(1000)};
      auto scene = MakeBuiltin(spec);
      SIGHTLINE_CHECK(scene.ok()) << scene.status();
      *name = absl::StrCat("builtin:", spec.name, ":", spec.target_triangles, ",seed=", spec.seed);
      return std::move(scene->objects);
    }
  }
  const uint64_t triangles = static_cast<uint64_t>(LogUniform(1, 4000, random));
  *name = absl::StrCat("soup:", triangles);
  return {LatticeSoup(triangles, random)};
}

// Makes all so many times as large or small that squares, or products of more, leave the floats'
// range: bounds of what rounding loses have to say what underflow does.
void Rescale(Random& random, std::vector<ObjectInput>* objects, std::string* name) {
  double most = 0;
  for (const ObjectInput& object : *objects) {
    for (const Vec3d v : object.vertices) most = std::max(most, MaxAbs(v));
  }
  if (!(most > 0)) return;
  const int largest = static_cast<int>(std::floor(std::log2(kMostScaled / most)));
  const int power = random.Chance(0.2) ? largest - static_cast<int>(random.Below(24))
                                       : -10 - static_cast<int>(random.Below(80));
  absl::StrAppend(name, " times 2^", power);
  for (ObjectInput& object : *objects) {
    for (Vec3d& v : object.vertices) v = v * std::ldexp(1, power);
  }
}

float MoveByUlps(float x, int ulps) {
  const float toward =
      ulps > 0 ? std::numeric_limits<float>::infinity() : -std::numeric_limits<float>::infinity();
  for (int i = 0; i < std::abs(ulps); ++i) x = std::nextafter(x, toward);
  return x;
}

void AddTrees(Random& random, ThreadPool& pool, IndexedGeometry* scene) {
  if (random.Chance(0.5)) {
    const KdBuildOptions options{
        .traversal_cost = static_cast<float>(LogUniform(0.1, 10, random)),
        .perfect_splits = random.Chance(0.4),
        .min_leaf_triangles = random.Chance(0.5) ? 1 : 1 + static_cast<int>(random.Below(16))};
    absl::StatusOr<KdTree> tree = BuildKdTree(scene->geometry, options, pool);
    SIGHTLINE_CHECK(tree.ok()) << tree.status();
    scene->kd_tree = *std::move(tree);
    if (random.Chance(0.5)) {
      const auto& ids = scene->kd_tree->ids;
      pool.ParallelFor(1, 1, [&](size_t, size_t) {
        scene->kd_leaves = MakeLeafTriangles(scene->geometry, {ids.data(), ids.size()});
      });
    }
  }
  if (random.Chance(0.5)) {
    const BinaryBvhOptions options{
        .bins = 2 + static_cast<int>(random.Below(15)),
        .cost_ratio = static_cast<float>(LogUniform(0.1, 10, random)),
        .min_triangles = random.Chance(0.5) ? 1 : 1 + static_cast<int>(random.Below(32))};
    absl::StatusOr<BinaryBvh> tree = BuildBinaryBvh(scene->geometry, options, pool);
    SIGHTLINE_CHECK(tree.ok()) << tree.status();
    scene->binary_bvh = *std::move(tree);
  }
}

}  // namespace

VerifyScene::VerifyScene(std::string its_name, IndexedGeometry all)
    : name(std::move(its_name)), indexed(std::move(all)), walk(indexed.geometry) {}

VerifyScene MakeRandomScene(uint64_t max_triangles, Random& random, ThreadPool& pool) {
  VerifyScene scene;
  do {
    scene = {};
    std::vector<ObjectInput> objects = RandomObjects(max_triangles, random, &scene.name);
    if (random.Chance(0.25)) Rescale(random, &objects, &scene.name);
    if (random.Chance(0.3)) {
      absl::StrAppend(&scene.name, " with masks and culling");
      for (ObjectInput& object : objects) {
        if (random.Chance(0.2)) object.mask = 1u << random.Below(3);
        if (random.Chance(0.3)) {
          object.culling = random.Chance(0.5) ? Culling::kBack : Culling::kFront;
        }
      }
    }
    std::optional<Vec3d> origin;
    if (random.Chance(0.15)) {
      absl::StrAppend(&scene.name, ", origin far off");
      // Up to where floats tell apart some hundred places along the scene: beyond, all is exact
      // arithmetic.
      Box3d box;
      for (const ObjectInput& object : objects) {
        for (const Vec3d v : object.vertices) box.Extend(v);
      }
      const double away = Length(box.Extent()) * LogUniform(1, 0x1p17, random);
      origin = objects.front().vertices.front() + Direction(random) * away;
    }
    absl::StatusOr<SceneGeometry> geometry = CompileScene(objects, origin, MeshLimits{});
    SIGHTLINE_CHECK(geometry.ok()) << geometry.status();
    scene.indexed.geometry = *std::move(geometry);
    const BvhBuildOptions options{
        .bins = 2 + static_cast<int>(random.Below(31)),
        .max_leaf_triangles = random.Chance(0.5) ? 16 : 1 + static_cast<int>(random.Below(16)),
        .traversal_cost = static_cast<float>(random.Uniform(0, 2)),
        .longest_axis_only = random.Chance(0.2),
        .full_leaves = random.Chance(0.5),
        .grid = random.Chance(0.4),
        .leaf_rows = random.Chance(0.75)};
    absl::StatusOr<Bvh> bvh = BuildBvh(scene.indexed.geometry, options, pool);
    SIGHTLINE_CHECK(bvh.ok()) << bvh.status();
    scene.indexed.bvh = *std::move(bvh);
  } while (scene.indexed.bvh.empty());  // Coarse coordinates can leave nothing of a small soup.
  AddTrees(random, pool, &scene.indexed);
  return VerifyScene(std::move(scene.name), std::move(scene.indexed));
}

const char* PlaceKindName(PlaceKind kind) {
  switch (kind) {
    case PlaceKind::kAnywhere:
      return "anywhere";
    case PlaceKind::kOnFace:
      return "on a face";
    case PlaceKind::kOnEdge:
      return "on an edge";
    case PlaceKind::kOnVertex:
      return "at a vertex";
    case PlaceKind::kGrazing:
      return "grazing";
    case PlaceKind::kAmidPoints:
      return "amid the points";
    case PlaceKind::kFar:
      return "far away";
  }
  return "";
}

uint32_t Placer::Triangle() {
  const SceneGeometry& geometry = scene_.geometry;
  while (true) {
    const uint32_t id = static_cast<uint32_t>(random_.Below(geometry.triangles.size()));
    if (!std::binary_search(geometry.inert.begin(), geometry.inert.end(), id)) return id;
  }
}

Vec3f Placer::Nudged(Vec3f p) {
  if (!random_.Chance(0.2)) return p;
  const int axis = static_cast<int>(random_.Below(3));
  p[axis] = MoveByUlps(p[axis], static_cast<int>(random_.Below(5)) - 2);
  return p;
}

Vec3f Placer::OnTriangle(uint32_t id) {
  const auto [a, b, c] = scene_.geometry.Corners(id);
  double u = random_.Uniform(0, 1), v = random_.Uniform(0, 1 - u);
  if (random_.Chance(0.3)) u = 0.25, v = 0.5;  // Exact where the corners are whole numbers.
  return Nudged(ToFloat(ToDouble(a) * (1 - u - v) + ToDouble(b) * u + ToDouble(c) * v));
}

Place Placer::Make(PlaceKind kind) {
  Place place{.kind = kind};
  const Vec3d lo = ToDouble(scene_.geometry.bounds.lo), hi = ToDouble(scene_.geometry.bounds.hi);
  const uint32_t id = Triangle();
  const auto [a, b, c] = scene_.geometry.Corners(id);
  switch (kind) {
    case PlaceKind::kAnywhere:
      for (int axis = 0; axis < 3; ++axis) {
        const double pad = 0.25 * (hi[axis] - lo[axis]);
        place.at[axis] = static_cast<float>(random_.Uniform(lo[axis] - pad, hi[axis] + pad));
      }
      return place;
    case PlaceKind::kOnFace:
      place.at = OnTriangle(id);
      place.triangle = id;
      return place;
    case PlaceKind::kOnEdge: {
      const double s = random_.Chance(0.5) ? 0.5 : random_.Uniform(0, 1);
      place.at = Nudged(ToFloat(ToDouble(a) * (1 - s) + ToDouble(b) * s));
      place.triangle = id;
      return place;
    }
    case PlaceKind::kOnVertex:
      place.at = a;
      place.triangle = id;
      return place;
    case PlaceKind::kGrazing: {
      const double reach = LogUniform(1, 1024, random_);
      const double u = std::round(random_.Uniform(-2, 2) * reach * 4) / 4;
      const double v = std::round(random_.Uniform(-2, 2) * reach * 4) / 4;
      const Vec3d corner = ToDouble(a);
      place.at = Nudged(ToFloat(corner + (ToDouble(b) - corner) * u + (ToDouble(c) - corner) * v));
      place.triangle = id;
      return place;
    }
    case PlaceKind::kAmidPoints:
      place.at = ToFloat((ToDouble(OnTriangle(id)) + ToDouble(OnTriangle(Triangle()))) * 0.5);
      return place;
    case PlaceKind::kFar: {
      const double size = Length(hi - lo);
      const double away = random_.Chance(0.3) || 2 * size > kFarAway
                              ? kFarAway
                              : LogUniform(2 * size, kFarAway, random_);
      place.at = ToFloat((lo + hi) * 0.5 +
                         (random_.Chance(0.2) ? Axis(random_) : Direction(random_)) * away);
      place.extreme = away > size * kExtremeDistance;
      return place;
    }
  }
  return place;
}

CameraCase MakeCamera(const IndexedGeometry& scene, Placer& placer, Random& random) {
  const Vec3d origin = scene.geometry.origin;
  while (true) {
    CameraCase result;
    const Place eye = placer.Anything();
    result.eye = eye.kind;
    Vec3d from = origin + ToDouble(eye.at);
    // A camera that grazes looks along the plane.
    const uint32_t target =
        eye.kind == PlaceKind::kGrazing && random.Chance(0.8) ? eye.triangle : placer.Triangle();
    Vec3d at = origin + ToDouble(placer.OnTriangle(target));
    if (random.Chance(0.2)) at = from + Axis(random);
    double fov = random.Uniform(1, 120);
    if (eye.kind == PlaceKind::kFar) {
      const double size = Length(ToDouble(scene.geometry.bounds.Extent()));
      const double away = Length(ToDouble(eye.at - scene.geometry.bounds.lo));
      const double whole = std::atan(size / away) * (180 / std::numbers::pi);
      fov = std::clamp(whole * random.Uniform(0.1, 1.5), 3e-4, 90.0);
    }
    const uint32_t width = static_cast<uint32_t>(LogUniform(8, 16384, random));
    const uint32_t height = static_cast<uint32_t>(LogUniform(8, 16384, random));
    const Vec3d up = random.Chance(0.5) ? Axis(random) : Direction(random);
    const absl::StatusOr<Camera> camera = LookAt(from, at, up, fov, width, height);
    // Eye at target, up along the view, coordinates out of range: another one.
    if (!camera.ok()) continue;
    result.camera = *camera;
    TileRect& tile = result.tile;
    const bool small = random.Chance(0.3);
    const uint32_t largest = eye.extreme ? 8 : random.Chance(0.15) ? 256 : 64;
    const auto side = [&] {
      return small ? 1 + static_cast<uint32_t>(random.Below(largest)) : largest;
    };
    tile.width = std::min(width, side());
    tile.height = std::min(height, side());
    // Mostly where the camera looks at something.
    const bool middle = random.Chance(0.7);
    tile.x = static_cast<uint32_t>(middle ? (width - tile.width) / 2
                                          : random.Below(width - tile.width + 1));
    tile.y = static_cast<uint32_t>(middle ? (height - tile.height) / 2
                                          : random.Below(height - tile.height + 1));
    return result;
  }
}

PreparedPoints MakeVerifyPoints(const IndexedGeometry& scene, Placer& placer, Random& random) {
  const uint64_t triangles = scene.geometry.triangles.size();
  // Points a million units away among the others make fat shafts.
  const bool outliers = random.Chance(0.5);
  const size_t count = static_cast<size_t>(LogUniform(1, 1500, random));
  const uint64_t first = placer.Triangle(), neighbours = 1 + random.Below(64);
  PreparedPoints points;
  for (size_t i = 0; i < count; ++i) {
    const bool valid = !random.Chance(0.02);
    const uint32_t id = static_cast<uint32_t>((first + random.Below(neighbours)) % triangles);
    const Vec3f on_surface = placer.OnTriangle(id);
    Place place{.kind = PlaceKind::kOnFace, .at = on_surface, .triangle = id};
    if (!IsFinite(on_surface) || random.Chance(0.1)) {
      do {
        place = placer.Anything();
      } while (place.extreme && !outliers);
    }
    points.positions.push_back(valid ? place.at : Vec3f{});
    points.sources.push_back(random.Chance(0.5) ? place.triangle : kNoTriangle);
    points.valid.push_back(valid);
    points.invalid += !valid;
  }
  if (random.Chance(0.2)) points.sources.clear();
  return points;
}

LightCase MakeVerifyLights(const IndexedGeometry& scene, const PreparedPoints& points,
                           Placer& placer, Random& random) {
  LightCase result;
  const uint32_t kind = static_cast<uint32_t>(random.Below(3));
  if (kind == 0) {  // A rectangle.
    const Place place = placer.Anything();
    const double size =
        Length(ToDouble(scene.geometry.bounds.Extent())) * LogUniform(0x1p-16, 1, random);
    const Light light{.kind = Light::Kind::kRectangle,
                      .position = scene.geometry.origin + ToDouble(place.at),
                      .half_u = Direction(random) * size,
                      .half_v = Direction(random) * size,
                      .sample_count = 1 + static_cast<uint32_t>(random.Below(16))};
    const absl::Status status = AppendSamples(light, 0, scene.geometry.origin, &result.samples);
    SIGHTLINE_CHECK(status.ok()) << status;
    result.kind = place.kind;
    result.extreme = place.extreme;
    return result;
  }
  result.directional = kind == 1;
  // So many that what is found once for all of them is looked for (core/query/group_grounds.h).
  const bool many = random.Chance(0.2);
  const uint32_t lights = static_cast<uint32_t>(many ? 32 + random.Below(33) : 1 + random.Below(3));
  for (uint32_t i = 0; i < lights; ++i) {
    LightSample sample{.directional = result.directional, .light = i};
    if (result.directional) {
      const auto [a, b, c] = scene.geometry.Corners(placer.Triangle());
      const uint64_t manner = random.Below(4);
      sample.value = manner == 0   ? ToFloat(Axis(random))
                     : manner == 1 ? b - a  // Along an edge, in a plane.
                     : manner == 2 ? (b - a) + (c - a)
                                   : ToFloat(Direction(random));
      sample.valid = MaxAbs(sample.value) >= 0x1p-20f && MaxAbs(sample.value) <= 0x1p20f;
      if (manner == 1 || manner == 2) result.kind = PlaceKind::kGrazing;
    } else {
      Place place = placer.Anything();
      while (many && place.extreme) place = placer.Anything();
      sample.value = place.at;
      result.extreme = result.extreme || place.extreme;
      if (random.Chance(0.5)) sample.source_triangle = place.triangle;
      if (i == 0) result.kind = place.kind;
      // Right at one of the points.
      const size_t p = random.Below(points.size());
      if (random.Chance(0.05) && points.valid[p]) sample.value = points.positions[p];
    }
    if (random.Chance(0.1)) sample.mask = 1u << random.Below(3);
    result.samples.push_back(sample);
  }
  return result;
}

std::vector<Mirror> MakeVerifyMirrors(const IndexedGeometry& scene, const Camera& camera,
                                      Placer& placer, Random& random) {
  constexpr double kMirrors = 0.15;
  if (!random.Chance(kMirrors)) return {};
  const uint32_t id = placer.Triangle();
  const auto [a, b, c] = scene.geometry.Corners(id);
  const Vec3d across = Cross(ToDouble(b - a), ToDouble(c - a));
  const double length = Length(across);
  const Vec3d normal = length > 0 && random.Chance(0.7) ? across * (1 / length) : Direction(random);
  const std::vector<Mirror> mirrors = {
      {.object = scene.geometry.ObjectOf(id),
       .plane = MirrorPlane{scene.geometry.origin + ToDouble(placer.OnTriangle(id)), normal}}};
  Vec3f eye;
  if (!Rebase(camera.eye, scene.geometry.origin, &eye)) return {};
  return PreparedMirrors::Prepare(scene.geometry, mirrors, eye).ok() ? mirrors
                                                                     : std::vector<Mirror>{};
}

PreparedSegments MakeVerifySegments(Placer& placer, Random& random) {
  PreparedSegments segments;
  const size_t count = static_cast<size_t>(LogUniform(1, 2000, random));
  size_t extreme = 0;
  for (size_t i = 0; i < count; ++i) {
    const Place from = placer.Anything(), to = placer.Anything();
    if ((from.extreme || to.extreme) && ++extreme > kExtremeRays) continue;
    Vec3f end = to.at;
    // Through it, or axis-parallel.
    if (random.Chance(0.2)) end = from.at + (end - from.at) * 2.0f;
    const int axis = static_cast<int>(random.Below(3));
    if (random.Chance(0.1)) end[axis] = from.at[axis];
    segments.from.push_back(from.at);
    segments.to.push_back(end);
    segments.from_source.push_back(random.Chance(0.3) ? from.triangle : kNoTriangle);
    segments.to_source.push_back(random.Chance(0.3) ? to.triangle : kNoTriangle);
    segments.valid.push_back(1);
  }
  return segments;
}

}  // namespace sightline::bench
