// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/report.h"

#include <sstream>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline::bench {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

Row Primary(const std::string& scene, int width, double ratio) {
  return {{"workload", "primary"},
          {"scene", scene},
          {"width", width},
          {"height", width / 2},
          {"ratio", ratio}};
}

TEST(ReportTest, OverScenesByWorkloadAndSizeWithoutViews) {
  Row view = Primary("b", 640, 0.001);
  view["view"] = 2;
  const std::vector<Row> rows = {
      Primary("a", 640, 8),  Primary("a", 1280, 9),
      Primary("b", 640, 2),  view,
      Primary("b", 1280, 4), {{"workload", "segments"}, {"scene", "a"}, {"ratio", 0.5}}};
  std::ostringstream text;
  PrintOverScenes(rows, "ratio", /*json=*/false, text);
  EXPECT_EQ(text.str(),
            "primary at 640x320: over 2 scenes the geometric mean of the ratio is 4.00, the worst "
            "2.00 (b)\n"
            "primary at 1280x640: over 2 scenes the geometric mean of the ratio is 6.00, the worst "
            "4.00 (b)\n");
  std::ostringstream json;
  PrintOverScenes(rows, "ratio", /*json=*/true, json);
  const Row first = Row::parse(json.str().substr(0, json.str().find('\n')));
  EXPECT_EQ(first["scene"], "all");
  EXPECT_EQ(first["scenes"], 2);
  EXPECT_EQ(first["width"], 640);
  EXPECT_DOUBLE_EQ(first["ratio_geometric_mean"].get<double>(), 4);
  EXPECT_EQ(first["ratio_worst"], 2);
  EXPECT_EQ(first["worst_scene"], "b");
}

TEST(ReportTest, LinesOverScenesHaveTheCommonKeys) {
  Row a = Primary("a", 640, 8), b = Primary("b", 640, 2);
  for (Row* row : {&a, &b}) {
    (*row)["queries"] = 1000;
    (*row)["threads"] = 2;
    (*row)["disagreements"] = 0;
  }
  a["disagreements"] = 3;
  a["peer_mode"] = "single";
  b["peer_mode"] = "packet8";
  a["views"] = 3;
  std::ostringstream json;
  PrintOverScenes({a, b}, "ratio", /*json=*/true, json);
  const Row line = Row::parse(json.str());
  std::vector<std::string> keys;
  for (const auto& [key, value] : line.items()) keys.push_back(key);
  ASSERT_GT(keys.size(), kCommonKeys.size());
  keys.resize(kCommonKeys.size());
  EXPECT_EQ(keys, kCommonKeys);
  EXPECT_EQ(line["workload"], "primary");
  EXPECT_EQ(line["queries"], 2000);
  EXPECT_EQ(line["disagreements"], 3);
  EXPECT_EQ(line["threads"], 2);
  EXPECT_TRUE(line["peer_mode"].is_null()) << "they differ";
  EXPECT_TRUE(line["views"].is_null()) << "one has none";
  EXPECT_TRUE(line["ratio"].is_null());
}

TEST(ReportTest, TablesSayViewsAndSizes) {
  std::ostringstream out;
  Report report({SceneColumn("scene"), SizeColumn("pixels"), NumberColumn("ratio", "ratio", 1)},
                /*json=*/false, out);
  report.Add(Primary("a", 640, 8));
  Row view = Primary("a", 640, 9);
  view["view"] = 1;
  report.Add(view);
  report.Add({{"workload", "segments"}, {"scene", "a"}, {"ratio", 0.5}});
  report.Finish();
  EXPECT_EQ(out.str(),
            "scene       pixels  ratio\n"
            "a          640x320    8.0\n"
            "a, view 1  640x320    9.0\n"
            "a                -    0.5\n");
}

TEST(ReportTest, AnErrorOfOneSceneKeepsNoOtherFromItsTurn) {
  std::ostringstream out, err;
  Report report({SceneColumn("scene")}, /*json=*/false, out);
  std::vector<std::string> seen;
  const absl::Status status =
      RunScenes({"a", "b", "c"}, &report, err, [&](const std::string& scene) -> absl::Status {
        seen.push_back(scene);
        if (scene == "b") return absl::NotFoundError("no b");
        report.Add({{"scene", scene}});
        return absl::OkStatus();
      });
  EXPECT_EQ(status, absl::NotFoundError("no b"));
  EXPECT_THAT(seen, ElementsAre("a", "b", "c"));
  EXPECT_THAT(out.str(), HasSubstr("\na\nc\n"));
  EXPECT_EQ(err.str(), "b: no b\n");
}

TEST(ReportTest, CommonKeysComeFirstAndAreThere) {
  const Row row = WithCommonKeys({{"unit", "s"}, {"ratio", 2.5}, {"workload", "segments"}});
  std::vector<std::string> keys;
  for (const auto& [key, value] : row.items()) keys.push_back(key);
  std::vector<std::string> expected = kCommonKeys;
  expected.push_back("unit");
  EXPECT_EQ(keys, expected);
  EXPECT_EQ(row["workload"], "segments");
  EXPECT_EQ(row["ratio"], 2.5);
  EXPECT_TRUE(row["isa"].is_null());
}

}  // namespace
}  // namespace sightline::bench
