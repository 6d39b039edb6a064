// SPDX-License-Identifier: Apache-2.0
#include "tests/core/traverse/nasty_scenes.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/accel/bvh_builder.h"
#include "core/base/parallel.h"
#include "core/mesh/scene_geometry.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/triangle_cases.h"

namespace sightline::testing_support {
namespace {

Vec3d RandomPoint(TestRng& rng, double scale) {
  const double x = rng.Uniform(-scale, scale), y = rng.Uniform(-scale, scale);
  return {x, y, rng.Uniform(-scale, scale)};
}

void AddTriangle(ObjectInput& object, Vec3d a, Vec3d b, Vec3d c) {
  for (const Vec3d& v : {a, b, c}) {
    object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
    object.vertices.push_back(v);
  }
}

ObjectInput Soup(TestRng& rng, int count, double scene, double size) {
  ObjectInput object;
  for (int i = 0; i < count; ++i) {
    const Vec3d at = RandomPoint(rng, scene);
    AddTriangle(object, at + RandomPoint(rng, size), at + RandomPoint(rng, size),
                at + RandomPoint(rng, size));
  }
  return object;
}

ObjectInput Slivers(TestRng& rng) {
  ObjectInput object;
  for (int i = 0; i < 300; ++i) {
    const Vec3d a = RandomPoint(rng, 5), b = RandomPoint(rng, 5);
    const double w = rng.Uniform(-0.2, 1.2);
    const double width = std::ldexp(1.0, -static_cast<int>(rng.Below(30)));
    AddTriangle(object, a, b, a * (1 - w) + b * w + RandomPoint(rng, width));
  }
  return object;
}

// Walls of integer quads in few planes, each face up to three times, in both senses.
ObjectInput CoplanarAndDuplicate(TestRng& rng) {
  ObjectInput object;
  for (int i = 0; i < 150; ++i) {
    const int axis = static_cast<int>(rng.Below(3));
    const auto corner = [&](double s, double t) {
      Vec3d p;
      p[axis] = static_cast<double>(i % 3);
      p[(axis + 1) % 3] = s;
      p[(axis + 2) % 3] = t;
      return p;
    };
    const double s = static_cast<double>(rng.Below(4)), t = static_cast<double>(rng.Below(4));
    const double w = 1 + static_cast<double>(rng.Below(3)),
                 h = 1 + static_cast<double>(rng.Below(3));
    for (uint64_t copies = 1 + rng.Below(3); copies > 0; --copies) {
      if (rng.Chance(0.5)) {
        AddTriangle(object, corner(s, t), corner(s + w, t), corner(s, t + h));
      } else {
        AddTriangle(object, corner(s + w, t), corner(s, t), corner(s, t + h));
      }
      AddTriangle(object, corner(s + w, t), corner(s + w, t + h), corner(s, t + h));
    }
  }
  return object;
}

ObjectInput Lattice(TestRng& rng, int count, int range, double unit) {
  ObjectInput object;
  const auto point = [&] {
    Vec3d p;
    for (int k = 0; k < 3; ++k) {
      p[k] = (static_cast<double>(rng.Below(2 * range + 1)) - range) * unit;
    }
    return p;
  };
  for (int i = 0; i < count; ++i) AddTriangle(object, point(), point(), point());
  return object;
}

// Coordinates of any magnitude: edges that doubles cannot hold, normals that come out of
// cancellation.
ObjectInput MixedExponents(TestRng& rng, int count, int least, int most) {
  ObjectInput object;
  const auto point = [&] {
    Vec3d p;
    for (int k = 0; k < 3; ++k) {
      const int exponent = least + static_cast<int>(rng.Below(static_cast<uint64_t>(most - least)));
      p[k] = std::ldexp(rng.Uniform(-1, 1), exponent);
    }
    return p;
  };
  for (int i = 0; i < count; ++i) {
    const Vec3d a = point(), b = point();
    const double w = rng.Uniform(-1, 2);
    AddTriangle(object, a, b, rng.Chance(0.5) ? point() : a * (1 - w) + b * w);
  }
  return object;
}

ObjectInput Identical(int count) {
  ObjectInput object;
  object.vertices = {{0.25, 0.5, 1}, {3.7, 0.1, 1.3}, {0.4, 2.9, 0.8}};
  for (int i = 0; i < count; ++i) object.indices.insert(object.indices.end(), {0, 1, 2});
  return object;
}

ObjectInput ZeroAreasAndNonFinite(TestRng& rng) {
  ObjectInput object = Soup(rng, 100, 3, 1);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int i = 0; i < 100; ++i) {
    const Vec3d a = RandomPoint(rng, 3), b = RandomPoint(rng, 3);
    switch (rng.Below(4)) {
      case 0:
        AddTriangle(object, a, a, b);
        break;
      case 1:
        AddTriangle(object, a, a, a);
        break;
      case 2:
        AddTriangle(object, {1, 1, 1}, {2, 2, 2}, {4, 4, 4});
        break;
      default:
        AddTriangle(object, a, b, {nan, 0, 0});
        break;
    }
  }
  return object;
}

// Objects of every culling and several masks, overlapping.
std::vector<ObjectInput> MaskedAndCulled(TestRng& rng) {
  std::vector<ObjectInput> objects;
  constexpr Culling kCullings[] = {Culling::kNone, Culling::kBack, Culling::kFront};
  constexpr uint32_t kMasks[] = {0xFFFFFFFFu, 1u, 2u, 0x80000000u, 0u};
  for (const Culling culling : kCullings) {
    for (const uint32_t mask : kMasks) {
      ObjectInput object = rng.Chance(0.5) ? Soup(rng, 20, 2, 1) : Lattice(rng, 20, 2, 1);
      object.culling = culling;
      object.mask = mask;
      objects.push_back(std::move(object));
    }
  }
  objects.push_back(ObjectInput{});  // One without triangles.
  objects.back().culling = Culling::kBack;
  return objects;
}

}  // namespace

