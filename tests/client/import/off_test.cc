// SPDX-License-Identifier: Apache-2.0
#include <string>

#include "gtest/gtest.h"
#include "tests/client/import/import_testing.h"

namespace sightline {
namespace {

using import_testing::ImportError;
using import_testing::MustImport;
using testing::ElementsAre;

constexpr char kBody[] = "0 0 0\n1 0 0\n1 447422.999 0\n0 1 0\n4 0 1 2 3\n3 0 1 2\n";

TEST(OffTest, ReadsHeadersAsTheyAreWritten) {
  for (const char* header :
       {"OFF\n4 2 0\n", "OFF 4 2 0\n", "OFF4 2 6\n", "# c\n\n OFF # d\n#e\n4 2\n", "4 2 0\n",
        "\xEF\xBB\xBFOFF\r\n4 2 0\r\n"}) {
    const ImportedScene scene = MustImport(std::string(header) + kBody, MeshFormat::kOff);
    ASSERT_EQ(scene.objects.size(), 1u) << header;
    EXPECT_EQ(scene.report.triangles, 3u);
    EXPECT_EQ(scene.report.polygons_fanned, 1u);
    EXPECT_EQ(scene.objects[0].vertices[2].y, 447422.999);
    EXPECT_EQ(scene.objects[0].name, "test");
    EXPECT_THAT(scene.objects[0].indices, ElementsAre(0, 1, 2, 0, 2, 3, 0, 1, 2));
  }
}

TEST(OffTest, ReadsPastColoursNormalsAndTextureCoordinates) {
  for (const char* keyword : {"COFF", "NOFF", "CNOFF", "STCNOFF"}) {
    const ImportedScene scene =
        MustImport(std::string(keyword) +
                       "\n3 1 0\n0 0 0 9 9 9 255\n1 0 0 9 9 9 255\n0 1 0 9 9 9 255\n"
                       "3 0 1 2 255 0 0\n",
                   MeshFormat::kOff);
    EXPECT_EQ(scene.report.triangles, 1u) << keyword;
  }
}

TEST(OffTest, CountsBadFacesAndVertices) {
  const ImportedScene scene = MustImport(
      "OFF 4 6 0\n0 0 0\n1 0 0\n0 1 0\nnan 0 x\n3 0 1 2\n3 0 1 4\n3 0 1 -1\n2 0 1\n3 0 1 1.5\n3 0 "
      "1 3\n",
      MeshFormat::kOff);
  EXPECT_EQ(scene.report.triangles, 2u);
  EXPECT_EQ(scene.report.faces_bad_index, 3u);
  EXPECT_EQ(scene.report.faces_too_few_corners, 1u);
  EXPECT_EQ(scene.report.non_finite_vertices, 1u);
  EXPECT_EQ(scene.report.non_finite_triangles, 1u);
}

TEST(OffTest, WarnsOfWhatComesAfterTheLastFace) {
  const std::string promised = "OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n";
  const ImportedScene more = MustImport(promised + "\n3 0 2 3\n", MeshFormat::kOff);
  EXPECT_EQ(more.report.triangles, 1u);
  EXPECT_THAT(more.report.warnings, ElementsAre("9 bytes after the last face were not read"));
  EXPECT_THAT(MustImport(promised + " \n# made by hand\n", MeshFormat::kOff).report.warnings,
              ElementsAre());
}

TEST(OffTest, RefusesWhatIsTruncatedOrOversold) {
  EXPECT_IMPORT_ERROR(ImportError("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n", MeshFormat::kOff), kDataLoss,
                      "ends before");
  EXPECT_IMPORT_ERROR(ImportError("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", MeshFormat::kOff),
                      kDataLoss, "fewer corners");
  EXPECT_IMPORT_ERROR(ImportError("OFF\n4000000000 1 0\n0 0 0\n", MeshFormat::kOff), kDataLoss,
                      "promises 4000000000 vertices");
  EXPECT_IMPORT_ERROR(ImportError("OFF\n1 9000000000000000000 0\n0 0 0\n", MeshFormat::kOff),
                      kDataLoss, "promises");
}

TEST(OffTest, RefusesWhatItDoesNotRead) {
  EXPECT_IMPORT_ERROR(ImportError("4OFF\n1 0 0\n0 0 0 1\n", MeshFormat::kOff), kUnimplemented,
                      "4OFF");
  EXPECT_IMPORT_ERROR(ImportError("nOFF\n3\n1 0 0\n", MeshFormat::kOff), kUnimplemented, "nOFF");
  EXPECT_IMPORT_ERROR(ImportError("OFF BINARY\n\1\2\3", MeshFormat::kOff), kUnimplemented,
                      "binary");
  EXPECT_IMPORT_ERROR(ImportError("solid x\n", MeshFormat::kOff), kInvalidArgument, "solid x");
  EXPECT_IMPORT_ERROR(ImportError("OFF\n-1 2 3\n", MeshFormat::kOff), kInvalidArgument, "counts");
  EXPECT_IMPORT_ERROR(ImportError("OFF\nx y z\n", MeshFormat::kOff), kInvalidArgument, "counts");
}

}  // namespace
}  // namespace sightline
