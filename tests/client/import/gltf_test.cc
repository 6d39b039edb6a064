// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "client/import/gltf_json.h"
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

// A document under construction: one buffer, a view and an accessor for each array that is added.
class GltfBuilder {
 public:
  // Returns the accessor's number. `extra` goes into the accessor: `,"normalized":true`.
  int Add(const std::string& data, int component, int count, const std::string& type,
          const std::string& extra = "", int stride = 0) {
    while (buffer_.size() % 4 != 0) buffer_.push_back('\0');
    views_.push_back(absl::StrCat("{\"buffer\":0,\"byteOffset\":", buffer_.size(),
                                  ",\"byteLength\":", data.size(),
                                  stride > 0 ? absl::StrCat(",\"byteStride\":", stride) : "", "}"));
    buffer_ += data;
    accessors_.push_back(absl::StrCat("{\"bufferView\":", views_.size() - 1,
                                      ",\"componentType\":", component, ",\"count\":", count,
                                      ",\"type\":\"", type, "\"", extra, "}"));
    return static_cast<int>(accessors_.size()) - 1;
  }
  int AddPositions(const std::vector<float>& values) {
    std::string data;
    for (const float v : values) data += Bytes(v);
    return Add(data, 5126, static_cast<int>(values.size() / 3), "VEC3");
  }
  int AddIndices(const std::vector<uint16_t>& values) {
    std::string data;
    for (const uint16_t v : values) data += Bytes(v);
    return Add(data, 5123, static_cast<int>(values.size()), "SCALAR");
  }
  void AddRawAccessor(const std::string& json) { accessors_.push_back(json); }
  void AddMesh(const std::string& primitives, const std::string& name = "") {
    meshes_.push_back(absl::StrCat("{",
                                   name.empty() ? "" : absl::StrCat("\"name\":\"", name, "\","),
                                   "\"primitives\":[", primitives, "]}"));
  }
  std::string nodes = "{\"mesh\":0}";
  std::string scenes = "{\"nodes\":[0]}";
  std::string extra;  // Members of the document: `,"scene":1`.

  const std::string& buffer() const { return buffer_; }

  std::string Json(const std::string& uri) const {
    return absl::StrCat(
        "{\"asset\":{\"version\":\"2.0\"}", extra, scenes.empty() ? "" : ",\"scenes\":[", scenes,
        scenes.empty() ? "" : "]", nodes.empty() ? "" : ",\"nodes\":[", nodes,
        nodes.empty() ? "" : "]", ",\"meshes\":[", absl::StrJoin(meshes_, ","), "],\"accessors\":[",
        absl::StrJoin(accessors_, ","), "],\"bufferViews\":[", absl::StrJoin(views_, ","),
        "],\"buffers\":[{\"byteLength\":", buffer_.size(),
        uri.empty() ? "" : absl::StrCat(",\"uri\":\"", uri, "\""), "}]}");
  }
  std::string Gltf() const {
    return Json("data:application/octet-stream;base64," + absl::Base64Escape(buffer_));
  }
  std::string Glb() const {
    std::string json = Json("");
    while (json.size() % 4 != 0) json.push_back(' ');
    std::string bin = buffer_;
    while (bin.size() % 4 != 0) bin.push_back('\0');
    const auto size = [](const std::string& s) { return static_cast<uint32_t>(s.size()); };
    const std::string chunks =
        Bytes(size(json), 0x4E4F534Au) + json + Bytes(size(bin), 0x004E4942u) + bin;
    return "glTF" + Bytes(2u, size(chunks) + 12) + chunks;
  }

 private:
  std::string buffer_;
  std::vector<std::string> views_, accessors_, meshes_;
};

const std::vector<float> kSquare = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};

// The square as two triangles.
GltfBuilder Square() {
  GltfBuilder b;
  b.AddPositions(kSquare);
  b.AddIndices({0, 1, 2, 0, 2, 3});
  b.AddMesh("{\"attributes\":{\"POSITION\":0},\"indices\":1}", "square");
  return b;
}

