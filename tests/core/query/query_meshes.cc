// SPDX-License-Identifier: Apache-2.0
#include "tests/core/query/query_meshes.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "core/base/check.h"
#include "core/base/parallel.h"

namespace sightline::testing_support {

Vec3d RandomDirection(TestRng& rng) {
  for (;;) {
    const Vec3d d = {rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)};
    const double length = Length(d);
    if (length > 0.01 && length <= 1) return d * (1 / length);
  }
}

Vec3d RandomInBox(TestRng& rng, Vec3d half) {
  const double x = rng.Uniform(-half.x, half.x);
  const double y = rng.Uniform(-half.y, half.y);
  return {x, y, rng.Uniform(-half.z, half.z)};
}

Affine3d RandomPlacement(TestRng& rng, Vec3d centre) {
  const Vec3d x = RandomDirection(rng);
  Vec3d z = Cross(x, RandomDirection(rng));
  z = z * (1 / Length(z));
  const Vec3d y = Cross(z, x);
  return {{x.x, y.x, z.x, centre.x, x.y, y.y, z.y, centre.y, x.z, y.z, z.z, centre.z}};
}

ObjectInput MakeIcosphere(int level, double radius, const Affine3d& placement) {
  const double g = (1 + std::sqrt(5.0)) / 2;
  ObjectInput mesh{.name = "sphere",
                   .vertices = {{-1, g, 0},
                                {1, g, 0},
                                {-1, -g, 0},
                                {1, -g, 0},
                                {0, -1, g},
                                {0, 1, g},
                                {0, -1, -g},
                                {0, 1, -g},
                                {g, 0, -1},
                                {g, 0, 1},
                                {-g, 0, -1},
                                {-g, 0, 1}},
                   .indices = {0, 11, 5,  0, 5,  1, 0, 1, 7, 0, 7,  10, 0, 10, 11, 1, 5, 9, 5, 11,
                               4, 11, 10, 2, 10, 7, 6, 7, 1, 8, 3,  9,  4, 3,  4,  2, 3, 2, 6, 3,
                               6, 8,  3,  8, 9,  4, 9, 5, 2, 4, 11, 6,  2, 10, 8,  6, 7, 9, 8, 1},
                   .transform = placement};
  for (int i = 0; i < level; ++i) {
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> middles;
    const auto middle = [&](uint32_t a, uint32_t b) {
      const auto [it, is_new] = middles.try_emplace(std::minmax(a, b), mesh.vertices.size());
      if (is_new) mesh.vertices.push_back((mesh.vertices[a] + mesh.vertices[b]) * 0.5);
      return it->second;
    };
    std::vector<uint32_t> next;
    for (size_t t = 0; t < mesh.indices.size(); t += 3) {
      const uint32_t a = mesh.indices[t], b = mesh.indices[t + 1], c = mesh.indices[t + 2];
      const uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      next.insert(next.end(), {a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca});
    }
    mesh.indices = next;
    for (Vec3d& v : mesh.vertices) v = v * (1 / Length(v));
  }
  for (Vec3d& v : mesh.vertices) v = v * (radius / Length(v));
  return mesh;
}

namespace {

// The four corners of each face, seen counter-clockwise from outside. Corner k has signs of its
// bits.
constexpr int kFaces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                              {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};

Vec3d BoxCorner(Vec3d half, int k) {
  return {k & 1 ? half.x : -half.x, k & 2 ? half.y : -half.y, k & 4 ? half.z : -half.z};
}

}  // namespace

ObjectInput MakeBox(Vec3d half, const Affine3d& placement) {
  ObjectInput mesh{.name = "box", .transform = placement};
  for (int k = 0; k < 8; ++k) mesh.vertices.push_back(BoxCorner(half, k));
  for (const auto& f : kFaces) {
    for (int i : {0, 1, 2, 0, 2, 3}) mesh.indices.push_back(f[i]);
  }
  return mesh;
}

ObjectInput MakePatchedBox(TestRng& rng, Vec3d half, const Affine3d& placement) {
  ObjectInput mesh{.name = "patched", .transform = placement};
  for (int face = 0; face < 6; ++face) {
    const int n = face + 1;
    const uint32_t first = mesh.vertices.size();
    const Vec3d o = BoxCorner(half, kFaces[face][0]);
    const Vec3d u = BoxCorner(half, kFaces[face][1]) - o, v = BoxCorner(half, kFaces[face][3]) - o;
    for (int j = 0; j <= n; ++j) {
      for (int i = 0; i <= n; ++i) {
        mesh.vertices.push_back(o + u * (double(i) / n) + v * (double(j) / n));
      }
    }
    const bool flip = rng.Chance(0.5);
    for (int j = 0; j < n; ++j) {
      for (int i = 0; i < n; ++i) {
        const uint32_t a = first + j * (n + 1) + i, b = a + 1, d = a + n + 1, c = d + 1;
        if (flip) {
          mesh.indices.insert(mesh.indices.end(), {a, c, b, a, d, c});
        } else {
          mesh.indices.insert(mesh.indices.end(), {a, b, c, a, c, d});
        }
      }
    }
  }
  return mesh;
}

