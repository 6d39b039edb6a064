// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <cmath>
#include <cstdio>
#include <string>

#include "client/import/obj_statements.h"
#include "gtest/gtest.h"
#include "tests/client/import/import_testing.h"

namespace sightline {
namespace {

using import_testing::ImportError;
using import_testing::MustImport;
using import_testing::Repeated;
using testing::ElementsAre;

constexpr char kSquareVertices[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

TEST(ObjTest, KeepsEveryDigitOfADouble) {
  const ImportedScene scene = MustImport(
      "v 84616.468 447422.999 -0.452\nv 0.1 1e-3 -.7e+1\nv 1 2 3\nf 1 2 3\n", MeshFormat::kObj);
  ASSERT_EQ(scene.objects.size(), 1u);
  EXPECT_EQ(scene.objects[0].vertices[0], (Vec3d{84616.468, 447422.999, -0.452}));
  EXPECT_EQ(scene.objects[0].vertices[1], (Vec3d{0.1, 1e-3, -7}));
  EXPECT_FALSE(scene.report.float_precision_loss);
}

TEST(ObjTest, CutsPolygonsAsAFanFromTheirFirstCorner) {
  const ImportedScene scene =
      MustImport(std::string(kSquareVertices) + "v 0 0.5 0\nf 3 4 5 1 2\n", MeshFormat::kObj);
  EXPECT_EQ(scene.report.polygons, 1u);
  EXPECT_EQ(scene.report.polygons_fanned, 1u);
  EXPECT_EQ(scene.report.triangles, 3u);
  // First use numbers the vertices: 3, 4, 5, 1, 2 of the file.
  EXPECT_THAT(scene.objects[0].indices, ElementsAre(0, 1, 2, 0, 2, 3, 0, 3, 4));
  EXPECT_EQ(scene.objects[0].vertices[0], (Vec3d{1, 1, 0}));
}

TEST(ObjTest, ReadsEveryFormOfACorner) {
  const ImportedScene scene = MustImport(
      std::string(kSquareVertices) +
          "vt 0 0\nvn 0 0 1\nf 1 2 3\nf 1/1 2/1 3/1\nf 1//1 2//1 3//1\nf 1/1/1 2/1/1 3/1/1\n"
          "f 1// 2// 3//\nf 1/ 2/ 3/\nf -4 -3 -2\n\tf  1\t2  3  # a comment\n",
      MeshFormat::kObj);
  EXPECT_EQ(scene.report.triangles, 8u);
  EXPECT_EQ(scene.report.duplicate_triangles, 7u);
  EXPECT_EQ(scene.report.faces_bad_index, 0u);
}

TEST(ObjTest, NamesObjectsAfterObjectsAndGroups) {
  const ImportedScene scene = MustImport(
      std::string(kSquareVertices) +
          "f 1 2 3\no house\nf 1 2 3\ng roof left\nf 1 2 4\ng\nf 2 3 4\no shed\nf 1 2 3\n"
          "g roof left\nf 1 2 3\no house\nf 1 3 4\n",
      MeshFormat::kObj);
  std::vector<std::string> names;
  for (const ObjectInput& object : scene.objects) names.push_back(object.name);
  EXPECT_THAT(names, ElementsAre("test", "house", "house/roof left", "shed", "shed/roof left"));
  EXPECT_EQ(scene.objects[1].indices.size(), 9u);  // Before its group, after it, and again.
}

TEST(ObjTest, DropsFacesWithBadIndicesAndCountsThem) {
  const ImportedScene scene = MustImport(
      std::string(kSquareVertices) +
          "f 1 2 3\nf 0 1 2\nf 1 2 5\nf -5 -1 -2\nf 1 2 x\nf 1 2 4294967297\nf 1 2 3000000000\n"
          "f 1 2 99999999999999999999\nf 1 2\nf 1\nf\n",
      MeshFormat::kObj);
  EXPECT_EQ(scene.report.triangles, 1u);
  EXPECT_EQ(scene.report.polygons, 11u);
  EXPECT_EQ(scene.report.faces_bad_index, 7u);
  EXPECT_EQ(scene.report.faces_too_few_corners, 3u);
}

TEST(ObjTest, LetsFacesNameVerticesThatFollow) {
  EXPECT_EQ(MustImport("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n", MeshFormat::kObj).report.triangles,
            1u);
}

TEST(ObjTest, KeepsNonFiniteVerticesAsNaNAndCountsThem) {
  const ImportedScene scene =
      MustImport(std::string(kSquareVertices) +
                     "v nan 0 0\nv 0 inf 0\nv 1.#IND 0 0\nv 0 0\nv 0 zero 0\n"
                     "f 1 2 3\nf 1 2 5\nf 1 2 6\nf 1 2 8\n",
                 MeshFormat::kObj);
  EXPECT_EQ(scene.report.non_finite_vertices, 5u);
  EXPECT_EQ(scene.report.non_finite_triangles, 3u);
  EXPECT_EQ(scene.report.triangles, 4u);
  EXPECT_THAT(scene.report.warnings, ElementsAre(testing::StartsWith("2 vertices lack")));
  EXPECT_TRUE(std::isnan(scene.objects[0].vertices[3].z));
}

TEST(ObjTest, JoinsContinuedLinesAndTakesAnyLineEnd) {
  const ImportedScene scene = MustImport(
      "v 0 0 0\r\nv 1 0 0\rv 1 \\\r\n1 0\nv 0 1 0\nf 1 2 \\\n 3 \\\n 4", MeshFormat::kObj);
  EXPECT_EQ(scene.report.triangles, 2u);
  EXPECT_EQ(ImportError("f 1 2 3 \\", MeshFormat::kObj).code(), absl::StatusCode::kInvalidArgument);
}

TEST(ObjTest, CountsPointsAndLinesAndIgnoresMaterials) {
  const ImportedScene scene = MustImport(std::string("mtllib nowhere.mtl\nusemtl none\n") +
                                             kSquareVertices + "p 1 2\nl 1 2 3\nf 1 2 3\ns 1\n",
                                         MeshFormat::kObj);
  EXPECT_EQ(scene.report.skipped_primitives, 2u);
  EXPECT_TRUE(scene.report.warnings.empty());
}

TEST(ObjTest, ReadsAByteOrderMarkAndLongLines) {
  std::string text = "\xEF\xBB\xBFv 0 0 0\nv 1 0 0\nv 0 1 0\nf";
  for (int i = 0; i < 100000; ++i) text += " 1 2 3";
  EXPECT_EQ(MustImport(text, MeshFormat::kObj).report.triangles, 299998u);
}

TEST(ObjTest, KeepsToTheTriangleLimit) {
  ImportOptions options;
  options.max_triangles = 2;
  EXPECT_EQ(MustImport(std::string(kSquareVertices) + "f 1 2 3 4\n", MeshFormat::kObj, options)
                .report.triangles,
            2u);
  EXPECT_IMPORT_ERROR(
      ImportError(std::string(kSquareVertices) + "f 1 2 3 4\nf 1 2 3\n", MeshFormat::kObj, options),
      kResourceExhausted, "max_triangles, 2");
}

// Lines that hand on nothing, alone or continued, in one look of the stream at the text: the token
// is live when it begins, and stops long before so many lines can have been read.
TEST(ObjStatementsTest, StopAmongLinesThatHandOnNothing) {
  constexpr uint64_t kLines = 4'000'000;
  const auto until_stopped = [](ObjStatements* statements, CancelToken* cancel) {
    cancel->set_deadline(CancelToken::Clock::now() + std::chrono::milliseconds(1));
    return statements->sgetc();
  };
  {
    const std::string text = Repeated("p\n", kLines);
    CancelToken cancel;
    ObjStatements statements(text, &cancel);
    EXPECT_EQ(until_stopped(&statements, &cancel), EOF);
    EXPECT_LT(statements.skipped_primitives(), kLines);
  }
  {
    const std::string text = Repeated("\\\n", kLines) + "p";
    CancelToken cancel;
    ObjStatements statements(text, &cancel);
    EXPECT_EQ(until_stopped(&statements, &cancel), EOF);
    EXPECT_EQ(statements.skipped_primitives(), 0u);
  }
}

TEST(ObjTest, SaysWhyAMeshIsEmpty) {
  EXPECT_IMPORT_ERROR(
      ImportError("f -4 -3 -2", MeshFormat::kObj), kInvalidArgument,
      "test: the mesh is empty: no triangle in it; 1 faces with an index out of range");
  EXPECT_IMPORT_ERROR(ImportError("hello world", MeshFormat::kObj), kInvalidArgument, "empty");
  EXPECT_IMPORT_ERROR(ImportError("", MeshFormat::kObj), kInvalidArgument, "the file is empty");
}

}  // namespace
}  // namespace sightline