TEST(GltfTest, ReadsTheTextAndTheBinaryContainerAlike) {
  const GltfBuilder b = Square();
  ImportedScene text = MustImport(b.Gltf(), MeshFormat::kGltf);
  const ImportedScene binary = MustImport(b.Glb(), MeshFormat::kGlb);
  ASSERT_EQ(text.objects.size(), 1u);
  EXPECT_EQ(text.objects[0].name, "square");
  EXPECT_THAT(text.objects[0].indices, ElementsAre(0, 1, 2, 0, 2, 3));
  EXPECT_EQ(text.objects[0].vertices[2], (Vec3d{1, 1, 0}));
  EXPECT_EQ(text.report.format, "gltf");
  text.report.format = "glb";
  EXPECT_TRUE(import_testing::SameBits(text, binary));
}

TEST(GltfTest, PlacesNodesInDoubles) {
  GltfBuilder b = Square();
  b.nodes =
      "{\"name\":\"root\",\"children\":[1,2],\"translation\":[84616.468,447422.999,0]},"
      "{\"name\":\"turned\",\"mesh\":0,\"rotation\":[0,0,0.70710678,0.70710678],\"scale\":[2,3,4]},"
      "{\"mesh\":0,\"matrix\":[0,1,0,0,-1,0,0,0,0,0,1,0,0.1,0.2,0.3,1]}";
  const ImportedScene scene = MustImport(b.Gltf(), MeshFormat::kGltf);
  ASSERT_EQ(scene.objects.size(), 2u);
  EXPECT_EQ(scene.objects[0].name, "turned");
  EXPECT_EQ(scene.objects[1].name, "square");
  EXPECT_EQ(scene.objects[1].transform.Apply({0, 0, 0}),
            (Vec3d{84616.468 + 0.1, 447422.999 + 0.2, 0.3}));
  EXPECT_EQ(scene.objects[1].transform.Apply({1, 0, 0}),
            (Vec3d{84616.468 + 0.1, 1 + (447422.999 + 0.2), 0.3}));
  // A quarter turn after the scale: x to 2y, y to -3x. The quaternion's eight digits do not show,
  // since only its direction counts.
  const std::array<double, 12>& m = scene.objects[0].transform.m;
  EXPECT_EQ(m[4], 2);
  EXPECT_EQ(m[1], -3);
  EXPECT_EQ(m[0], 0);
  EXPECT_EQ(m[10], 4);
  EXPECT_EQ(m[7], 447422.999);
}

TEST(GltfTest, TurnsTheTrianglesOfMirroredNodes) {
  GltfBuilder b = Square();
  b.nodes = "{\"mesh\":0,\"scale\":[-1,1,1]}";
  EXPECT_THAT(MustImport(b.Gltf(), MeshFormat::kGltf).objects[0].indices,
              ElementsAre(0, 2, 1, 0, 3, 2));
}

TEST(GltfTest, ChoosesTheScene) {
  GltfBuilder b = Square();
  b.nodes =
      "{\"name\":\"a\",\"mesh\":0},{\"name\":\"b\",\"mesh\":0,\"children\":[2]},{\"name\":\"c\","
      "\"mesh\":0}";
  b.scenes = "{\"nodes\":[0]},{\"nodes\":[1]}";
  EXPECT_EQ(MustImport(b.Gltf(), MeshFormat::kGltf).objects[0].name, "a");
  b.extra = ",\"scene\":1";
  const ImportedScene second = MustImport(b.Gltf(), MeshFormat::kGltf);
  ASSERT_EQ(second.objects.size(), 2u);
  EXPECT_EQ(second.objects[0].name, "b");
  EXPECT_EQ(second.objects[1].name, "c");
  EXPECT_THAT(second.report.warnings, ElementsAre("scene 1 of 2 was read"));
  b.extra = ",\"scene\":2";
  EXPECT_IMPORT_ERROR(ImportError(b.Gltf(), MeshFormat::kGltf), kInvalidArgument,
                      "scene is 2 of 2");
  b.extra = b.scenes = "";
  EXPECT_EQ(MustImport(b.Gltf(), MeshFormat::kGltf).objects.size(), 3u);
  b.nodes = "";
  EXPECT_EQ(MustImport(b.Gltf(), MeshFormat::kGltf).objects[0].name, "square");
}

