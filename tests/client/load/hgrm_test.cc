// SPDX-License-Identifier: Apache-2.0
#include "client/load/hgrm.h"

#include <cmath>
#include <string>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline::load {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

LatencyHistogram Exponential(testing_support::TestRng& rng) {
  LatencyHistogram histogram;
  for (int i = 0; i < 20'000; ++i) {
    histogram.Record(absl::Milliseconds(1) - absl::Milliseconds(std::log1p(-rng.Uniform(0, 1))));
  }
  return histogram;
}

TEST(HgrmTest, RowsRiseToTheMaximum) {
  testing_support::TestRng rng;
  const LatencyHistogram histogram = Exponential(rng);
  const std::vector<PercentilePoint> points = PercentileDistribution(histogram);
  ASSERT_GT(points.size(), 20u);
  EXPECT_EQ(points.front().percent, 0);
  EXPECT_EQ(points.back().percent, 100);
  EXPECT_EQ(points.back().latency, histogram.max());
  for (size_t i = 1; i < points.size(); ++i) {
    EXPECT_GT(points[i].percent, points[i - 1].percent) << i;
    EXPECT_GE(points[i].latency, points[i - 1].latency) << i;
  }
}

TEST(HgrmTest, EveryRowIsTrueOfTheHistogram) {
  testing_support::TestRng rng;
  const LatencyHistogram histogram = Exponential(rng);
  const std::string text = FormatHgrm(histogram);
  EXPECT_THAT(text, StartsWith("       Value     Percentile TotalCount 1/(1-Percentile)\n\n"));
  int rows = 0;
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    const std::vector<std::string> words = absl::StrSplit(line, ' ', absl::SkipEmpty());
    if (words.size() < 3 || words[0] == "Value" || words[0][0] == '#') continue;
    double value = 0, share = 0;
    uint64_t count = 0;
    ASSERT_TRUE(absl::SimpleAtod(words[0], &value)) << line;
    ASSERT_TRUE(absl::SimpleAtod(words[1], &share)) << line;
    ASSERT_TRUE(absl::SimpleAtoi(words[2], &count)) << line;
    EXPECT_GE(static_cast<double>(count), share * static_cast<double>(histogram.count()) - 1e-6);
    if (share < 1) {
      double inverse = 0;
      ASSERT_EQ(words.size(), 4u) << line;
      ASSERT_TRUE(absl::SimpleAtod(words[3], &inverse));
      EXPECT_NEAR(inverse, 1 / (1 - share), 0.01) << line;
    } else {
      EXPECT_EQ(words.size(), 3u) << line;
      EXPECT_EQ(count, histogram.count());
    }
    ++rows;
  }
  EXPECT_GT(rows, 20);
  EXPECT_THAT(text, HasSubstr("#[Mean    ="));
  EXPECT_THAT(text, HasSubstr("Total count    =        20000]"));
}

TEST(HgrmTest, OneValueIsOneRow) {
  LatencyHistogram histogram;
  histogram.Record(absl::Milliseconds(2), 7);
  EXPECT_EQ(PercentileDistribution(histogram).size(), 1u);
  EXPECT_THAT(FormatHgrm(histogram), HasSubstr("       2.000 1.000000000000          7\n"));
}

TEST(HgrmTest, AnEmptyHistogramHasNoRows) {
  EXPECT_TRUE(PercentileDistribution(LatencyHistogram()).empty());
  EXPECT_THAT(FormatHgrm(LatencyHistogram()), HasSubstr("Total count    =            0]"));
}

}  // namespace
}  // namespace sightline::load