ObjectInput MakeGrid(int cells, double height, Vec3d corner, TestRng& rng) {
  ObjectInput object;
  for (int j = 0; j <= cells; ++j) {
    for (int i = 0; i <= cells; ++i) {
      const double y = height == 0 ? 0 : rng.Uniform(-height, height);
      object.vertices.push_back(corner + Vec3d{static_cast<double>(i), y, static_cast<double>(j)});
    }
  }
  const uint32_t row = static_cast<uint32_t>(cells) + 1;
  for (uint32_t j = 0; j + 1 < row; ++j) {
    for (uint32_t i = 0; i + 1 < row; ++i) {
      const uint32_t a = j * row + i, b = a + 1, c = a + row, d = c + 1;
      object.indices.insert(object.indices.end(), {a, b, c, b, d, c});
    }
  }
  return object;
}

ObjectInput MakeClosedSphere(int rings, int sectors, double radius, Vec3d centre) {
  ObjectInput object;
  const double pi = 3.14159265358979323846;
  object.vertices.push_back(centre + Vec3d{0, 0, radius});
  for (int r = 1; r < rings; ++r) {
    for (int s = 0; s < sectors; ++s) {
      const double polar = pi * r / rings, turn = 2 * pi * s / sectors;
      object.vertices.push_back(centre + Vec3d{std::sin(polar) * std::cos(turn),
                                               std::sin(polar) * std::sin(turn), std::cos(polar)} *
                                             radius);
    }
  }
  object.vertices.push_back(centre + Vec3d{0, 0, -radius});
  const auto at = [&](int r, int s) -> uint32_t {
    if (r == 0) return 0;
    if (r == rings) return static_cast<uint32_t>(object.vertices.size()) - 1;
    return static_cast<uint32_t>(1 + (r - 1) * sectors + s % sectors);
  };
  for (int r = 0; r < rings; ++r) {
    for (int s = 0; s < sectors; ++s) {
      if (r > 0)
        object.indices.insert(object.indices.end(), {at(r, s), at(r + 1, s), at(r, s + 1)});
      if (r + 1 < rings) {
        object.indices.insert(object.indices.end(), {at(r, s + 1), at(r + 1, s), at(r + 1, s + 1)});
      }
    }
  }
  return object;
}