TEST(GltfTest, ReadsStripsFansAndUnindexedCorners) {
  GltfBuilder b;
  b.AddPositions(kSquare);
  b.AddMesh(
      "{\"attributes\":{\"POSITION\":0},\"mode\":5},{\"attributes\":{\"POSITION\":0},\"mode\":6},"
      "{\"attributes\":{\"POSITION\":0},\"mode\":4}");
  const ImportedScene scene = MustImport(b.Gltf(), MeshFormat::kGltf);
  EXPECT_EQ(scene.objects[0].name, "node-0");
  // Vertices in order of first use: the strip's 0 1 2 3 (turned: 0 1 2, 2 1 3 by corners 1, 3, 2).
  std::vector<Vec3d> corners;
  for (const uint32_t i : scene.objects[0].indices) corners.push_back(scene.objects[0].vertices[i]);
  const Vec3d v[] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  EXPECT_THAT(corners, ElementsAre(v[0], v[1], v[2], v[1], v[3], v[2],  // Strip.
                                   v[0], v[1], v[2], v[0], v[2], v[3],  // Fan.
                                   v[0], v[1], v[2]));  // List, its fourth corner over.
  EXPECT_THAT(scene.report.warnings, ElementsAre("a triangle list has 1 corners too many"));
}

TEST(GltfTest, SkipsPointsAndLinesWithACount) {
  GltfBuilder b = Square();
  const std::string with = "{\"attributes\":{\"POSITION\":0},\"mode\":";
  b.AddMesh(with + "0}," + with + "1}," + with + "2}," + with + "3}");
  b.nodes = "{\"mesh\":0},{\"mesh\":1}";
  b.scenes = "{\"nodes\":[0,1]}";
  const ImportedScene scene = MustImport(b.Gltf(), MeshFormat::kGltf);
  EXPECT_EQ(scene.objects.size(), 1u);
  EXPECT_EQ(scene.report.skipped_primitives, 4u + 2u + 4u + 3u);
}

TEST(GltfTest, ReadsEveryTypeOfIndex) {
  for (const int component : {5121, 5123, 5125}) {
    GltfBuilder b;
    b.AddPositions(kSquare);
    std::string data;
    for (const uint32_t i : {0u, 1u, 3u}) {
      data += component == 5121   ? Bytes(uint8_t(i))
              : component == 5123 ? Bytes(uint16_t(i))
                                  : Bytes(i);
    }
    b.Add(data, component, 3, "SCALAR");
    b.AddMesh("{\"attributes\":{\"POSITION\":0},\"indices\":1}");
    const ImportedScene scene = MustImport(b.Gltf(), MeshFormat::kGltf);
    EXPECT_EQ(scene.objects[0].vertices[2], (Vec3d{0, 1, 0})) << component;
  }
}

TEST(GltfTest, ReadsEveryTypeOfPosition) {
  const auto last = [](int component, const std::string& data, const std::string& extra,
                       int stride) {
    GltfBuilder b;
    b.Add(data, component, 3, "VEC3", extra, stride);
    b.AddMesh("{\"attributes\":{\"POSITION\":0}}");
    b.extra = ",\"extensionsRequired\":[\"KHR_mesh_quantization\"]";
    const ImportedScene scene = MustImport(b.Gltf(), MeshFormat::kGltf);
    return scene.objects.empty() ? Vec3d{} : scene.objects[0].vertices[2];
  };
  const auto bytes = [](int8_t x, int8_t y, int8_t z) { return Bytes(x, y, z, int8_t{99}); };
  const std::string signed_bytes = bytes(0, 0, 0) + bytes(1, 0, 0) + bytes(-128, 127, 64);
  EXPECT_EQ(last(5120, signed_bytes, "", 4), (Vec3d{-128, 127, 64}));
  EXPECT_EQ(last(5120, signed_bytes, ",\"normalized\":true", 4), (Vec3d{-1, 1, 64.0 / 127}));
  EXPECT_EQ(last(5121, signed_bytes, "", 4), (Vec3d{128, 127, 64}));
  EXPECT_EQ(last(5121, signed_bytes, ",\"normalized\":true", 4),
            (Vec3d{128.0 / 255, 127.0 / 255, 64.0 / 255}));
  const auto shorts = [](int16_t x, int16_t y, int16_t z) { return Bytes(x, y, z, int16_t{99}); };
  const std::string signed_shorts = shorts(0, 0, 0) + shorts(1, 0, 0) + shorts(-32768, 32767, 7);
  EXPECT_EQ(last(5122, signed_shorts, "", 8), (Vec3d{-32768, 32767, 7}));
  EXPECT_EQ(last(5122, signed_shorts, ",\"normalized\":true", 8), (Vec3d{-1, 1, 7.0 / 32767}));
  EXPECT_EQ(last(5123, signed_shorts, ",\"normalized\":true", 8),
            (Vec3d{32768.0 / 65535, 32767.0 / 65535, 7.0 / 65535}));
  const std::string doubles = Bytes(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 447422.999, 0.0);
  EXPECT_EQ(last(5130, doubles, "", 0), (Vec3d{1, 447422.999, 0}));
}

