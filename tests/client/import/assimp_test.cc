// SPDX-License-Identifier: Apache-2.0
#include <string>

#include "client/import/assimp_reader.h"
#include "gtest/gtest.h"
#include "tests/client/import/import_testing.h"
#include "tests/support/random.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using import_testing::Bytes;
using import_testing::Gzip;
using import_testing::ImportError;
using import_testing::MustImport;
using import_testing::WorldBox;
using import_testing::WriteFile;

// One chunk of a 3DS file: its number, its size, its data.
std::string Chunk(uint16_t id, const std::string& data) {
  return Bytes(id, static_cast<uint32_t>(data.size() + 6)) + data;
}

// A tetrahedron named "Tetra".
std::string ThreeDs() {
  const std::string vertices = Chunk(0x4110, Bytes(uint16_t{4}, 0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f,
                                                   1.f, 0.f, 0.f, 0.f, 447422.999f));
  const std::string faces =
      Chunk(0x4120, Bytes(uint16_t{4}) + Bytes(uint16_t{0}, uint16_t{1}, uint16_t{2}, uint16_t{7}) +
                        Bytes(uint16_t{0}, uint16_t{1}, uint16_t{3}, uint16_t{7}) +
                        Bytes(uint16_t{1}, uint16_t{2}, uint16_t{3}, uint16_t{7}) +
                        Bytes(uint16_t{2}, uint16_t{0}, uint16_t{3}, uint16_t{7}));
  const std::string object =
      Chunk(0x4000, std::string("Tetra\0", 6) + Chunk(0x4100, vertices + faces));
  // Names of nodes are in the keyframer's part: name, flags, parent.
  const std::string node =
      Chunk(0xB010, std::string("Tetra\0", 6) + Bytes(uint16_t{0}, uint16_t{0}, uint16_t{0xFFFF}));
  return Chunk(0x4D4D, Chunk(0x0002, Bytes(3u)) + Chunk(0x3D3D, object) +
                           Chunk(0xB000, Chunk(0xB002, node)));
}

constexpr char kCollada[] = R"(<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g" name="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>4</vcount><p>0 1 2 3</p></polylist>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="wall" name="wall">
<translate>10 20 30</translate>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene>
</COLLADA>)";

ImportOptions For(const std::string& extension) {
  ImportOptions options;
  options.extension = extension;
  return options;
}

TEST(AssimpTest, KnowsItsFormatsByExtension) {
  for (const char* extension : {"3ds", "dae", "fbx", "x", "dxf", "lwo"}) {
    EXPECT_TRUE(AssimpKnows(extension)) << extension;
  }
  for (const char* extension : {"", "txt", "png", "doc"}) EXPECT_FALSE(AssimpKnows(extension));
}

TEST(AssimpTest, Reads3dsAndSaysThatFloatsLoseDigits) {
  const ImportedScene scene = MustImport(ThreeDs(), MeshFormat::kOther, For("3ds"));
  EXPECT_EQ(scene.report.format, "assimp 3ds");
  EXPECT_EQ(scene.report.triangles, 4u);
  ASSERT_EQ(scene.objects.size(), 1u);
  EXPECT_EQ(scene.objects[0].name, "Tetra");
  EXPECT_TRUE(scene.report.float_precision_loss);
  EXPECT_THAT(scene.report.warnings,
              testing::ElementsAre(testing::HasSubstr("447423, is good to about 0.027")));
}

TEST(AssimpTest, PlacesNodesAndFansPolygons) {
  const ImportedScene scene = MustImport(kCollada, MeshFormat::kOther, For("dae"));
  EXPECT_EQ(scene.report.triangles, 2u);
  EXPECT_EQ(scene.report.polygons_fanned, 1u);
  const Box3d box = WorldBox(scene);
  EXPECT_EQ(box.lo, (Vec3d{10, 20, 30}));
  EXPECT_EQ(box.hi, (Vec3d{11, 21, 30}));
}

TEST(AssimpTest, ReadsCompressedFiles) {
  const testing_support::TempDir folder;
  WriteFile(folder.File("part.3DS.gz"), Gzip(ThreeDs()));
  const absl::StatusOr<ImportedScene> scene = ImportFile(folder.File("part.3DS.gz"));
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->report.triangles, 4u);
}

TEST(AssimpTest, ReportsWhatItCannotRead) {
  EXPECT_IMPORT_ERROR(ImportError("this is no 3ds file", MeshFormat::kOther, For("3ds")),
                      kInvalidArgument, "assimp cannot read it");
  EXPECT_IMPORT_ERROR(ImportError("<COLLADA", MeshFormat::kOther, For("dae")), kInvalidArgument,
                      "assimp cannot read it");
}

TEST(AssimpTest, KeepsToTheTriangleLimit) {
  ImportOptions options = For("3ds");
  options.max_triangles = 3;
  EXPECT_IMPORT_ERROR(ImportError(ThreeDs(), MeshFormat::kOther, options), kResourceExhausted,
                      "max_triangles, 3");
}

TEST(AssimpTest, SurvivesDamagedFiles) {
  testing_support::TestRng rng;
  const std::string good = ThreeDs();
  for (int i = 0; i < 60; ++i) {
    std::string bytes = good;
    for (int flips = 0; flips < 3; ++flips)
      bytes[rng.Below(bytes.size())] = static_cast<char>(rng());
    if (rng.Chance(0.3)) bytes.resize(rng.Below(bytes.size()) + 1);
    const absl::StatusOr<ImportedScene> scene = ImportBytes(bytes, MeshFormat::kOther, For("3ds"));
    if (!scene.ok()) continue;
    for (const ObjectInput& object : scene->objects) {
      for (const uint32_t index : object.indices) ASSERT_LT(index, object.vertices.size());
    }
  }
}

}  // namespace
}  // namespace sightline