ObjectInput MakeClosedBox(int cells, Vec3d lo, Vec3d hi) {
  // Each vertex of the surface lattice once, found by its index.
  ObjectInput object;
  const int n = cells + 1;
  std::vector<uint32_t> ids(static_cast<size_t>(n) * n * n, 0xFFFFFFFFu);
  const auto at = [&](int i, int j, int k) {
    uint32_t& id = ids[(static_cast<size_t>(k) * n + j) * n + i];
    if (id == 0xFFFFFFFFu) {
      id = static_cast<uint32_t>(object.vertices.size());
      const Vec3d e = hi - lo;
      object.vertices.push_back(lo + Vec3d{e.x * i / cells, e.y * j / cells, e.z * k / cells});
    }
    return id;
  };
  for (int axis = 0; axis < 3; ++axis) {
    for (const int side : {0, cells}) {
      for (int s = 0; s < cells; ++s) {
        for (int t = 0; t < cells; ++t) {
          const auto corner = [&](int ds, int dt) {
            int p[3];
            p[axis] = side;
            p[(axis + 1) % 3] = s + ds;
            p[(axis + 2) % 3] = t + dt;
            return at(p[0], p[1], p[2]);
          };
          const uint32_t a = corner(0, 0), b = corner(1, 0), c = corner(0, 1), d = corner(1, 1);
          object.indices.insert(object.indices.end(), {a, b, c, b, d, c});
        }
      }
    }
  }
  return object;
}

Bvh BuildOrFail(const SceneGeometry& geometry, const BvhBuildOptions& options) {
  ThreadPool pool(1);
  absl::StatusOr<Bvh> bvh = BuildBvh(geometry, options, pool);
  EXPECT_TRUE(bvh.ok()) << bvh.status();
  return bvh.ok() ? *std::move(bvh) : Bvh();
}

IndexedGeometry IndexObjects(const std::vector<ObjectInput>& objects, std::optional<Vec3d> origin,
                             int max_leaf) {
  IndexedGeometry indexed;
  absl::StatusOr<SceneGeometry> geometry = CompileScene(objects, origin, MeshLimits{});
  EXPECT_TRUE(geometry.ok()) << geometry.status();
  if (!geometry.ok()) return indexed;
  indexed.geometry = *std::move(geometry);
  indexed.bvh = BuildOrFail(indexed.geometry, {.max_leaf_triangles = max_leaf});
  return indexed;
}

std::vector<NastyScene> MakeNastyScenes(TestRng& rng) {
  std::vector<NastyScene> scenes;
  const auto add = [&](const char* name, std::vector<ObjectInput> objects,
                       std::optional<Vec3d> origin = Vec3d{}, int max_leaf = 16) {
    NastyScene scene{name, std::move(objects), origin, {}};
    scene.indexed = IndexObjects(scene.objects, origin, max_leaf);
    scenes.push_back(std::move(scene));
  };
  const auto moved = [](ObjectInput object, Vec3d by, double scale = 1) {
    for (Vec3d& v : object.vertices) v = v * scale + by;
    return object;
  };
  const Vec3d map{1'000'000, 4'400'000, 250};
  add("none", {});
  add("one triangle", {Soup(rng, 1, 1, 1)});
  add("soup", {Soup(rng, 400, 5, 1)});
  add("soup, leaves of one", {Soup(rng, 200, 5, 2)}, Vec3d{}, 1);
  add("slivers", {Slivers(rng)});
  add("coplanar and duplicate faces", {CoplanarAndDuplicate(rng)}, Vec3d{}, 5);
  add("a small lattice", {Lattice(rng, 300, 2, 1)});
  add("identical triangles", {Identical(300)});
  add("zero areas and non-finite corners", {ZeroAreasAndNonFinite(rng)});
  add("a flat grid", {MakeGrid(12, 0, {-6, 0, -6}, rng)});
  add("a wavy grid", {MakeGrid(12, 0.4, {-6, 0, -6}, rng)}, Vec3d{}, 4);
  add("a closed sphere", {MakeClosedSphere(9, 14, 1, {})});
  add("a closed box", {MakeClosedBox(4, {-1, -1, -1}, {1, 1, 1})});
  add("at 10^6 m, rounded there", {moved(Soup(rng, 250, 20, 3), map)});
  add("at 10^6 m, its own origin", {moved(MakeGrid(10, 1, {}, rng), map)}, std::nullopt);
  add("scale ratio 10^6", {Soup(rng, 100, 1000, 1000), Soup(rng, 150, 0.01, 0.001)});
  add("masks and culling", MaskedAndCulled(rng), Vec3d{}, 3);
  add("to the bound", {moved(Lattice(rng, 120, 4, 1), {}, 0x1p38)});
  add("subnormal", {moved(Lattice(rng, 120, 5, 1), {}, 0x1p-148), Soup(rng, 5, 1, 1)});
  // Where squares of lengths underflow, or products of more.
  const double tiny = std::ldexp(1.0, -24 - static_cast<int>(rng.Below(48)));
  add("a tiny wavy grid", {moved(MakeGrid(12, 0.4, {-6, 0, -6}, rng), {}, tiny)});
  add("a tiny soup", {moved(Soup(rng, 200, 5, 2), {}, tiny)}, Vec3d{}, 7);
  add("a tiny closed box", {moved(MakeClosedBox(4, {-1, -1, -1}, {1, 1, 1}), {}, tiny)});
  add("mixed exponents", {MixedExponents(rng, 150, -60, 40)}, Vec3d{}, 4);
  add("mixed exponents, fewer", {MixedExponents(rng, 150, -12, 12)});
  return scenes;
}