TEST(GltfTest, ReadsSparseAccessors) {
  GltfBuilder b;
  const int base = b.AddPositions(kSquare);
  b.AddIndices({1, 3});
  b.AddPositions({7, 8, 9, 4, 5, 6});
  const std::string sparse =
      "\"sparse\":{\"count\":2,\"indices\":{\"bufferView\":1,\"componentType\":5123},"
      "\"values\":{\"bufferView\":2}}}";
  b.AddRawAccessor("{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"," +
                   sparse);
  b.AddRawAccessor("{\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"," + sparse);
  b.AddMesh(
      "{\"attributes\":{\"POSITION\":3},\"mode\":6},{\"attributes\":{\"POSITION\":4},\"mode\":6}");
  EXPECT_EQ(base, 0);
  const ImportedScene scene = MustImport(b.Gltf(), MeshFormat::kGltf);
  EXPECT_THAT(
      scene.objects[0].vertices,
      ElementsAre(Vec3d{0, 0, 0}, Vec3d{7, 8, 9}, Vec3d{1, 1, 0}, Vec3d{4, 5, 6},    // On a base.
                  Vec3d{0, 0, 0}, Vec3d{7, 8, 9}, Vec3d{0, 0, 0}, Vec3d{4, 5, 6}));  // On zeros.
}

TEST(GltfTest, CountsBadIndicesAndNonFiniteVertices) {
  GltfBuilder b;
  std::vector<float> positions = kSquare;
  positions[4] = std::numeric_limits<float>::quiet_NaN();
  b.AddPositions(positions);
  b.AddIndices({0, 1, 2, 0, 2, 4, 0, 2, 3});
  b.AddMesh("{\"attributes\":{\"POSITION\":0},\"indices\":1}");
  const ImportedScene scene = MustImport(b.Gltf(), MeshFormat::kGltf);
  EXPECT_EQ(scene.report.triangles, 2u);
  EXPECT_EQ(scene.report.faces_bad_index, 1u);
  EXPECT_EQ(scene.report.non_finite_vertices, 1u);
  EXPECT_EQ(scene.report.non_finite_triangles, 1u);
}

TEST(GltfTest, WarnsOfWhatIsNotApplied) {
  GltfBuilder b = Square();
  b.nodes = "{\"mesh\":0,\"skin\":0,\"extensions\":{\"EXT_mesh_gpu_instancing\":{}}}";
  EXPECT_EQ(MustImport(b.Gltf(), MeshFormat::kGltf).report.warnings.size(), 2u);
}

TEST(GltfTest, RefusesWhatReachesOutOfItsPlace) {
  const std::string good = Square().Gltf();
  const auto with = [&good](const std::string& from, const std::string& to) {
    EXPECT_NE(good.find(from), std::string::npos) << from;
    return ImportError(absl::StrReplaceAll(good, {{from, to}}), MeshFormat::kGltf);
  };
  EXPECT_IMPORT_ERROR(with("\"count\":4", "\"count\":5"), kInvalidArgument,
                      "accessor 0 claims 5 elements");
  EXPECT_IMPORT_ERROR(with("\"count\":6", "\"count\":9007199254740992"), kInvalidArgument,
                      "accessor 1 claims");
  EXPECT_IMPORT_ERROR(with("\"count\":4", "\"byteOffset\":9007199254740992,\"count\":4"),
                      kInvalidArgument, "accessor 0 claims");
  EXPECT_IMPORT_ERROR(with("\"byteOffset\":48", "\"byteOffset\":52"), kInvalidArgument,
                      "past the end");
  EXPECT_IMPORT_ERROR(with("\"byteOffset\":48", "\"byteOffset\":9007199254740992"),
                      kInvalidArgument, "past the end");
  EXPECT_IMPORT_ERROR(with("\"bufferView\":0", "\"bufferView\":7"), kInvalidArgument,
                      "bufferView 7 of 2");
  EXPECT_IMPORT_ERROR(with("\"buffer\":0", "\"buffer\":1"), kInvalidArgument, "buffer 1 of 1");
  EXPECT_IMPORT_ERROR(with("\"byteLength\":48", "\"byteLength\":48,\"byteStride\":8"),
                      kInvalidArgument, "stride 8");
  EXPECT_IMPORT_ERROR(with("\"POSITION\":0", "\"POSITION\":2"), kInvalidArgument,
                      "accessor 2 of 2");
  EXPECT_IMPORT_ERROR(with("\"POSITION\":0", "\"POSITION\":1"), kInvalidArgument,
                      "used for positions");
  EXPECT_IMPORT_ERROR(with("\"indices\":1", "\"indices\":0"), kInvalidArgument, "used for indices");
  EXPECT_IMPORT_ERROR(with("\"POSITION\":0", "\"NORMAL\":0"), kInvalidArgument,
                      "without positions");
  EXPECT_IMPORT_ERROR(with("{\"mesh\":0}", "{\"mesh\":1}"), kInvalidArgument, "mesh 1 of 1");
  EXPECT_IMPORT_ERROR(with("{\"nodes\":[0]}", "{\"nodes\":[1]}"), kInvalidArgument, "node 1 of 1");
  EXPECT_IMPORT_ERROR(with("{\"mesh\":0}", "{\"mesh\":0,\"children\":[0]}"), kInvalidArgument,
                      "its own ancestor");
  EXPECT_IMPORT_ERROR(with("{\"mesh\":0}", "{\"mesh\":0,\"rotation\":[0,0,0,0]}"), kInvalidArgument,
                      "rotation");
  EXPECT_IMPORT_ERROR(with("{\"mesh\":0}", "{\"mesh\":0,\"scale\":[1,2]}"), kInvalidArgument,
                      "nodes[0].scale is no list of 3 numbers");
  EXPECT_IMPORT_ERROR(with("{\"mesh\":0}", "{\"mesh\":-1}"), kInvalidArgument,
                      "nodes[0].mesh is no whole number");
  EXPECT_IMPORT_ERROR(with("\"componentType\":5126", "\"componentType\":5124"), kInvalidArgument,
                      "accessor 0 has a type");
  EXPECT_IMPORT_ERROR(with("\"byteLength\":60,\"uri\"", "\"byteLength\":9007199254740992,\"uri\""),
                      kResourceExhausted, "max_file_bytes");
  EXPECT_IMPORT_ERROR(with("\"byteLength\":60,\"uri\"", "\"byteLength\":0,\"uri\""),
                      kInvalidArgument, "buffers[0] has a byteLength of 0");
  EXPECT_IMPORT_ERROR(with("\"version\":\"2.0\"", "\"version\":\"1.0\""), kUnimplemented,
                      "version 2");
  EXPECT_IMPORT_ERROR(with("\"asset\"", "\"asse\""), kInvalidArgument, "no glTF file");
  EXPECT_IMPORT_ERROR(
      with("\"asset\"", "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"],\"asset\""),
      kUnimplemented, "KHR_draco_mesh_compression");
  EXPECT_IMPORT_ERROR(ImportError(good.substr(0, good.size() / 2), MeshFormat::kGltf),
                      kInvalidArgument, "JSON is malformed");
}