ObjectInput MakeTerrain(int cells, double size, Vec3d corner) {
  ObjectInput mesh{.name = "terrain"};
  const double step = size / cells;
  for (int j = 0; j <= cells; ++j) {
    for (int i = 0; i <= cells; ++i) {
      // Slopes: at most 0.3 each way from each wave, 0.6 together: 31 degrees.
      const double h =
          step * (0.5 * std::sin(0.6 * i + 0.1 * j) + 0.5 * std::sin(0.6 * j - 0.1 * i));
      mesh.vertices.push_back(corner + Vec3d{i * step, j * step, h});
    }
  }
  for (int j = 0; j < cells; ++j) {
    for (int i = 0; i < cells; ++i) {
      const uint32_t a = j * (cells + 1) + i, b = a + 1, d = a + cells + 1, c = d + 1;
      mesh.indices.insert(mesh.indices.end(), {a, b, c, a, c, d});
    }
  }
  return mesh;
}

ObjectInput Flipped(ObjectInput object) {
  for (size_t t = 0; t < object.indices.size(); t += 3) {
    std::swap(object.indices[t], object.indices[t + 1]);
  }
  return object;
}

IndexedGeometry MakeScene(const std::vector<ObjectInput>& objects, std::optional<Vec3d> origin,
                          const BvhBuildOptions& options) {
  auto geometry = CompileScene(objects, origin, {});
  SIGHTLINE_CHECK(geometry.ok()) << geometry.status();
  ThreadPool pool(1);
  auto bvh = BuildBvh(*geometry, options, pool);
  SIGHTLINE_CHECK(bvh.ok()) << bvh.status();
  IndexedGeometry scene;
  scene.geometry = *std::move(geometry);
  scene.bvh = *std::move(bvh);
  return scene;
}

IndexedGeometry OnKdTreeAlone(IndexedGeometry scene, const KdBuildOptions& options) {
  ThreadPool pool(1);
  auto tree = BuildKdTree(scene.geometry, options, pool);
  SIGHTLINE_CHECK(tree.ok()) << tree.status();
  scene.kd_tree = *std::move(tree);
  scene.bvh = Bvh();
  return scene;
}

Camera LookingDown(Vec3d eye, double tan_half_fov_y, uint32_t side) {
  return {.eye = eye,
          .right = {1, 0, 0},
          .up = {0, 1, 0},
          .forward = {0, 0, -1},
          .tan_half_fov_y = tan_half_fov_y,
          .width = side,
          .height = side};
}

bool IsLit(const SceneGeometry& geometry, const PredicateRay& ray, uint32_t source) {
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    if (id == source) continue;
    const auto [a, b, c] = geometry.Corners(id);
    if (Blocks(ray, a, b, c)) return false;
  }
  return true;
}

Hit FirstHit(const SceneGeometry& geometry, const PredicateRay& ray) {
  Hit first;
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    const auto [a, b, c] = geometry.Corners(id);
    if (!Blocks(ray, a, b, c)) continue;
    first = std::min(first, Hit{HitDistance(ray, a, b, c), id});
  }
  return first;
}

bool IsExactlyConvex(const SceneGeometry& geometry) {
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    for (Vec3f v : geometry.vertices) {
      if (SideOf(geometry, id, v) > 0) return false;
    }
  }
  return true;
}

Vec3d PointNearRim(TestRng& rng, const std::array<Vec3f, 3>& corners) {
  double w[3];
  for (double& x : w) {
    // 0, or 2^-e for e up to 40, or anything.
    x = rng.Chance(0.3) ? 0 : rng.Chance(0.6) ? std::exp2(-rng.Uniform(0, 40)) : rng.Uniform(0, 1);
  }
  if (w[0] + w[1] + w[2] == 0) w[rng.Below(3)] = 1;
  const double sum = w[0] + w[1] + w[2];
  return (ToDouble(corners[0]) * w[0] + ToDouble(corners[1]) * w[1] + ToDouble(corners[2]) * w[2]) *
         (1 / sum);
}

}  // namespace sightline::testing_support
