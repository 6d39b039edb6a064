// SPDX-License-Identifier: Apache-2.0
#include "client/load/plot.h"

#include <algorithm>
#include <string>

#include "client/cli/formats/file.h"
#include "client/load/glyphs.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/temp_dir.h"

namespace sightline::load {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

Measurement Measured(int windows) {
  Measurement m;
  m.window = absl::Seconds(1);
  m.elapsed = absl::Seconds(windows);
  for (int w = 0; w < windows; ++w) {
    Window window;
    for (int i = 1; i <= 100; ++i) {
      const absl::Duration latency = absl::Milliseconds(i + w);
      window.planned.Record(latency);
      m.all.planned.Record(latency);
      m.all.sent.Record(latency / 2);
      ++m.all.answered;
    }
    m.windows.push_back(window);
  }
  return m;
}

bool HasInk(const cli::Image& image, uint32_t x0, uint32_t y0, uint32_t x1, uint32_t y1) {
  for (uint32_t y = y0; y < y1; ++y) {
    for (uint32_t x = x0; x < x1; ++x) {
      if (image.at(x, y).r < 0.9f || image.at(x, y).b < 0.9f) return true;
    }
  }
  return false;
}

TEST(GlyphsTest, EveryLetterOfAPlotHasInkAndIsItsOwn) {
  const std::string letters = "0123456789abcdefghijklmnopqrstuvwxyz.,:/%-+=()_";
  const auto bits = [](char c) {
    std::string dots;
    for (int row = 0; row < kGlyphRows; ++row) {
      for (int column = 0; column < kGlyphColumns; ++column) {
        dots += GlyphDot(c, column, row) ? '#' : '.';
      }
    }
    return dots;
  };
  for (size_t i = 0; i < letters.size(); ++i) {
    EXPECT_NE(bits(letters[i]).find('#'), std::string::npos) << letters[i];
    for (size_t j = 0; j < i; ++j) EXPECT_NE(bits(letters[i]), bits(letters[j])) << letters[i];
  }
  EXPECT_EQ(bits('A'), bits('a'));
  EXPECT_EQ(bits(' ').find('#'), std::string::npos);
  EXPECT_EQ(bits('\xff').find('#'), std::string::npos);
}

TEST(DrawingTest, LinesAndWordsAreWhereTheyBelong) {
  Drawing drawing{.width = 100, .height = 60};
  drawing.strokes.push_back({.points = {{10, 20}, {90, 20}}, .color = 0xff0000, .width = 4});
  drawing.labels.push_back(
      {.x = 95, .y = 50, .text = "11", .anchor = Label::Anchor::kEnd, .color = 0});
  const cli::Image image = Rasterize(drawing);
  EXPECT_NEAR(image.at(50, 20).r, 1, 1e-6);
  EXPECT_NEAR(image.at(50, 20).b, 0, 1e-6);
  EXPECT_NEAR(image.at(50, 30).b, 1, 1e-6);
  EXPECT_FALSE(HasInk(image, 0, 0, 7, 60));
  EXPECT_TRUE(HasInk(image, 70, 35, 96, 51));
  EXPECT_FALSE(HasInk(image, 0, 35, 68, 60));
  const std::string svg = FormatSvg(drawing);
  EXPECT_THAT(svg, HasSubstr("stroke=\"#ff0000\""));
  EXPECT_THAT(svg, HasSubstr("text-anchor=\"end\""));
}

TEST(DrawingTest, WordsCannotBreakAnSvg) {
  Drawing drawing{.width = 10, .height = 10};
  drawing.labels.push_back({.text = "<a&b>"});
  EXPECT_THAT(FormatSvg(drawing), HasSubstr(">&lt;a&amp;b&gt;<"));
}

TEST(DrawingTest, WhatLeavesThePictureIsCutOff) {
  Drawing drawing{.width = 20, .height = 20};
  drawing.strokes.push_back({.points = {{-50, -50}, {70, 70}}, .color = 0, .width = 2});
  drawing.labels.push_back({.x = -3, .y = 2, .text = "88"});
  drawing.labels.push_back({.x = 18, .y = 25, .text = "88"});
  EXPECT_TRUE(HasInk(Rasterize(drawing), 9, 9, 11, 11));
}

TEST(PlotTest, CurvesStayWithinTheirPanels) {
  for (const int windows : {0, 1, 30}) {
    const Drawing drawing = DrawPlot(Measured(windows), "a run");
    for (const Stroke& stroke : drawing.strokes) {
      const bool key = stroke.width == 3;  // Above the frames, where it hides no curve.
      for (const PlotPoint& point : stroke.points) {
        EXPECT_GE(point.x, 80) << windows;
        EXPECT_LE(point.x, 1250.001) << windows;
        EXPECT_GE(point.y, key ? 60 : 111.999) << windows;
        EXPECT_LE(point.y, key ? 108 : 492.001) << windows;
      }
    }
  }
}

// Within one decade the decades alone would leave a curve between two lines.
TEST(PlotTest, ANarrowScaleHasTwosAndFives) {
  const auto has = [](const Measurement& m, const std::string& text) {
    const Drawing drawing = DrawPlot(m, "");
    return std::any_of(drawing.labels.begin(), drawing.labels.end(), [&](const Label& label) {
      return label.anchor == Label::Anchor::kEnd && label.text == text;
    });
  };
  Measurement m = Measured(3);  // 0.5 to 102 ms.
  for (const char* text : {"1", "2", "5", "10", "100"}) EXPECT_TRUE(has(m, text)) << text;
  m.all.planned.Record(absl::Seconds(50));
  EXPECT_TRUE(has(m, "10000"));
  EXPECT_FALSE(has(m, "5"));
}

TEST(PlotTest, HoursAreSecondsInFull) {
  Measurement m = Measured(3);
  m.window = absl::Minutes(20);
  m.elapsed = absl::Hours(1);
  const Drawing drawing = DrawPlot(m, "");
  const auto has = [&](const std::string& text) {
    return std::any_of(drawing.labels.begin(), drawing.labels.end(),
                       [&](const Label& label) { return label.text == text; });
  };
  EXPECT_TRUE(has("1000") && has("3000"));
  EXPECT_FALSE(has("1e+03"));
}

TEST(PlotTest, AWindowWithoutAnswersLeavesAGap) {
  Measurement m = Measured(10);
  const size_t whole = DrawPlot(m, "").strokes.size();
  m.windows[5] = Window();
  // Both curves over time are in two pieces now.
  EXPECT_EQ(DrawPlot(m, "").strokes.size(), whole + 2);
  // One that stands alone is seen all the same.
  m.windows[7] = Window();
  EXPECT_EQ(DrawPlot(m, "").strokes.size(), whole + 4);
  m.windows[9] = m.windows[8] = Window();
  EXPECT_EQ(DrawPlot(m, "").strokes.size(), whole + 2);
}

// What the warm-up asked may be answered within the first window, long after.
TEST(PlotTest, AnswersToTheWarmUpStayWithinTheirPanel) {
  Measurement m = Measured(4);
  m.windows[0].planned.Record(absl::Seconds(40), 10);
  m.windows[1].planned.Record(absl::Microseconds(3), 1000);
  for (const Stroke& stroke : DrawPlot(m, "").strokes) {
    if (stroke.width == 3) continue;  // Of the keys.
    for (const PlotPoint& point : stroke.points) {
      EXPECT_GE(point.y, 111.999);
      EXPECT_LE(point.y, 492.001);
    }
  }
}

TEST(PlotTest, ATitleOfAnyBytesIsText) {
  const std::string svg = FormatSvg(DrawPlot(Measured(1),
                                             "stra\xdf"
                                             "e\x01.obj   tiles"));
  EXPECT_THAT(svg, HasSubstr(">stra\xef\xbf\xbd"
                             "e\xef\xbf\xbd.obj   tiles<"));
}

TEST(PlotTest, TheFilesEndingSaysWhatIsWritten) {
  testing_support::TempDir dir;
  ASSERT_TRUE(WritePlot(dir.File("a.png"), Measured(3), "a").ok());
  ASSERT_TRUE(WritePlot(dir.File("a.svg"), Measured(3), "a").ok());
  EXPECT_THAT(*cli::ReadFile(dir.File("a.png")), StartsWith("\x89PNG"));
  EXPECT_THAT(*cli::ReadFile(dir.File("a.svg")), StartsWith("<svg"));
}

}  // namespace
}  // namespace sightline::load