TEST(GltfTest, RefusesCyclesOfNodes) {
  GltfBuilder b = Square();
  b.nodes = "{\"children\":[1]},{\"children\":[2]},{\"mesh\":0,\"children\":[1]}";
  EXPECT_IMPORT_ERROR(ImportError(b.Gltf(), MeshFormat::kGltf), kInvalidArgument,
                      "its own ancestor");
  b.scenes = "";
  b.nodes = "{\"children\":[1]},{\"mesh\":0,\"children\":[0]}";
  EXPECT_IMPORT_ERROR(ImportError(b.Gltf(), MeshFormat::kGltf), kInvalidArgument,
                      "another's child");
}

TEST(GltfTest, ReadsDeepNodeTrees) {
  GltfBuilder b = Square();
  b.nodes = "";
  constexpr int kDepth = 20000;
  for (int i = 0; i + 1 < kDepth; ++i) b.nodes += absl::StrCat("{\"children\":[", i + 1, "]},");
  b.nodes += "{\"mesh\":0}";
  EXPECT_EQ(MustImport(b.Gltf(), MeshFormat::kGltf).report.triangles, 2u);
}

TEST(GltfTest, BoundsInstancesAndOverlappingAccessors) {
  ImportOptions options;
  options.max_triangles = 100;
  GltfBuilder b = Square();
  b.scenes = "{\"nodes\":[0";
  for (int i = 1; i < 51; ++i) {
    b.nodes += ",{\"mesh\":0}";
    b.scenes += absl::StrCat(",", i);
  }
  b.scenes += "]}";
  EXPECT_IMPORT_ERROR(ImportError(b.Gltf(), MeshFormat::kGltf, options), kResourceExhausted,
                      "max_triangles");
  GltfBuilder zeros;
  zeros.AddPositions(kSquare);
  zeros.AddRawAccessor("{\"componentType\":5126,\"count\":9007199254740992,\"type\":\"VEC3\"}");
  zeros.AddMesh("{\"attributes\":{\"POSITION\":1}}");
  EXPECT_IMPORT_ERROR(ImportError(zeros.Gltf(), MeshFormat::kGltf), kInvalidArgument,
                      "no bufferView");
}

