// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <limits>
#include <string>

#include "gtest/gtest.h"
#include "tests/client/import/import_testing.h"

namespace sightline {
namespace {

using import_testing::Bytes;
using import_testing::ImportError;
using import_testing::MustImport;
using testing::ElementsAre;

std::string Facet(const std::string& vertices) {
  return "  facet normal 0 0 1\n    outer loop\n" + vertices + "    endloop\n  endfacet\n";
}

const std::string kFirst = Facet("vertex 0 0 0\nvertex 1 0 0\nvertex 0 447422.999 0\n");
const std::string kSecond = Facet("vertex 1 0 0\nvertex 1 1 0\nvertex 0 447422.999 0\n");

std::string BinaryTriangle(float x) {
  return Bytes(0.f, 0.f, 1.f, x, 0.f, 0.f, x + 1, 0.f, 0.f, x, 1.f, 0.f, uint16_t{7});
}

std::string Binary(std::string header, uint32_t count) {
  header.resize(80, ' ');
  std::string bytes = header + Bytes(count);
  for (uint32_t i = 0; i < count; ++i) bytes += BinaryTriangle(static_cast<float>(i));
  return bytes;
}

TEST(StlTest, ReadsSolidsAsObjectsInDoubles) {
  const ImportedScene scene =
      MustImport("solid Wall One\n" + kFirst + kSecond + "endsolid Wall One\n" + "SOLID\n" +
                     kFirst + "ENDSOLID\nsolid Wall One\n" + kFirst + "endsolid\n",
                 MeshFormat::kStl);
  ASSERT_EQ(scene.objects.size(), 3u);
  EXPECT_EQ(scene.report.format, "stl ascii");
  EXPECT_EQ(scene.objects[0].name, "Wall One");
  EXPECT_EQ(scene.objects[1].name, "test");
  EXPECT_EQ(scene.objects[2].name, "Wall One (2)");
  EXPECT_EQ(scene.objects[0].vertices.size(), 4u);  // Shared corners are one vertex.
  EXPECT_THAT(scene.objects[0].indices, ElementsAre(0, 1, 2, 1, 3, 2));
  EXPECT_EQ(scene.objects[0].vertices[2].y, 447422.999);
  EXPECT_EQ(scene.report.duplicate_triangles, 2u);
}

TEST(StlTest, FansLoopsOfMoreThanThreeVertices) {
  const ImportedScene scene =
      MustImport("solid\n" + Facet("vertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 1 0\n") +
                     Facet("vertex 0 0 0\n") + "endsolid\n",
                 MeshFormat::kStl);
  EXPECT_EQ(scene.report.triangles, 2u);
  EXPECT_EQ(scene.report.polygons_fanned, 1u);
  EXPECT_EQ(scene.report.faces_too_few_corners, 1u);
}

TEST(StlTest, ReadsBinaryWhateverItsHeaderSays) {
  for (const char* header : {"binary", "solid but binary", "solid\nfacet normal 0 0 1\n", ""}) {
    const ImportedScene scene = MustImport(Binary(header, 3), MeshFormat::kStl);
    EXPECT_EQ(scene.report.format, "stl binary") << header;
    EXPECT_EQ(scene.report.triangles, 3u);
    ASSERT_EQ(scene.objects.size(), 1u);
    EXPECT_EQ(scene.objects[0].vertices.size(), 7u);
    EXPECT_EQ(scene.objects[0].name, "test");
  }
  const ImportedScene trailing =
      MustImport(Binary("solid x", 2) + std::string(3, '\0'), MeshFormat::kStl);
  EXPECT_EQ(trailing.report.triangles, 2u);
  EXPECT_THAT(trailing.report.warnings, ElementsAre(testing::StartsWith("3 bytes after")));
}

TEST(StlTest, RefusesWhatIsCutShort) {
  const std::string whole = Binary("part", 3);
  EXPECT_IMPORT_ERROR(ImportError(whole.substr(0, whole.size() - 1), MeshFormat::kStl), kDataLoss,
                      "3 triangles take 234 bytes, the file has 233");
  EXPECT_IMPORT_ERROR(ImportError(whole.substr(0, 60), MeshFormat::kStl), kDataLoss, "no STL file");
  EXPECT_IMPORT_ERROR(ImportError("solid x\n" + kFirst + kSecond.substr(0, 60), MeshFormat::kStl),
                      kDataLoss, "ends inside a facet");
  EXPECT_IMPORT_ERROR(
      ImportError("solid x\n" + kFirst + "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n",
                  MeshFormat::kStl),
      kDataLoss, "ends inside a facet");
  std::string huge = Binary("part", 1);
  huge.replace(80, 4, Bytes(uint32_t{0xFFFFFFFF}));
  EXPECT_IMPORT_ERROR(ImportError(huge, MeshFormat::kStl), kDataLoss, "4294967295 triangles");
}

// The fuzzer's first find: corners of one solid went on into the next, whose vertices are others.
TEST(StlTest, RefusesSolidsThatBeginOrEndInsideAFacet) {
  const std::string open = "facet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n";
  EXPECT_IMPORT_ERROR(ImportError("solid a\n" + open + "solid b\n" + kFirst, MeshFormat::kStl),
                      kDataLoss, "begins inside a facet");
  EXPECT_IMPORT_ERROR(ImportError("solid a\n" + open + "endsolid\n", MeshFormat::kStl), kDataLoss,
                      "ends inside a facet");
}

TEST(StlTest, WarnsOfAMissingEndAndOfOtherLines) {
  const ImportedScene scene = MustImport("solid x\ncolor 1 1 1\n" + kFirst, MeshFormat::kStl);
  EXPECT_EQ(scene.report.triangles, 1u);
  EXPECT_THAT(scene.report.warnings,
              ElementsAre("the last solid has no endsolid", "1 lines were not understood"));
}

TEST(StlTest, CountsNonFiniteVertices) {
  std::string bytes = Binary("part", 2);
  bytes.replace(84 + 12, 4, Bytes(std::numeric_limits<float>::infinity()));
  const ImportedScene scene = MustImport(bytes, MeshFormat::kStl);
  EXPECT_EQ(scene.report.non_finite_vertices, 1u);
  EXPECT_EQ(scene.report.non_finite_triangles, 1u);
  EXPECT_TRUE(std::isnan(scene.objects[0].vertices[0].y));
}

TEST(StlTest, SaysThatAnEmptySolidIsEmpty) {
  EXPECT_IMPORT_ERROR(ImportError("solid Empty\nendsolid Empty", MeshFormat::kStl),
                      kInvalidArgument, "the mesh is empty");
  EXPECT_IMPORT_ERROR(ImportError(Binary("none", 0), MeshFormat::kStl), kInvalidArgument,
                      "the mesh is empty");
}

}  // namespace
}  // namespace sightline
