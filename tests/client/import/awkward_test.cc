// SPDX-License-Identifier: Apache-2.0
//
// Every file of the scenes' folder awkward/, each with what this project has decided to make of it.
#include <string>
#include <vector>

#include "absl/strings/ascii.h"
#include "gtest/gtest.h"
#include "tests/client/import/import_testing.h"
#include "tests/support/scenes.h"

namespace sightline {
namespace {

using testing::ElementsAre;

std::vector<std::string> Names(const ImportedScene& scene) {
  std::vector<std::string> names;
  for (const ObjectInput& object : scene.objects) names.push_back(object.name);
  return names;
}

struct Outcome {
  const char* file;
  const char* decision;  // Why it comes out like this.
  uint64_t triangles = 0;
  uint64_t polygons = 0;
  uint64_t polygons_fanned = 0;
  uint64_t too_few_corners = 0;
  uint64_t bad_index = 0;
  uint64_t non_finite_vertices = 0;
  uint64_t non_finite_triangles = 0;
  uint64_t degenerate = 0;
  uint64_t zero_area = 0;
  uint64_t duplicates = 0;
};

const Outcome kReadable[] = {
    {.file = "test-nan.obj",
     .decision =
         "the four vertices become NaN; the polygon over them stays, for the compiler to judge",
     .triangles = 36,
     .polygons = 18,
     .polygons_fanned = 18,
     .non_finite_vertices = 4,
     .non_finite_triangles = 2},
    {.file = "missing_material_file.obj",
     .decision = "materials are not read, so nothing is missing",
     .triangles = 36,
     .polygons = 18,
     .polygons_fanned = 18},
    {.file = "issue-140-zero-face-idx.obj",
     .decision = "the face with index 0 is dropped, the other stays",
     .triangles = 1,
     .polygons = 2,
     .bad_index = 1},
    {.file = "issue-295-trianguation-failure.obj",
     .decision = "a fan cannot fail",
     .triangles = 28,
     .polygons = 14,
     .polygons_fanned = 14},
    {.file = "issue-319-002.obj",
     .decision = "concave polygons are cut as a fan like any other",
     .triangles = 14,
     .polygons = 3,
     .polygons_fanned = 3,
     .degenerate = 1,
     .zero_area = 1},
    {.file = "negative_indices.obj",
     .decision = "negative indices count back from the face",
     .triangles = 12,
     .polygons = 6,
     .polygons_fanned = 6},
    {.file = "polygonfaces.obj",
     .decision = "`i//` is a corner without normal",
     .triangles = 3,
     .polygons = 1,
     .polygons_fanned = 1},
    {.file = "notenoughindices.obj",
     .decision = "the face of two corners is dropped",
     .triangles = 1,
     .polygons = 2,
     .too_few_corners = 1},
    {.file = "wallhole.obj",
     .decision = "continued lines are one face; a fan cuts concave ones wrongly, as stated",
     .triangles = 66,
     .polygons = 13,
     .polygons_fanned = 13,
     .zero_area = 11,
     .duplicates = 1},
    {.file = "joined_tetrahedra.obj",
     .decision = "both copies of the doubled face stay",
     .triangles = 8,
     .polygons = 8,
     .duplicates = 1},
    {.file = "not_convex.obj",
     .decision = "non-manifold edges are no matter",
     .triangles = 96,
     .polygons = 96},
    {.file = "soup.stl",
     .decision = "binary without a word in its header",
     .triangles = 100,
     .polygons = 100},
    {.file = "featuretype.STL.xz",
     .decision = "extensions count in either case",
     .triangles = 3476,
     .polygons = 3476},
    {.file = "two_objects_mixed_case_names.stl",
     .decision = "each solid is an object",
     .triangles = 24,
     .polygons = 24},
    {.file = "whitespace.off",
     .decision = "the keyword may run into the counts",
     .triangles = 12,
     .polygons = 6,
     .polygons_fanned = 6},
    {.file = "flowerBox.obj.xz",
     .decision = "duplicates stay and are counted",
     .triangles = 60886,
     .polygons = 34071,
     .polygons_fanned = 26815,
     .degenerate = 64,
     .zero_area = 64,
     .duplicates = 20250},
};

class AwkwardFileTest : public testing::TestWithParam<Outcome> {};

TEST_P(AwkwardFileTest, IsReadAsDecided) {
  const Outcome& outcome = GetParam();
  SIGHTLINE_SCENE_OR_SKIP(path, std::string("awkward/") + outcome.file);
  const absl::StatusOr<ImportedScene> scene = ImportFile(path);
  ASSERT_TRUE(scene.ok()) << scene.status();
  SCOPED_TRACE(outcome.decision);
  const ImportReport& report = scene->report;
  EXPECT_EQ(report.triangles, outcome.triangles);
  EXPECT_EQ(report.polygons, outcome.polygons);
  EXPECT_EQ(report.polygons_fanned, outcome.polygons_fanned);
  EXPECT_EQ(report.faces_too_few_corners, outcome.too_few_corners);
  EXPECT_EQ(report.faces_bad_index, outcome.bad_index);
  EXPECT_EQ(report.non_finite_vertices, outcome.non_finite_vertices);
  EXPECT_EQ(report.non_finite_triangles, outcome.non_finite_triangles);
  EXPECT_EQ(report.degenerate_triangles, outcome.degenerate);
  EXPECT_EQ(report.zero_area_triangles, outcome.zero_area);
  EXPECT_EQ(report.duplicate_triangles, outcome.duplicates);
  EXPECT_TRUE(report.warnings.empty()) << report.warnings[0];
}

std::string TestName(const std::string& file) {
  std::string name;
  for (const char c : file) name += absl::ascii_isalnum(static_cast<unsigned char>(c)) ? c : '_';
  return name;
}

INSTANTIATE_TEST_SUITE_P(Awkward, AwkwardFileTest, testing::ValuesIn(kReadable),
                         [](const auto& info) { return TestName(info.param.file); });

struct Refusal {
  const char* file;
  const char* words;
};

const Refusal kEmpty[] = {
    {"invalid-face-definition.obj",
     "the mesh is empty: no triangle in it; 2 faces of fewer than three corners"},
    {"invalid-relative-vertex-index.obj",
     "the mesh is empty: no triangle in it; 1 faces with an index out of range"},
    {"points_emptyface.ply", "the mesh is empty"},
    {"empty.stl", "the mesh is empty"},
};

class EmptyFileTest : public testing::TestWithParam<Refusal> {};

TEST_P(EmptyFileTest, IsRefusedByNameAndReason) {
  SIGHTLINE_SCENE_OR_SKIP(path, std::string("awkward/") + GetParam().file);
  EXPECT_IMPORT_ERROR(ImportFile(path).status(), kInvalidArgument, path + ": " + GetParam().words);
}

INSTANTIATE_TEST_SUITE_P(Awkward, EmptyFileTest, testing::ValuesIn(kEmpty),
                         [](const auto& info) { return TestName(info.param.file); });

TEST(AwkwardNamesTest, KeepsTheNamesOfSolids) {
  SIGHTLINE_SCENE_OR_SKIP(path, "awkward/two_objects_mixed_case_names.stl");
  const absl::StatusOr<ImportedScene> scene = ImportFile(path);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(Names(*scene), ElementsAre("CubeExportedFromCAD", testing::_));
}

TEST(AwkwardPointsTest, ReadsThePointCloud) {
  SIGHTLINE_SCENE_OR_SKIP(path, "awkward/points_emptyface.ply");
  const absl::StatusOr<std::vector<Vec3d>> points = ImportPoints(path);
  ASSERT_TRUE(points.ok()) << points.status();
  EXPECT_EQ(points->size(), 1024u);
  EXPECT_EQ((*points)[0], (Vec3d{-86.01312256, 39.38998413, -32.02719879}));
}

}  // namespace
}  // namespace sightline
