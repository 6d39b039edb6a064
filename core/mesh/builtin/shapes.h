// SPDX-License-Identifier: Apache-2.0
//
// Shapes of the built-in scenes, added to a MeshBuilder. Solids are closed: every directed edge has
// its reverse exactly once, vertices are shared by index, and the front faces outward. Sheets are
// open.
//
// Templates take a map from lattice indices to points. It is called once per lattice vertex, by
// several threads for large shapes, so it must be a pure function.
//
// Thread safety: one thread per builder.
//
//   AddBlock(mesh, ShapePlacement({0, 0, 1}), {1, 1, 1}, 0.1, 3);   // A cube with rounded edges.
#ifndef SIGHTLINE_CORE_MESH_BUILTIN_SHAPES_H_
#define SIGHTLINE_CORE_MESH_BUILTIN_SHAPES_H_

#include <cstdint>
#include <initializer_list>
#include <span>

#include "core/base/parallel.h"
#include "core/geometry/vec3.h"
#include "core/mesh/builtin/deterministic_math.h"
#include "core/mesh/builtin/mesh_builder.h"

namespace sightline {

// Where a shape stands: turned about the z axis, then moved.
class ShapePlacement {
 public:
  explicit ShapePlacement(Vec3d origin, double yaw_turns = 0)
      : origin_(origin), yaw_(yaw_turns == 0 ? SinCos{0, 1} : SinCosTurns(yaw_turns)) {}

  Vec3d At(Vec3d p) const {
    return {origin_.x + (p.x * yaw_.cos - p.y * yaw_.sin),
            origin_.y + (p.x * yaw_.sin + p.y * yaw_.cos), origin_.z + p.z};
  }
  // The same turn at a point of this frame.
  ShapePlacement Moved(Vec3d p) const {
    ShapePlacement moved = *this;
    moved.origin_ = At(p);
    return moved;
  }

