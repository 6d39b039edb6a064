// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/builtin/shapes.h"

#include <functional>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "tests/core/mesh/builtin/mesh_facts.h"

namespace sightline {
namespace {

// Makes a shape twice, counting and in earnest, and checks that it is a closed solid facing
// outward.
void ExpectSolid(const std::string& what, const std::function<void(MeshBuilder&)>& add) {
  SCOPED_TRACE(what);
  MeshBuilder counter(nullptr);
  add(counter);
  ObjectInput object;
  MeshBuilder mesh(&object);
  add(mesh);
  mesh.Finish();
  EXPECT_EQ(counter.triangles(), object.indices.size() / 3);
  EXPECT_TRUE(IsClosed(object));
  EXPECT_GT(SignedVolume(object), 0);
  EXPECT_EQ(CountZeroArea(object), 0u);
}

TEST(Shapes, SolidsAreClosedAndFaceOutward) {
  const ShapePlacement place({3, -2, 1}, 0.13);
  for (int n : {1, 2, 3, 5, 8}) {
    const std::string size = " " + std::to_string(n);
    ExpectSolid("block" + size, [&](MeshBuilder& m) { AddBlock(m, place, {1, 0.7, 0.4}, 0.1, n); });
    ExpectSolid("box" + size, [&](MeshBuilder& m) {
      AddBox(m, place, {-1, -2, 0}, {1, 3, 0.5}, n, 2, n + 1);
    });
    ExpectSolid("ball" + size, [&](MeshBuilder& m) { AddBall(m, {1, 2, 3}, 0.5, n); });
    ExpectSolid("lathe" + size, [&](MeshBuilder& m) {
      AddLathe(m, place, {{0.5, 0}, {0.2, 0.5}, {0.6, 1.4}, {0.1, 1.5}}, 3 * n, n, 3, 0.1);
    });
    ExpectSolid("tube" + size, [&](MeshBuilder& m) {
      AddTube(m, {{{0, 0, 0}, 0.1}, {{0, 0, 1}, 0.1}, {{0.5, 0.3, 1.5}, 0.05}}, 2 + n);
    });
    ExpectSolid("torus" + size, [&](MeshBuilder& m) { AddTorus(m, place, 1, 0.2, 2 + n, 3 + n); });
  }
}

// Large enough to be made by several threads: the order of vertices must not show it.
TEST(Shapes, AreTheSameFromSeveralThreads) {
  ObjectInput object;
  MeshBuilder mesh(&object);
  AddBall(mesh, {0, 0, 0}, 1.0, 90);
  mesh.Finish();
  EXPECT_TRUE(IsClosed(object));
  for (int i = 0; i < 3; ++i) {
    ObjectInput again;
    MeshBuilder other(&again);
    AddBall(other, {0, 0, 0}, 1.0, 90);
    EXPECT_EQ(again.vertices, object.vertices);
    EXPECT_EQ(again.indices, object.indices);
  }
}

TEST(Shapes, LeavesHaveTheTrianglesTheySay) {
  for (int cells = 0; cells < 6; ++cells) {
    ObjectInput object;
    MeshBuilder mesh(&object);
    AddLeaf(mesh, {0, 0, 0}, {1, 0, 0}, {0, 0, 1}, {1, 0.3, 0.2, 0.2}, cells);
    mesh.Finish();
    EXPECT_EQ(object.indices.size(), 3 * LeafTriangles(cells));
    EXPECT_EQ(CountZeroArea(object), 0u);
    // Its faces look up.
    for (size_t t = 0; t < object.indices.size(); t += 3) {
      EXPECT_GT(TriangleNormal(object, t).z, 0) << cells << " cells, triangle " << t / 3;
    }
  }
}

}  // namespace
}  // namespace sightline
