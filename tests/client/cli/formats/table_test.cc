// SPDX-License-Identifier: Apache-2.0
#include "client/cli/formats/table.h"

#include "client/cli/formats/file.h"
#include "client/cli/formats/npy.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/temp_dir.h"

namespace sightline::cli {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing_support::TempDir;

class TableTest : public testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& bytes) {
    EXPECT_TRUE(WriteFile(dir_.File(name), bytes).ok());
    return dir_.File(name);
  }
  TempDir dir_;
};

TEST_F(TableTest, ReadsNpyTextAndPly) {
  const double values[] = {1, 2, 3, 4, 5, 6};
  const size_t shape[] = {2, 3};
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty "
      "double z\n"
      "end_header\n1 2 3\n4 5 6\n";
  for (const std::string& path :
       {Write("p.npy", FormatNpy<double>(shape, values)), Write("p.CSV", "x,y,z\n1,2,3\n4,5,6\n"),
        Write("p.xyz", "1 2 3\n4 5 6\n"), Write("p.ply", ply)}) {
    const auto rows = ReadRows(path, 3, "points");
    ASSERT_TRUE(rows.ok()) << rows.status();
    EXPECT_THAT(*rows, ElementsAre(1, 2, 3, 4, 5, 6)) << path;
  }
}

TEST_F(TableTest, WrongShapesNameShapeDtypeAndRemedy) {
  const float values[] = {1, 2, 3, 4, 5, 6};
  const size_t flat[] = {6}, transposed[] = {3, 2}, one[] = {3};
  const auto error = [&](const std::string& path) {
    const absl::Status status = ReadRows(path, 3, "points").status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(status.message()), HasSubstr(path));
    return std::string(status.message());
  };
  EXPECT_THAT(error(Write("a.npy", FormatNpy<float>(flat, values))),
              AllOf(HasSubstr("(6,)"), HasSubstr("<f4"), HasSubstr("(n, 3)")));
  EXPECT_THAT(error(Write("b.npy", FormatNpy<float>(transposed, values))), HasSubstr("(3, 2)"));
  EXPECT_THAT(error(Write("c.npy", FormatNpy<float>(one, std::span(values, 3)))),
              HasSubstr("reshape(1, 3)"));
  EXPECT_THAT(error(Write("d.csv", "1,2\n")), HasSubstr("3 columns, but it has 2"));
  EXPECT_THAT(error(Write("e.bin", "1,2\n")), HasSubstr(".npy"));
}

}  // namespace
}  // namespace sightline::cli