 private:
  Vec3d origin_;
  SinCos yaw_;
};

// fill(row) for every row, on several threads where there are many vertices: below this number a
// loop takes less than the some 10 us that it costs to wake the others.
template <typename Fill>
void ForRows(int rows, uint64_t vertices, Fill&& fill) {
  constexpr uint64_t kFewVertices = 4096;
  if (vertices < kFewVertices) {
    for (int row = 0; row < rows; ++row) fill(row);
    return;
  }
  ParallelFor(static_cast<size_t>(rows), 4, [&](size_t begin, size_t end) {
    for (size_t row = begin; row < end; ++row) fill(static_cast<int>(row));
  });
}

// A closed solid with the topology of a box of nx × ny × nz cells: `map(i, j, k)` is called for the
// lattice points of its surface. 4(nx·ny + ny·nz + nz·nx) triangles. REQUIRES: counts >= 1, map
// keeps orientation.
template <typename Map>
void AddSolid(MeshBuilder& mesh, int nx, int ny, int nz, Map&& map) {
  const uint32_t plane = static_cast<uint32_t>(nx + 1) * static_cast<uint32_t>(ny + 1);
  const uint32_t ring = 2 * static_cast<uint32_t>(nx + ny);
  const uint64_t cells = uint64_t(nx) * ny + uint64_t(ny) * nz + uint64_t(nz) * nx;
  if (!mesh.Begin(2 * uint64_t{plane} + uint64_t{ring} * (nz - 1), 4 * cells)) return;
  const uint32_t base = mesh.next();
  // Vertices: the bottom, the top, then the rings between them.
  Vec3d* const vertices = mesh.Vertices(2 * uint64_t{plane} + uint64_t{ring} * (nz - 1));
  ForRows(2 * (ny + 1), 2 * uint64_t{plane}, [&](int row) {
    const int j = row % (ny + 1), k = row <= ny ? 0 : nz;
    Vec3d* out = vertices + static_cast<uint64_t>(row) * static_cast<uint64_t>(nx + 1);
    for (int i = 0; i <= nx; ++i) *out++ = map(i, j, k);
  });
  ForRows(nz - 1, uint64_t{ring} * (nz - 1), [&](int row) {
    const int k = row + 1;
    Vec3d* out = vertices + 2 * uint64_t{plane} + static_cast<uint64_t>(row) * ring;
    for (int i = 0; i < nx; ++i) *out++ = map(i, 0, k);
    for (int j = 0; j < ny; ++j) *out++ = map(nx, j, k);
    for (int i = nx; i > 0; --i) *out++ = map(i, ny, k);
    for (int j = ny; j > 0; --j) *out++ = map(0, j, k);
  });
  const auto at = [&](int i, int j, int k) -> uint32_t {
    if (k == 0 || k == nz)
      return base + (k == 0 ? 0 : plane) + static_cast<uint32_t>(j * (nx + 1) + i);
    const int along = j == 0 && i < nx    ? i
                      : i == nx && j < ny ? nx + j
                      : j == ny && i > 0  ? nx + ny + (nx - i)
                                          : 2 * nx + ny + (ny - j);
    return base + 2 * plane + static_cast<uint32_t>(k - 1) * ring + static_cast<uint32_t>(along);
  };
  for (int j = 0; j < ny; ++j) {
    for (int i = 0; i < nx; ++i) {
      mesh.Quad(at(i, j, 0), at(i, j + 1, 0), at(i + 1, j + 1, 0), at(i + 1, j, 0));
      mesh.Quad(at(i, j, nz), at(i + 1, j, nz), at(i + 1, j + 1, nz), at(i, j + 1, nz));
    }
  }
  for (int k = 0; k < nz; ++k) {
    for (int i = 0; i < nx; ++i) {
      mesh.Quad(at(i, 0, k), at(i + 1, 0, k), at(i + 1, 0, k + 1), at(i, 0, k + 1));
      mesh.Quad(at(i + 1, ny, k), at(i, ny, k), at(i, ny, k + 1), at(i + 1, ny, k + 1));
    }
    for (int j = 0; j < ny; ++j) {
      mesh.Quad(at(nx, j, k), at(nx, j + 1, k), at(nx, j + 1, k + 1), at(nx, j, k + 1));
      mesh.Quad(at(0, j + 1, k), at(0, j, k), at(0, j, k + 1), at(0, j + 1, k + 1));
    }
  }
}

// An open sheet of nx × ny cells, 2·nx·ny triangles; the front is where map's i × j points.
// Diagonals alternate, so that a bent sheet has no grain.
template <typename Map>
void AddSheet(MeshBuilder& mesh, int nx, int ny, Map&& map) {
  const uint64_t row = static_cast<uint64_t>(nx) + 1;
  if (!mesh.Begin(row * (static_cast<uint64_t>(ny) + 1), 2 * uint64_t(nx) * ny)) return;
  const uint32_t base = mesh.next();
  Vec3d* const vertices = mesh.Vertices(row * (static_cast<uint64_t>(ny) + 1));
  ForRows(ny + 1, row * (static_cast<uint64_t>(ny) + 1), [&](int j) {
    Vec3d* out = vertices + static_cast<uint64_t>(j) * row;
    for (int i = 0; i <= nx; ++i) *out++ = map(i, j);
  });
  for (int j = 0; j < ny; ++j) {
    for (int i = 0; i < nx; ++i) {
      const uint32_t a = base + static_cast<uint32_t>(j * row + i);
      const uint32_t b = a + 1, c = a + 1 + static_cast<uint32_t>(row),
                     d = a + static_cast<uint32_t>(row);
      if (((i + j) & 1) == 0) {
        mesh.Quad(a, b, c, d);
      } else {
        mesh.Quad(b, c, d, a);
      }
    }
  }
}

// A ball around `center` with 12·n² triangles: a cube of n³ cells pushed onto the sphere;
// `radius(unit direction)` is called once per vertex. REQUIRES: n >= 1.
template <typename Radius>
void AddBall(MeshBuilder& mesh, Vec3d center, int n, Radius&& radius) {
  // Near tan(x·pi/4), which evens out the cells; exact at -1, 0 and 1.
  const auto spread = [n](int i) {
    const double x = static_cast<double>(2 * i - n) / n;
    return x * (0.785 + 0.215 * x * x);
  };
  AddSolid(mesh, n, n, n, [&](int i, int j, int k) {
    const Vec3d direction = Unit({spread(i), spread(j), spread(k)});
    return center + direction * radius(direction);
  });
}
inline void AddBall(MeshBuilder& mesh, Vec3d center, double radius, int n) {
  AddBall(mesh, center, n, [radius](Vec3d) { return radius; });
}

// A box of half sizes `half` around the placement's origin, n cells along each side; from n = 3 on
// its edges are rounded with radius `round`. REQUIRES: 0 < round < the smallest half size.
void AddBlock(MeshBuilder& mesh, const ShapePlacement& place, Vec3d half, double round, int n);
// A plain box from `lo` to `hi` in the placement's frame, nx × ny × nz cells.
void AddBox(MeshBuilder& mesh, const ShapePlacement& place, Vec3d lo, Vec3d hi, int nx = 1,
            int ny = 1, int nz = 1);

// One ring of a lathe: its radius and height.
struct Turn {
  double radius, z;
};
// A closed solid of revolution about the placement's z axis: rings from the first to the last turn,
// flat ends. Turns are joined by a smooth curve with `fineness` rings for each; `flutes` > 0
// grooves the rings by `depth` of their radius. 2·segments·rings triangles. REQUIRES: >= 2 turns,
// radii > 0, segments >= 3.
void AddLathe(MeshBuilder& mesh, const ShapePlacement& place, std::span<const Turn> turns,
              int segments, int fineness, int flutes = 0, double depth = 0);
inline void AddLathe(MeshBuilder& mesh, const ShapePlacement& place,
                     std::initializer_list<Turn> turns, int segments, int fineness, int flutes = 0,
                     double depth = 0) {
  AddLathe(mesh, place, std::span<const Turn>(turns.begin(), turns.size()), segments, fineness,
           flutes, depth);
}

// One joint of a tube.
struct Joint {
  Vec3d at;
  double radius;
};
// A closed tube along the joints, 2·segments·joints triangles. REQUIRES: >= 2 joints, neighbours
// apart, radii > 0, no turn of 180 degrees, segments >= 3.
void AddTube(MeshBuilder& mesh, std::span<const Joint> joints, int segments);
inline void AddTube(MeshBuilder& mesh, std::initializer_list<Joint> joints, int segments) {
  AddTube(mesh, std::span<const Joint>(joints.begin(), joints.size()), segments);
}

// A torus about the placement's z axis, 2·around·across triangles. REQUIRES: 0 < thin < wide.
void AddTorus(MeshBuilder& mesh, const ShapePlacement& place, double wide, double thin, int around,
              int across);

// A leaf: an open blade from `base` along unit vector `along` (drooping by `droop` of its length
// toward -z), its faces toward `up` (not parallel to `along`), folded at the midrib. 2 triangles
// for cells = 0, else 4·cells.
struct LeafShape {
  double length, width, droop, fold;
};
uint64_t LeafTriangles(int cells);
void AddLeaf(MeshBuilder& mesh, Vec3d base, Vec3d along, Vec3d up, const LeafShape& shape,
             int cells);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_BUILTIN_SHAPES_H_
