// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <string>

#include "gtest/gtest.h"
#include "tests/client/import/import_testing.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using import_testing::Bytes;
using import_testing::ImportError;
using import_testing::MustImport;
using import_testing::WriteFile;
using testing::ElementsAre;

std::string Header(const std::string& encoding, const std::string& elements) {
  return "ply\nformat " + encoding + " 1.0\ncomment made by hand\n" + elements + "end_header\n";
}

constexpr char kVertices[] =
    "element vertex 4\nproperty double x\nproperty double y\nproperty double z\n";
constexpr char kFaces[] = "element face 2\nproperty list uchar int vertex_indices\n";

TEST(PlyTest, ReadsAsciiInDoubles) {
  const ImportedScene scene =
      MustImport(Header("ascii", std::string(kVertices) + kFaces) +
                     "0 0 0\n1 0 0\n1 447422.999 0\n0 1 0\n4 0 1 2 3\n3 0 1 2\n",
                 MeshFormat::kPly);
  ASSERT_EQ(scene.objects.size(), 1u);
  EXPECT_EQ(scene.report.format, "ply ascii");
  EXPECT_EQ(scene.objects[0].vertices[2], (Vec3d{1, 447422.999, 0}));
  EXPECT_THAT(scene.objects[0].indices, ElementsAre(0, 1, 2, 0, 2, 3, 0, 1, 2));
  EXPECT_EQ(scene.report.polygons_fanned, 1u);
}

// A value in either byte order.
template <typename T>
std::string Value(T value, bool big) {
  std::string bytes = Bytes(value);
  if (big) std::reverse(bytes.begin(), bytes.end());
  return bytes;
}

TEST(PlyTest, ReadsBinaryInEitherByteOrderAndAnyArrangement) {
  for (const bool big : {false, true}) {
    // Faces first, properties out of order, lists and elements that are not wanted in between.
    const std::string elements =
        "element note 2\nproperty list ushort double words\nproperty char tag\n"
        "element face 1\nproperty float quality\nproperty list int uint vertex_index\n"
        "property list uchar float texcoord\n"
        "element vertex 3\nproperty uchar red\nproperty double z\nproperty float x\nproperty short "
        "y\n"
        "element edge 1\nproperty int vertex1\nproperty int vertex2\n";
    std::string body;
    for (int i = 0; i < 2; ++i) {
      body += Value(uint16_t{2}, big) + Value(1.5, big) + Value(2.5, big) + Value(int8_t{-1}, big);
    }
    body += Value(0.5f, big) + Value(int32_t{3}, big) + Value(0u, big) + Value(1u, big) +
            Value(2u, big);
    body += Value(uint8_t{1}, big) + Value(9.f, big);
    for (int i = 0; i < 3; ++i) {
      body += Value(uint8_t{255}, big) + Value(447422.999 + i, big) +
              Value(static_cast<float>(i), big) + Value(static_cast<int16_t>(-300 * i * i), big);
    }
    body += Value(int32_t{0}, big) + Value(int32_t{1}, big);
    const ImportedScene scene =
        MustImport(Header(big ? "binary_big_endian" : "binary_little_endian", elements) + body,
                   MeshFormat::kPly);
    ASSERT_EQ(scene.objects.size(), 1u) << big;
    EXPECT_EQ(scene.objects[0].vertices[2], (Vec3d{2, -1200, 447424.999}));
    EXPECT_THAT(scene.objects[0].indices, ElementsAre(0, 1, 2));
    EXPECT_EQ(scene.report.skipped_primitives, 1u);
  }
}

TEST(PlyTest, ReadsTriangleStrips) {
  const ImportedScene scene = MustImport(
      Header("ascii", std::string(kVertices) +
                          "element tristrips 1\nproperty list int int vertex_indices\n") +
          "0 0 0\n1 0 0\n0 1 0\n1 1 0\n8 0 1 2 3 -1 1 2 3\n",
      MeshFormat::kPly);
  EXPECT_THAT(scene.objects[0].indices, ElementsAre(0, 1, 2, 2, 1, 3, 1, 2, 3));
}