NastyRays::NastyRays(const IndexedGeometry& scene, TestRng& rng)
    : geometry_(scene.geometry), rng_(rng), bounds_(scene.geometry.bounds) {
  if (bounds_.empty()) bounds_ = {{-1, -1, -1}, {1, 1, 1}};
}

Vec3f NastyRays::Corner() {
  for (int tries = 0; tries < 20 && !geometry_.vertices.empty(); ++tries) {
    const Vec3f v = geometry_.vertices[rng_.Below(geometry_.vertices.size())];
    if (IsFinite(v)) return v;
  }
  return {};
}

Vec3f NastyRays::OnTriangle() {
  if (geometry_.triangles.empty()) return {};
  const auto [a, b, c] =
      geometry_.Corners(static_cast<uint32_t>(rng_.Below(geometry_.triangles.size())));
  double u = rng_.Uniform(0, 1), v = rng_.Uniform(0, 1 - u);
  switch (rng_.Below(4)) {
    case 0:
      v = 0;
      break;  // On edge AB.
    case 1:
      u = 0.5, v = 0;
      break;  // Its middle.
    case 2:
      u = 0.25, v = 0.5;
      break;  // Dyadic: exact on lattices.
    default:
      break;
  }
  const Vec3f p = ToFloat(ToDouble(a) * (1 - u - v) + ToDouble(b) * u + ToDouble(c) * v);
  return IsFinite(p) ? p : Vec3f{};
}

Vec3f NastyRays::Point() {
  Vec3f p;
  switch (rng_.Below(6)) {
    case 0:
      p = Corner();
      break;
    case 1:
    case 2:
      p = OnTriangle();
      break;
    case 3: {  // A corner's coordinates mixed with another's: axis-parallel relations.
      p = Corner();
      const int axis = static_cast<int>(rng_.Below(3));
      p[axis] = Corner()[axis];
      break;
    }
    default:
      for (int k = 0; k < 3; ++k) {
        const double lo = bounds_.lo[k], hi = bounds_.hi[k], pad = 0.5 * (hi - lo) + 0x1p-140;
        p[k] = static_cast<float>(rng_.Uniform(lo - pad, hi + pad));
      }
      break;
  }
  if (rng_.Chance(0.2)) {
    const int axis = static_cast<int>(rng_.Below(3));
    p[axis] = MoveByUlps(p[axis], static_cast<int>(rng_.Below(5)) - 2);
  }
  return ClampToRange(p);
}

Vec3f NastyRays::Target(Vec3f origin, bool segment) {
  const Vec3f at = Point();
  Vec3f target = at;
  switch (rng_.Below(4)) {
    case 0:
      target = origin + (at - origin) * 2.0f;
      break;  // Through it.
    case 1:
      target = origin + (at - origin) * 17.0f;
      break;  // Far beyond.
    default:
      break;
  }
  target = ClampToRange(target);
  if (segment) {
    if (rng_.Chance(0.1)) {  // Axis-parallel.
      const int axis = static_cast<int>(rng_.Below(3));
      Vec3f end = origin;
      end[axis] = target[axis];
      if (rng_.Chance(0.5)) end[(axis + 1) % 3] = target[(axis + 1) % 3];
      target = end;
    }
    return target;
  }
  Vec3f d = ClampToRange(at - origin);
  if (rng_.Chance(0.15)) {
    const Vec3f whole[] = {{1, 2, 1},  {0.3f, 0.9f, 0.2f}, {1, 1, 1},
                           {-1, 1, 0}, {0, -1, 0},         {1, 1, -1}};
    d = whole[rng_.Below(std::size(whole))];
  }
  for (int k = 0; k < 3; ++k) {
    if (rng_.Chance(0.08)) d[k] = rng_.Chance(0.5) ? 0.0f : -0.0f;
    if (rng_.Chance(0.03)) d[k] = (static_cast<float>(rng_.Below(9)) - 4) * 0x1p-149f;
    if (rng_.Chance(0.01)) d[k] = MoveByUlps(0x1p-126f, static_cast<int>(rng_.Below(3)) - 1);
  }
  if (rng_.Chance(0.05)) d = d * 0x1p-60f;
  return d;
}

