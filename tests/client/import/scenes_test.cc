// SPDX-License-Identifier: Apache-2.0
//
// Every real scene, against the table of SCENES.md: triangles, the box of the vertices in use, and
// the defects that the table counts as this project does.
#include "tests/support/scenes.h"

#include <cmath>
#include <string>

#include "gtest/gtest.h"
#include "tests/client/import/import_testing.h"

namespace sightline {
namespace {

using import_testing::SameBits;
using import_testing::WorldBox;

struct Expected {
  const char* file;
  uint64_t triangles;
  Vec3d lo, hi;
  uint64_t polygons_fanned;
  uint64_t duplicates;
  uint64_t zero_area;
  uint64_t skipped;
  size_t objects;
};

// The table prints boxes to 6 significant digits or more: half a unit of the sixth.
void ExpectNear(double value, double printed) {
  const double unit =
      printed == 0 ? 0 : std::pow(10, std::floor(std::log10(std::abs(printed))) - 5);
  EXPECT_NEAR(value, printed, 0.51 * unit);
}

// Where these differ from the table. city_delft: 4 without area, the table 2; it measures area
// against the edges' length, mesh_checks.h against what rounding of coordinates near 447,000
// leaves. hotel_room: its LINES primitive has 41,330 corners, 20,665 segments; the table says
// 20,664.
const Expected kScenes[] = {
    {"bunny.ply.xz",
     69451,
     {-0.0946899, 0.0329874, -0.0618736},
     {0.0610091, 0.187321, 0.0587997},
     0,
     0,
     0,
     0,
     1},
    {"buddha_100k.obj.xz",
     100000,
     {-0.460955, -1.00222, -0.323877},
     {0.35222, 0.9775, 0.490175},
     0,
     24,
     0,
     0,
     1},
    {"cornell_box.obj", 36, {-1.02, 0, -1.04}, {1, 1.99, 0.99}, 18, 4, 0, 0, 7},
    {"sponza_crytek.obj.xz",
     279163,
     {-1920.946, -126.442, -1105.426},
     {1799.908, 1429.433, 1182.807},
     0,
     70,
     1,
     0,
     382},
    {"kitchen.ply.xz",
     1443509,
     {-3.1387, -0.020776, -3.18371},
     {3.77741, 3.3639, 5.47059},
     0,
     6,
     219,
     0,
     1},
    {"hotel_room.glb.xz",
     99029,
     {6791.5, -66.1975, -11129.199},
     {13274.5, 2130.74, -1134.32},
     0,
     120,
     0,
     20665,
     1},
    {"foliage_japanese_maple.obj.xz",
     198396,
     {-324.62, -0.02, -273.35},
     {465.71, 699.94, 423.81},
     32382,
     5500,
     0,
     6,
     2},
    {"foliage_pine.obj.xz",
     108810,
     {-186.24, 0, -203.02},
     {188.29, 545.68, 175.89},
     49900,
     0,
     0,
     0,
     2},
    {"hair_bob.obj.xz",
     8474,
     {-1.1278, 5.7158, -0.7948},
     {0.9596, 8.0534, 1.6744},
     4237,
     313,
     0,
     0,
     1},
    {"hair_braid.obj.xz",
     5518,
     {-0.9393, 2.0923, -1.025},
     {0.9174, 7.966, 1.514},
     2759,
     0,
     0,
     0,
     1},
    {"city_delft.obj.xz",
     36271,
     {84616.468, 447422.999, -0.452},
     {85140.839, 447750.636, 16.846},
     0,
     10,
     4,
     0,
     570},
    {"terrain_utm.stl.xz",
     21186,
     {581311, 4785270, 937.3},
     {582301, 4786340, 1044.6},
     0,
     0,
     0,
     0,
     1},
};

class RealSceneTest : public testing::TestWithParam<Expected> {};

TEST_P(RealSceneTest, MatchesTheTable) {
  const Expected& expected = GetParam();
  SIGHTLINE_SCENE_OR_SKIP(path, expected.file);
  const absl::StatusOr<ImportedScene> scene = ImportFile(path);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const ImportReport& report = scene->report;
  EXPECT_EQ(report.triangles, expected.triangles);
  EXPECT_EQ(report.polygons_fanned, expected.polygons_fanned);
  EXPECT_EQ(report.duplicate_triangles, expected.duplicates);
  EXPECT_EQ(report.zero_area_triangles, expected.zero_area);
  EXPECT_EQ(report.skipped_primitives, expected.skipped);
  EXPECT_EQ(report.faces_bad_index + report.faces_too_few_corners + report.non_finite_vertices, 0u);
  EXPECT_EQ(scene->objects.size(), expected.objects);
  const Box3d box = WorldBox(*scene);
  for (int axis = 0; axis < 3; ++axis) {
    ExpectNear(box.lo[axis], expected.lo[axis]);
    ExpectNear(box.hi[axis], expected.hi[axis]);
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, RealSceneTest, testing::ValuesIn(kScenes), [](const auto& info) {
  const std::string file = info.param.file;
  return file.substr(0, file.find('.'));
});

TEST(RealSceneTest, KeepsTheMillimetresOfDelft) {
  SIGHTLINE_SCENE_OR_SKIP(path, "city_delft.obj.xz");
  const absl::StatusOr<ImportedScene> scene = ImportFile(path);
  ASSERT_TRUE(scene.ok()) << scene.status();
  // Every coordinate is a decimal of three places: the nearest double to a whole number of
  // millimetres.
  for (const ObjectInput& object : scene->objects) {
    for (const Vec3d& v : object.vertices) {
      for (int axis = 0; axis < 3; ++axis) {
        ASSERT_EQ(v[axis], std::round(v[axis] * 1000) / 1000);
      }
    }
  }
  EXPECT_EQ(WorldBox(*scene).lo.y, 447422.999);
}

TEST(RealSceneTest, GivesTheSameBytesTwice) {
  for (const char* file :
       {"cornell_box.obj", "hotel_room.glb.xz", "terrain_utm.stl.xz", "bunny.ply.xz"}) {
    SIGHTLINE_SCENE_OR_SKIP(path, file);
    const absl::StatusOr<ImportedScene> one = ImportFile(path);
    const absl::StatusOr<ImportedScene> two = ImportFile(path);
    ASSERT_TRUE(one.ok() && two.ok()) << file;
    EXPECT_TRUE(SameBits(*one, *two)) << file;
  }
}

}  // namespace
}  // namespace sightline