TEST(PlyTest, DropsTheTrianglesOfAStripThatNameABadIndex) {
  for (const char* bad : {"-7", "2.5", "x", "nan", "4", "-1.5", "4294967296"}) {
    const ImportedScene scene = MustImport(
        Header("ascii", std::string(kVertices) +
                            "element tristrips 1\nproperty list int int vertex_indices\n") +
            "0 0 0\n1 0 0\n0 1 0\n1 1 0\n11 0 1 2 " + bad + " 1 2 3 -1 1 2 3\n",
        MeshFormat::kPly);
    // Three triangles go; the strip's turns are still those of its places.
    EXPECT_THAT(scene.objects[0].indices, ElementsAre(0, 1, 2, 1, 2, 3, 1, 2, 3)) << bad;
    EXPECT_EQ(scene.report.faces_bad_index, 3u) << bad;
  }
}

TEST(PlyTest, CountsBadFacesAndNonFiniteVertices) {
  const ImportedScene scene = MustImport(
      Header("ascii",
             std::string(kVertices) + "element face 6\nproperty list uchar int vertex_indices\n") +
          "0 0 0\n1 0 0\n0 1 0\nnan 1 inf\n3 0 1 2\n3 0 1 4\n3 0 1 -1\n2 0 1\n0\n3 0 1 3\n",
      MeshFormat::kPly);
  EXPECT_EQ(scene.report.triangles, 2u);
  EXPECT_EQ(scene.report.faces_bad_index, 2u);
  EXPECT_EQ(scene.report.faces_too_few_corners, 2u);
  EXPECT_EQ(scene.report.non_finite_vertices, 1u);
  EXPECT_EQ(scene.report.non_finite_triangles, 1u);
  EXPECT_TRUE(std::isnan(scene.objects[0].vertices[3].y));
}

TEST(PlyTest, HoldsCountsAgainstTheBytesThatAreThere) {
  const std::string vertices =
      "element vertex 4000000000\nproperty float x\nproperty float y\nproperty float z\n";
  EXPECT_IMPORT_ERROR(
      ImportError(Header("binary_little_endian", vertices) + "abc", MeshFormat::kPly), kDataLoss,
      "promises 4000000000 elements \"vertex\"");
  EXPECT_IMPORT_ERROR(ImportError(Header("ascii", vertices) + "1 2 3", MeshFormat::kPly), kDataLoss,
                      "hold at most");
  const std::string list = "element face 1\nproperty list uint int vertex_indices\n";
  EXPECT_IMPORT_ERROR(
      ImportError(Header("binary_little_endian", list) + Bytes(uint32_t{0xFFFFFFFF}, 1, 2),
                  MeshFormat::kPly),
      kDataLoss, "only 2 values");
  EXPECT_IMPORT_ERROR(ImportError(Header("ascii", list) + "-3 1 2 3", MeshFormat::kPly), kDataLoss,
                      "length -3");
  // Elements of nothing, however many, take no time.
  EXPECT_IMPORT_ERROR(
      ImportError(Header("ascii", "element nothing 9000000000000000000\n"), MeshFormat::kPly),
      kInvalidArgument, "the mesh is empty");
}

TEST(PlyTest, RefusesWhatIsTruncated) {
  const std::string head = Header("ascii", std::string(kVertices) + kFaces);
  const std::string body = "0 0 0 1 0 0 1 1 0 0 1 0 4 0 1 2 3 3 0 1 2";
  EXPECT_TRUE(
      ImportError(head + body, MeshFormat::kPly).ok());  // Line ends are blanks like others.
  EXPECT_EQ(ImportError(head + body.substr(0, body.size() - 2), MeshFormat::kPly).code(),
            absl::StatusCode::kDataLoss);
  EXPECT_IMPORT_ERROR(ImportError(head.substr(0, head.find("property")), MeshFormat::kPly),
                      kDataLoss, "end_header");
}

TEST(PlyTest, WarnsOfWhatComesAfterTheLastElement) {
  const std::string text = Header("ascii", std::string(kVertices) + kFaces) +
                           "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3";
  EXPECT_THAT(MustImport(text + " \r\n\n", MeshFormat::kPly).report.warnings, ElementsAre());
  EXPECT_THAT(MustImport(text + "\n\n3 1 2 3\n", MeshFormat::kPly).report.warnings,
              ElementsAre("8 bytes after the last element were not read"));
  const std::string binary =
      Header("binary_little_endian",
             "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
             "element face 1\nproperty list uchar uchar vertex_indices\n") +
      Bytes(0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f) + std::string("\3\0\1\2", 4);
  EXPECT_THAT(MustImport(binary, MeshFormat::kPly).report.warnings, ElementsAre());
  EXPECT_THAT(MustImport(binary + std::string(3, '\0'), MeshFormat::kPly).report.warnings,
              ElementsAre("3 bytes after the last element were not read"));
}

