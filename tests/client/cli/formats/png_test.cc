// SPDX-License-Identifier: Apache-2.0
#include "client/cli/formats/png.h"

#include <png.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "gtest/gtest.h"

namespace sightline::cli {
namespace {

TEST(PngTest, SrgbCurve) {
  EXPECT_EQ(EncodeSrgb(0), 0);
  EXPECT_EQ(EncodeSrgb(1), 255);
  EXPECT_EQ(EncodeSrgb(-1), 0);
  EXPECT_EQ(EncodeSrgb(2), 255);
  EXPECT_EQ(EncodeSrgb(std::numeric_limits<float>::quiet_NaN()), 0);
  // Half of the light is code 188; 18 % grey is 118 (IEC 61966-2-1).
  EXPECT_EQ(EncodeSrgb(0.5f), 188);
  EXPECT_EQ(EncodeSrgb(0.18f), 118);
  // The linear part: 12.92 · 0.002 · 255 = 6.6.
  EXPECT_EQ(EncodeSrgb(0.002f), 7);
}

TEST(PngTest, ReadsBackPixelByPixelAndSaysSrgb) {
  Image image(5, 3);
  for (uint32_t y = 0; y < 3; ++y) {
    for (uint32_t x = 0; x < 5; ++x) {
      image.at(x, y) = {static_cast<float>(x) / 4, static_cast<float>(y) / 2, 0.5f};
    }
  }
  const absl::StatusOr<std::string> bytes = FormatPng(image);
  ASSERT_TRUE(bytes.ok()) << bytes.status();
  EXPECT_NE(bytes->find("sRGB"), std::string::npos);
  EXPECT_EQ(*bytes, *FormatPng(image));

  png_image png;
  std::memset(&png, 0, sizeof png);
  png.version = PNG_IMAGE_VERSION;
  ASSERT_NE(png_image_begin_read_from_memory(&png, bytes->data(), bytes->size()), 0);
  png.format = PNG_FORMAT_RGB;
  ASSERT_EQ(png.width, 5u);
  ASSERT_EQ(png.height, 3u);
  std::vector<uint8_t> pixels(PNG_IMAGE_SIZE(png));
  ASSERT_NE(png_image_finish_read(&png, nullptr, pixels.data(), 0, nullptr), 0);
  for (uint32_t y = 0; y < 3; ++y) {
    for (uint32_t x = 0; x < 5; ++x) {
      const uint8_t* p = &pixels[3 * (5 * y + x)];
      EXPECT_EQ(p[0], EncodeSrgb(image.at(x, y).r));
      EXPECT_EQ(p[1], EncodeSrgb(image.at(x, y).g));
      EXPECT_EQ(p[2], EncodeSrgb(image.at(x, y).b));
    }
  }
}

}  // namespace
}  // namespace sightline::cli
