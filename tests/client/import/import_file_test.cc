// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <functional>
#include <iterator>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/import/child_process.h"
#include "client/import/gltf_reader.h"
#include "client/import/obj_reader.h"
#include "client/import/off_reader.h"
#include "client/import/ply_reader.h"
#include "client/import/stl_reader.h"
#include "gtest/gtest.h"
#include "tests/client/import/import_testing.h"
#include "tests/support/temp_dir.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using import_testing::Bytes;
using import_testing::Gzip;
using import_testing::Repeated;
using import_testing::SameBits;
using import_testing::WriteFile;
using import_testing::Xz;

constexpr char kObj[] = "v 0 0 0\nv 447422.999 0 0\nv 0 1 0\nf 1 2 3\n";
constexpr char kOff[] = "OFF\n3 1 0\n0 0 0\n447422.999 0 0\n0 1 0\n3 0 1 2\n";

class ImportFileTest : public testing::Test {
 protected:
  std::string Write(const std::string& name, std::string_view bytes) {
    WriteFile(folder_.File(name), bytes);
    return folder_.File(name);
  }
  const testing_support::TempDir folder_;
};

TEST_F(ImportFileTest, ReadsCompressedFilesAsTheyAre) {
  for (const std::string& path :
       {Write("roof.obj", kObj), Write("roof.obj.xz", Xz(kObj)), Write("roof.obj.gz", Gzip(kObj)),
        Write("ROOF.OFF", kOff), Write("ROOF.OFF.XZ", Xz(kOff)),
        Write("roof.Off.Gz", Gzip(kOff))}) {
    const absl::StatusOr<ImportedScene> scene = ImportFile(path);
    ASSERT_TRUE(scene.ok()) << scene.status();
    ASSERT_EQ(scene->objects.size(), 1u);
    EXPECT_TRUE(scene->objects[0].name == "roof" || scene->objects[0].name == "ROOF");
    EXPECT_EQ(scene->objects[0].vertices[1].x, 447422.999);
    EXPECT_EQ(scene->report.triangles, 1u);
  }
}

TEST_F(ImportFileTest, GivesTheSameBytesTwice) {
  const std::string path = Write("a.obj", kObj);
  EXPECT_TRUE(SameBits(*ImportFile(path), *ImportFile(path)));
}

// By every reader, and while the file is read and decompressed.
TEST_F(ImportFileTest, IsGivenUpOnceNobodyWantsIt) {
  constexpr char kPly[] =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\n"
      "property double z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
      "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
  constexpr char kStl[] =
      "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
      "endloop\nendfacet\nendsolid s\n";
  constexpr char kGltf[] =
      R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],)"
      R"("meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],)"
      R"("accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],)"
      R"("bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,)"
      R"("uri":"data:application/octet-stream;base64,)"
      R"(AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]})";
  const std::pair<std::string, std::string> files[] = {{"a.obj", kObj},   {"a.off", kOff},
                                                       {"a.ply", kPly},   {"a.stl", kStl},
                                                       {"a.gltf", kGltf}, {"a.obj.xz", Xz(kObj)}};
  for (const auto& [name, bytes] : files) {
    SCOPED_TRACE(name);
    CancelToken cancel;
    const ImportOptions options{.cancel = &cancel};
    const absl::StatusOr<ImportedScene> scene = ImportFile(Write(name, bytes), options);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_TRUE(SameBits(*scene, *ImportFile(folder_.File(name))));
    cancel.Cancel();
    EXPECT_EQ(ImportFile(folder_.File(name), options).status().code(),
              absl::StatusCode::kCancelled);
    if (name.ends_with(".xz")) continue;
    const MeshFormat format = name.ends_with("obj")   ? MeshFormat::kObj
                              : name.ends_with("off") ? MeshFormat::kOff
                              : name.ends_with("ply") ? MeshFormat::kPly
                              : name.ends_with("stl") ? MeshFormat::kStl
                                                      : MeshFormat::kGltf;
    EXPECT_EQ(ImportBytes(bytes, format, options).status().code(), absl::StatusCode::kCancelled);
  }
  CancelToken cancel;
  cancel.Cancel();
  EXPECT_EQ(ImportPoints(folder_.File("a.ply"), {.cancel = &cancel}).status().code(),
            absl::StatusCode::kCancelled);
}

// A reader by itself, over content of which it makes nothing that would have it look.
TEST(ReadersTest, GiveUpOnWhatBringsNothingForth) {
  constexpr uint64_t kLines = 10'000;
  CancelToken cancel;
  const ImportOptions options{.cancel = &cancel};
  const std::string strips = absl::StrCat("ply\nformat ascii 1.0\nelement tristrips ", kLines,
                                          "\nproperty list uchar int vertex_indices\nend_header\n",
                                          Repeated("2 0 1\n", kLines));
  const std::string notes =
      absl::StrCat("ply\nformat ascii 1.0\nelement note ", kLines,
                   "\nproperty int word\nend_header\n", Repeated("7\n", kLines));
  const std::string obj = Repeated("vn 0 0 1\n", kLines);
  const std::string stl = "solid s\n" + Repeated("color 1 1 1\n", kLines);
  const std::string stl_binary = std::string(80, ' ') + Bytes(uint32_t{1}) + std::string(50, '\0');
  const std::string off = absl::StrCat("OFF\n", kLines, " 0 0\n", Repeated("0 0 0\n", kLines));
  const std::string gltf = R"({"asset":{"version":"2.0"}})";
  const std::function<absl::Status()> reads[] = {
      [&] { return ReadObj(obj, options).status(); },
      [&] { return ReadStl(stl, options).status(); },
      [&] { return ReadStl(stl_binary, options).status(); },
      [&] { return ReadPly(strips, options).status(); },
      [&] { return ReadPly(notes, options).status(); },
      [&] { return ReadOff(off, options).status(); },
      [&] { return ReadGltf(gltf, MeshFormat::kGltf, options).status(); }};
  for (const auto& read : reads) EXPECT_EQ(read(), absl::OkStatus());
  cancel.Cancel();
  for (size_t i = 0; i < std::size(reads); ++i) {
    EXPECT_EQ(reads[i]().code(), absl::StatusCode::kCancelled) << "reader " << i;
  }
}