TEST(GltfTest, RefusesNestingAndNumbersThatNoParserShouldSee) {
  const std::string deep = "{\"extras\":" + std::string(1'000'000, '[');
  EXPECT_IMPORT_ERROR(ImportError(deep, MeshFormat::kGltf), kResourceExhausted,
                      "nested deeper than 64");
  std::string wide = "{\"extras\":[";
  wide.append(20'000'000, ',');
  EXPECT_IMPORT_ERROR(ImportError(wide, MeshFormat::kGltf), kResourceExhausted, "16777216 values");
  // Each takes three bytes here, and hundreds in memory. Whichever lists they stand in count.
  const auto many = [](const std::string& item, uint64_t count) {
    std::string list = item;
    for (uint64_t i = 1; i < count; ++i) absl::StrAppend(&list, ",", item);
    return list;
  };
  const std::string half = many("{}", kMaxGltfItems / 2 + 1);
  EXPECT_IMPORT_ERROR(ImportError(absl::StrCat("{\"asset\":{\"version\":\"2.0\"},\"nodes\":[", half,
                                               "],\"meshes\":[{\"primitives\":[", half, "]}]}"),
                                  MeshFormat::kGltf),
                      kResourceExhausted, "more than 1048576 nodes, meshes");
  EXPECT_IMPORT_ERROR(ImportError(absl::StrCat("{\"asset\":{\"version\":\"2.0\"},\"accessors\":[",
                                               half, "],\"bufferViews\":[", half, "]}"),
                                  MeshFormat::kGltf),
                      kResourceExhausted, "join meshes");
  EXPECT_IMPORT_ERROR(ImportError("{\"asset\":1e999}", MeshFormat::kGltf), kInvalidArgument,
                      "JSON");
  EXPECT_IMPORT_ERROR(ImportError("[]", MeshFormat::kGltf), kInvalidArgument, "no object");
}

TEST(GltfTest, RefusesBrokenContainers) {
  const std::string good = Square().Glb();
  for (size_t size = 1; size < good.size(); size += 7) {
    EXPECT_FALSE(ImportError(good.substr(0, size), MeshFormat::kGlb).ok()) << size;
  }
  const auto with_word = [&good](size_t at, uint32_t value) {
    std::string bytes = good;
    bytes.replace(at, 4, Bytes(value));
    return ImportError(bytes, MeshFormat::kGlb);
  };
  EXPECT_IMPORT_ERROR(with_word(0, 0), kInvalidArgument, "no GLB file");
  EXPECT_IMPORT_ERROR(with_word(4, 1), kUnimplemented, "version 1");
  EXPECT_IMPORT_ERROR(with_word(8, 0xFFFFFFFF), kDataLoss, "cut short");
  EXPECT_IMPORT_ERROR(with_word(8, 12), kInvalidArgument, "no chunk");
  EXPECT_IMPORT_ERROR(with_word(12, 0xFFFFFFF0), kDataLoss, "past the end");
  EXPECT_IMPORT_ERROR(with_word(16, 7), kInvalidArgument, "JSON chunk");
}