uint32_t NastyRays::Source() {
  if (geometry_.triangles.empty() || rng_.Chance(0.8)) return kNoTriangle;
  return static_cast<uint32_t>(rng_.Below(geometry_.triangles.size()));
}

TraceRay NastyRays::Next() {
  const bool segment = rng_.Chance(0.6);
  const Vec3f origin = Point();
  TraceRay query;
  query.ray = {origin, Target(origin, segment), segment};
  query.from_source = Source();
  query.to_source = Source();
  if (rng_.Chance(0.3)) query.mask = uint32_t{1} << rng_.Below(3);
  if (rng_.Chance(0.1)) query.mask = 0x80000000u;
  return query;
}

std::vector<TraceRay> NastyRays::FillPacket(int count, RayPacket* packet) {
  packet->origin = Point();
  packet->segments = rng_.Chance(0.6);
  packet->mask = rng_.Chance(0.7) ? 0xFFFFFFFFu : 1u << rng_.Below(3);
  packet->origin_source = Source();
  packet->count = count;
  packet->want_barycentrics = rng_.Chance(0.5);
  const bool narrow = rng_.Chance(0.7);
  const double strays = rng_.Chance(0.3) ? 0.02 : 0.0;
  const Vec3f middle = Target(packet->origin, packet->segments);
  std::vector<TraceRay> queries;
  for (int lane = 0; lane < count; ++lane) {
    Vec3f target = Target(packet->origin, packet->segments);
    if (narrow && !rng_.Chance(strays)) {
      for (int k = 0; k < 3; ++k) {
        target[k] = middle[k] + static_cast<float>(rng_.Uniform(-0.03, 0.03)) * middle[k];
      }
    }
    packet->target_x[lane] = target.x;
    packet->target_y[lane] = target.y;
    packet->target_z[lane] = target.z;
    packet->target_source[lane] = Source();
    queries.push_back({.ray = packet->ray(lane),
                       .mask = packet->mask,
                       .from_source = packet->origin_source,
                       .to_source = packet->segments ? packet->target_source[lane] : kNoTriangle});
  }
  return queries;
}

Hit TraceByDefinition(const SceneGeometry& geometry, const TraceRay& query) {
  Hit best;
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    if (std::binary_search(geometry.inert.begin(), geometry.inert.end(), id)) continue;
    if (id == query.from_source || id == query.to_source) continue;
    const auto [a, b, c] = geometry.Corners(id);
    if (!BlocksExactly(query.ray, a, b, c)) continue;
    const ObjectRecord* owner = nullptr;
    for (const ObjectRecord& object : geometry.objects) {
      if (id >= object.first_triangle && id - object.first_triangle < object.triangle_count) {
        owner = &object;
      }
    }
    if (owner == nullptr || (owner->mask & query.mask) == 0) continue;
    const bool front = SideOfPlane(a, b, c, query.ray.origin) > 0;  // The origin sees the front.
    if (owner->culling == Culling::kBack && !front) continue;
    if (owner->culling == Culling::kFront && front) continue;
    const float t = HitDistance(query.ray, a, b, c);
    if (t < best.t || (t == best.t && id < best.triangle)) best = {t, id};
  }
  return best;
}

std::ostream& operator<<(std::ostream& out, const Printed& p) {
  const TraceRay& q = p.query;
  return out << (q.ray.segment ? "Segment(" : "Ray(") << Hex(q.ray.origin) << ", "
             << Hex(q.ray.target) << "), mask " << q.mask << ", sources " << q.from_source << " "
             << q.to_source;
}

}  // namespace sightline::testing_support
