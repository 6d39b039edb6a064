// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/builtin/shapes.h"

#include <algorithm>
#include <vector>

namespace sightline {
namespace {

// Lattice line `i` of `n` across [-half, half], with the outer quarters of the lines on the rounded
// rim.
double RimLine(int i, int n, double half, double round) {
  const int rim = n < 3 ? 0 : std::max(1, n / 4);
  if (rim == 0) return Lerp(-half, half, static_cast<double>(i) / n);
  if (i <= rim) return -half + round * (static_cast<double>(i) / rim);
  if (i >= n - rim) return half - round * (static_cast<double>(n - i) / rim);
  return Lerp(-half + round, half - round, static_cast<double>(i - rim) / (n - 2 * rim));
}

// Catmull–Rom through b and c.
double Curve(double a, double b, double c, double d, double t) {
  return b + 0.5 * t * ((c - a) + t * ((2 * a - 5 * b + 4 * c - d) + t * (3 * (b - c) + d - a)));
}

}  // namespace

void AddBlock(MeshBuilder& mesh, const ShapePlacement& place, Vec3d half, double round, int n) {
  AddSolid(mesh, n, n, n, [&](int i, int j, int k) {
    const Vec3d p{RimLine(i, n, half.x, round), RimLine(j, n, half.y, round),
                  RimLine(k, n, half.z, round)};
    if (n < 3) return place.At(p);
    const Vec3d core{Clamp(p.x, round - half.x, half.x - round),
                     Clamp(p.y, round - half.y, half.y - round),
                     Clamp(p.z, round - half.z, half.z - round)};
    const Vec3d out = p - core;
    return place.At(core + out * (round / Length(out)));
  });
}

void AddBox(MeshBuilder& mesh, const ShapePlacement& place, Vec3d lo, Vec3d hi, int nx, int ny,
            int nz) {
  AddSolid(mesh, nx, ny, nz, [&](int i, int j, int k) {
    return place.At({Lerp(lo.x, hi.x, static_cast<double>(i) / nx),
                     Lerp(lo.y, hi.y, static_cast<double>(j) / ny),
                     Lerp(lo.z, hi.z, static_cast<double>(k) / nz)});
  });
}

void AddLathe(MeshBuilder& mesh, const ShapePlacement& place, std::span<const Turn> turns,
              int segments, int fineness, int flutes, double depth) {
  const int last = static_cast<int>(turns.size()) - 1;
  const int rings = last * fineness + 1;
  if (!mesh.Begin(uint64_t(rings) * segments + 2, 2 * uint64_t(rings) * segments)) return;
  // Grooves need some segments each to look like grooves.
  const bool grooved = flutes > 0 && segments >= 4 * flutes;
  std::vector<SinCos> around(segments);
  std::vector<double> groove(segments, 1.0);
  for (int s = 0; s < segments; ++s) {
    const double turn = static_cast<double>(s) / segments;
    around[s] = SinCosTurns(turn);
    if (grooved) groove[s] = 1 - depth * (0.5 + 0.5 * SinCosTurns(turn * flutes).cos);
  }
  const uint32_t bottom = mesh.Vertex(place.At({0, 0, turns.front().z}));
  const uint32_t top = mesh.Vertex(place.At({0, 0, turns.back().z}));
  const uint32_t first = mesh.next();
  for (int ring = 0; ring < rings; ++ring) {
    const int b = std::min(ring / fineness, last - 1);
    const double t = static_cast<double>(ring - b * fineness) / fineness;
    const Turn& p = turns[std::max(b - 1, 0)];
    const Turn& q = turns[b];
    const Turn& r = turns[b + 1];
    const Turn& u = turns[std::min(b + 2, last)];
    const double least = 0.3 * std::min(q.radius, r.radius);
    const double radius = std::max(Curve(p.radius, q.radius, r.radius, u.radius, t), least);
    const double z = Curve(p.z, q.z, r.z, u.z, t);
    for (int s = 0; s < segments; ++s) {
      const double rho = radius * groove[s];
      mesh.Vertex(place.At({rho * around[s].cos, rho * around[s].sin, z}));
    }
  }
  const auto at = [&](int ring, int s) {
    return first + static_cast<uint32_t>(ring * segments + (s == segments ? 0 : s));
  };
  for (int s = 0; s < segments; ++s) {
    mesh.Triangle(bottom, at(0, s + 1), at(0, s));
    mesh.Triangle(top, at(rings - 1, s), at(rings - 1, s + 1));
  }
  for (int ring = 0; ring + 1 < rings; ++ring) {
    for (int s = 0; s < segments; ++s) {
      mesh.Quad(at(ring, s), at(ring, s + 1), at(ring + 1, s + 1), at(ring + 1, s));
    }
  }
}

void AddTube(MeshBuilder& mesh, std::span<const Joint> joints, int segments) {
  const int count = static_cast<int>(joints.size());
  if (!mesh.Begin(uint64_t(count) * segments + 2, 2 * uint64_t(count) * segments)) return;
  const uint32_t start = mesh.Vertex(joints.front().at);
  const uint32_t end = mesh.Vertex(joints.back().at);
  const uint32_t first = mesh.next();
  Vec3d across = AnyAcross(Unit(joints[1].at - joints[0].at));
  for (int i = 0; i < count; ++i) {
    const Vec3d along = Unit(joints[std::min(i + 1, count - 1)].at - joints[std::max(i - 1, 0)].at);
    across = Unit(across -
                  along * Dot(across, along));  // Carried along, so that the tube does not twist.
    const Vec3d over = Cross(along, across);
    for (int s = 0; s < segments; ++s) {
      const SinCos sc = SinCosTurns(static_cast<double>(s) / segments);
      mesh.Vertex(joints[i].at + (across * sc.cos + over * sc.sin) * joints[i].radius);
    }
  }
  const auto at = [&](int i, int s) {
    return first + static_cast<uint32_t>(i * segments + (s == segments ? 0 : s));
  };
  for (int s = 0; s < segments; ++s) {
    mesh.Triangle(start, at(0, s + 1), at(0, s));
    mesh.Triangle(end, at(count - 1, s), at(count - 1, s + 1));
  }
  for (int i = 0; i + 1 < count; ++i) {
    for (int s = 0; s < segments; ++s) {
      mesh.Quad(at(i, s), at(i, s + 1), at(i + 1, s + 1), at(i + 1, s));
    }
  }
}

void AddTorus(MeshBuilder& mesh, const ShapePlacement& place, double wide, double thin, int around,
              int across) {
  if (!mesh.Begin(uint64_t(around) * across, 2 * uint64_t(around) * across)) return;
  const uint32_t first = mesh.next();
  for (int i = 0; i < around; ++i) {
    const SinCos a = SinCosTurns(static_cast<double>(i) / around);
    for (int j = 0; j < across; ++j) {
      const SinCos b = SinCosTurns(static_cast<double>(j) / across);
      const double rho = wide + thin * b.cos;
      mesh.Vertex(place.At({rho * a.cos, rho * a.sin, thin * b.sin}));
    }
  }
  for (int i = 0; i < around; ++i) {
    const uint32_t row = first + static_cast<uint32_t>(i * across);
    const uint32_t after = first + static_cast<uint32_t>((i + 1 == around ? 0 : i + 1) * across);
    for (int j = 0; j < across; ++j) {
      const uint32_t k = static_cast<uint32_t>(j + 1 == across ? 0 : j + 1);
      mesh.Quad(row + j, after + j, after + k, row + k);
    }
  }
}

uint64_t LeafTriangles(int cells) { return cells == 0 ? 2 : 4 * static_cast<uint64_t>(cells); }

void AddLeaf(MeshBuilder& mesh, Vec3d base, Vec3d along, Vec3d up, const LeafShape& shape,
             int cells) {
  const uint64_t vertices = cells == 0 ? 4 : 3 * static_cast<uint64_t>(cells) + 2;
  if (!mesh.Begin(vertices, LeafTriangles(cells))) return;
  const Vec3d side = Unit(Cross(up, along));
  const Vec3d face = Cross(along, side);
  const auto rib = [&](double t) {
    const Vec3d p = base + along * (shape.length * t);
    return Vec3d{p.x, p.y, p.z - shape.droop * shape.length * t * t};
  };
  const auto blade = [&](double t, double half, double sign) {
    return rib(t) + side * (sign * half) + face * (shape.fold * half);
  };
  const uint32_t root = mesh.Vertex(base);
  const uint32_t tip = mesh.Vertex(rib(1));
  if (cells == 0) {  // A folded rhomb: the midrib is the fold.
    const uint32_t left = mesh.Vertex(blade(0.45, 0.5 * shape.width, 1));
    const uint32_t right = mesh.Vertex(blade(0.45, 0.5 * shape.width, -1));
    mesh.Triangle(root, tip, left);
    mesh.Triangle(root, right, tip);
    return;
  }
  uint32_t left = root, middle = root, right = root;
  for (int i = 1; i <= cells; ++i) {
    const double t = static_cast<double>(i) / (cells + 1);
    const double half =
        0.5 * shape.width * (6.75 * t * (1 - t) * (1 - t) * 0.6 + 4 * t * (1 - t) * 0.4);
    const uint32_t l = mesh.Vertex(blade(t, half, 1));
    const uint32_t m = mesh.Vertex(rib(t));
    const uint32_t r = mesh.Vertex(blade(t, half, -1));
    if (i == 1) {
      mesh.Triangle(root, m, l);
      mesh.Triangle(root, r, m);
    } else {
      mesh.Quad(left, middle, m, l);
      mesh.Quad(middle, right, r, m);
    }
    left = l, middle = m, right = r;
  }
  mesh.Triangle(left, middle, tip);
  mesh.Triangle(middle, right, tip);
}

}  // namespace sightline