TEST(PlyTest, RefusesHeadersThatMakeNoSense) {
  const auto error = [](const std::string& elements) {
    return ImportError(Header("ascii", elements), MeshFormat::kPly);
  };
  EXPECT_IMPORT_ERROR(ImportError("plx\n", MeshFormat::kPly), kInvalidArgument,
                      "is not a PLY file");
  EXPECT_IMPORT_ERROR(ImportError("ply\nend_header\n", MeshFormat::kPly), kInvalidArgument,
                      "format");
  EXPECT_IMPORT_ERROR(ImportError(Header("utf8", ""), MeshFormat::kPly), kInvalidArgument,
                      "line 2");
  EXPECT_IMPORT_ERROR(error("element vertex -1\n"), kInvalidArgument, "line 4");
  EXPECT_IMPORT_ERROR(error("element vertex 99999999999999999999\n"), kInvalidArgument, "line 4");
  EXPECT_IMPORT_ERROR(error("property float x\n"), kInvalidArgument, "line 4");
  EXPECT_IMPORT_ERROR(error("element v 1\nproperty list float int i\n"), kInvalidArgument,
                      "line 5");
  EXPECT_IMPORT_ERROR(error("element v 1\nproperty quad x\n"), kInvalidArgument, "line 5");
  EXPECT_IMPORT_ERROR(error("nonsense\n"), kInvalidArgument, "nonsense");
  EXPECT_IMPORT_ERROR(ImportError(Header("ascii", "element vertex 1\nproperty float x\n") + "1\n",
                                  MeshFormat::kPly),
                      kInvalidArgument, "no scalar property \"y\"");
  EXPECT_IMPORT_ERROR(
      ImportError(Header("ascii", "element face 1\nproperty int x\n") + "1\n", MeshFormat::kPly),
      kInvalidArgument, "no list \"vertex_indices\"");
  EXPECT_IMPORT_ERROR(ImportError(Header("ascii", std::string(kVertices) + kVertices) +
                                      "0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0",
                                  MeshFormat::kPly),
                      kInvalidArgument, "two elements");
}

TEST(PlyPointsTest, ReadsPositionsWithOrWithoutFaces) {
  const testing_support::TempDir folder;
  const std::string path = folder.File("points.ply");
  WriteFile(path, Header("ascii", kVertices) + "0 0 0\n1 0 447422.999\nnan 0 0\n3 0 0\n");
  const absl::StatusOr<std::vector<Vec3d>> points = ImportPoints(path);
  ASSERT_TRUE(points.ok()) << points.status();
  ASSERT_EQ(points->size(), 4u);
  EXPECT_EQ((*points)[1], (Vec3d{1, 0, 447422.999}));
  EXPECT_TRUE(std::isnan((*points)[2].y));
  WriteFile(
      path,
      Header("ascii", "element vertex 0\nproperty float x\nproperty float y\nproperty float z\n"));
  EXPECT_IMPORT_ERROR(ImportPoints(path).status(), kInvalidArgument, path + ": holds no point");
  EXPECT_IMPORT_ERROR(ImportPoints(folder.File("none.ply")).status(), kNotFound,
                      "none.ply: no such file");
  EXPECT_IMPORT_ERROR(ImportPoints("points.obj").status(), kInvalidArgument, "points.obj");
  // A byte order mark is no part of the text, as in ImportFile.
  WriteFile(path, "\xEF\xBB\xBF" + Header("ascii", kVertices) + "0 0 0\n1 0 7\n2 0 0\n3 0 0\n");
  const absl::StatusOr<std::vector<Vec3d>> marked = ImportPoints(path);
  ASSERT_TRUE(marked.ok()) << marked.status();
  EXPECT_EQ((*marked)[1], (Vec3d{1, 0, 7}));
}

}  // namespace
}  // namespace sightline