TEST_F(ImportFileTest, NamesTheFileAndTheReason) {
  const auto error = [](const std::string& path) { return ImportFile(path).status(); };
  const std::string none = folder_.File("none.obj");
  EXPECT_IMPORT_ERROR(error(none), kNotFound, none + ": no such file");
  EXPECT_IMPORT_ERROR(error(Write("file", "x") + "/a.obj"), kNotFound, "no such file");
  EXPECT_IMPORT_ERROR(error(Write("empty.stl", "")), kInvalidArgument,
                      "empty.stl: the file is empty");
  EXPECT_IMPORT_ERROR(error(Write("empty.ply.xz", Xz(""))), kInvalidArgument,
                      "empty once decompressed");
  EXPECT_IMPORT_ERROR(error(Write("a.txt", kObj)), kInvalidArgument,
                      "\"txt\" names no known mesh format");
  EXPECT_IMPORT_ERROR(error(Write("a", kObj)), kInvalidArgument, "names no known mesh format");
  EXPECT_IMPORT_ERROR(error(Write("a.xz", Xz(kObj))), kInvalidArgument,
                      "names no known mesh format");
  EXPECT_IMPORT_ERROR(error(Write("a.obj.xz", kObj)), kDataLoss, "a.obj.xz: is not an xz file");
  EXPECT_IMPORT_ERROR(error(Write("a.obj.gz", kObj)), kDataLoss, "a.obj.gz: is not a gzip file");
  EXPECT_IMPORT_ERROR(error(folder_.path() + "/."), kInvalidArgument, "names no known mesh format");
  EXPECT_IMPORT_ERROR(error(Write("bad\nname.obj", "x")), kInvalidArgument,
                      "bad?name.obj: the mesh is empty");
  EXPECT_IMPORT_ERROR(error("/dev/null/../null.obj"), kNotFound, "no such file");
}

TEST_F(ImportFileTest, KeepsToTheByteLimit) {
  ImportOptions options;
  options.max_file_bytes = sizeof(kObj) - 1;
  EXPECT_TRUE(ImportFile(Write("a.obj", kObj), options).ok());
  options.max_file_bytes -= 1;
  EXPECT_IMPORT_ERROR(ImportFile(Write("a.obj", kObj), options).status(), kResourceExhausted,
                      "max_file_bytes is 40");
  const std::string bomb = Write("b.obj.xz", Xz(std::string(1 << 20, ' ')));
  options.max_file_bytes = 1 << 16;
  EXPECT_IMPORT_ERROR(ImportFile(bomb, options).status(), kResourceExhausted,
                      "max_file_bytes, 65536");
}

// Memory that reading the file takes, before there is anything to parse.
TEST_F(ImportFileTest, AFileThatMemoryCannotHoldIsAnError) {
  if (testing_support::kSanitizerBuild) {
    GTEST_SKIP() << "a child's memory is not limited where there is shadow memory";
  }
  constexpr uint64_t kMiB = uint64_t{1} << 20;
  const std::string path = Write("large.ply", "ply\n");
  std::filesystem::resize_file(path, 512 * kMiB);  // A hole.
  ChildLimits limits;
  limits.memory_bytes = 64 * kMiB;
  const auto in_little = [&](const std::function<absl::Status()>& read) {
    // What it throws would be an error of RunInChild.
    const absl::StatusOr<std::string> said = RunInChild([&] { return read().ToString(); }, limits);
    return said.ok() ? *said : absl::StrCat("thrown: ", said.status().message());
  };
  const std::string refused = absl::StrCat("RESOURCE_EXHAUSTED: ", path, ": needs more memory");
  EXPECT_THAT(in_little([&] { return ImportFile(path).status(); }), testing::HasSubstr(refused));
  EXPECT_THAT(in_little([&] { return ImportPoints(path).status(); }), testing::HasSubstr(refused));
}

TEST(DescribeReportTest, SaysWhatIsThereAndNothingElse) {
  ImportReport report;
  report.format = "obj";
  report.polygons = 4;
  report.triangles = 3;
  report.faces_bad_index = 1;
  report.warnings = {"a warning"};
  EXPECT_THAT(DescribeReport(report),
              testing::ElementsAre("obj: 3 triangles from 4 faces",
                                   "1 faces with an index out of range dropped", "a warning"));
}

}  // namespace
}  // namespace sightline