TEST(GltfTest, ReadsBuffersBesideTheFileAndNowhereElse) {
  const testing_support::TempDir folder;
  const GltfBuilder b = Square();
  WriteFile(folder.File("my data.bin"), b.buffer());
  WriteFile(folder.File("a.gltf"), b.Json("my%20data.bin"));
  const absl::StatusOr<ImportedScene> scene = ImportFile(folder.File("a.gltf"));
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->report.triangles, 2u);
  for (const std::string& uri : {folder.File("my data.bin"), std::string("../x/my data.bin"),
                                 std::string("sub/../my data.bin"), std::string("none.bin"),
                                 std::string("$(touch pwned).bin")}) {
    WriteFile(folder.File("b.gltf"), b.Json(uri));
    EXPECT_IMPORT_ERROR(ImportFile(folder.File("b.gltf")).status(), kInvalidArgument,
                        "File not found");
  }
  // Without a folder, no file at all.
  EXPECT_IMPORT_ERROR(ImportError(b.Json("my%20data.bin"), MeshFormat::kGltf), kInvalidArgument,
                      "File not found");
}

TEST(GltfTest, ReadsABufferAsFarAsItsLengthSays) {
  GltfBuilder b = Square();
  const std::string data = b.buffer();
  const std::string more = data + "and more";
  const auto uri = [](const std::string& bytes) {
    return "data:application/gltf-buffer;base64," + absl::Base64Escape(bytes);
  };
  const ImportedScene square = MustImport(b.Gltf(), MeshFormat::kGltf);
  for (size_t size = data.size(); size <= more.size(); ++size) {
    EXPECT_TRUE(import_testing::SameBits(
        MustImport(b.Json(uri(more.substr(0, size))), MeshFormat::kGltf), square))
        << size;
  }
  EXPECT_IMPORT_ERROR(ImportError(b.Json(uri(data.substr(1))), MeshFormat::kGltf), kInvalidArgument,
                      "Failed to decode");
  // A length of each remainder by 3, in two buffers of one file, with a data URI between them.
  const testing_support::TempDir folder;
  WriteFile(folder.File("long.bin"), more);
  for (size_t size = 3; size < 6; ++size) {
    const auto buffer = [](size_t length, const std::string& where) {
      return absl::StrCat("{\"byteLength\":", length, ",\"uri\":\"", where, "\"}");
    };
    const std::string buffers =
        absl::StrCat("\"buffers\":[", buffer(data.size(), "long.bin"), ",",
                     buffer(size, uri("any bytes")), ",", buffer(size, "long.bin"), "]");
    const std::string json = b.Json("x");
    const size_t at = json.find("\"buffers\"");
    WriteFile(folder.File("a.gltf"), json.substr(0, at) + buffers + "}");
    const absl::StatusOr<ImportedScene> scene = ImportFile(folder.File("a.gltf"));
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_TRUE(import_testing::SameBits(*scene, square));
  }
  // The file counts whole, each time that it is read.
  ImportOptions options;
  options.max_file_bytes = 2 * more.size() - 1;
  options.base_folder = folder.path();
  const std::string twice = absl::StrReplaceAll(
      b.Json("long.bin"),
      {{"\"buffers\":[", "\"buffers\":[{\"byteLength\":1,\"uri\":\"long.bin\"},"}});
  EXPECT_IMPORT_ERROR(ImportError(twice, MeshFormat::kGltf, options), kInvalidArgument,
                      "past the limit");
  WriteFile(folder.File("short.bin"), data.substr(1));
  options.max_file_bytes = ImportOptions().max_file_bytes;
  EXPECT_IMPORT_ERROR(ImportError(b.Json("short.bin"), MeshFormat::kGltf, options),
                      kInvalidArgument, "File size mismatch");
}

}  // namespace
}  // namespace sightline
