// SPDX-License-Identifier: Apache-2.0
//
// Pictures of 8-bit RGB as PNG files. Colours come in as linear light, are encoded with the sRGB
// curve and the file says so (an sRGB chunk). The bytes depend on the pixels and libpng's version
// alone.
//
// Thread safety: free functions; Image is a plain value.
//
//   Image image(1920, 1080);
//   image.at(x, y) = {0.2f, 0.4f, 0.1f};
//   SL_RETURN_IF_ERROR(WritePng("view.png", image));
#ifndef SIGHTLINE_CLIENT_CLI_FORMATS_PNG_H_
#define SIGHTLINE_CLIENT_CLI_FORMATS_PNG_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace sightline::cli {

// Linear light, 0 to 1 where it can be shown; more or less is clamped.
struct Rgb {
  float r = 0, g = 0, b = 0;
  friend Rgb operator+(Rgb a, Rgb b) { return {a.r + b.r, a.g + b.g, a.b + b.b}; }
  friend Rgb operator*(Rgb a, Rgb b) { return {a.r * b.r, a.g * b.g, a.b * b.b}; }
  friend Rgb operator*(Rgb a, float s) { return {a.r * s, a.g * s, a.b * s}; }
};

struct Image {
  Image(uint32_t w, uint32_t h) : width(w), height(h), pixels(size_t{w} * h) {}
  Rgb& at(uint32_t x, uint32_t y) { return pixels[size_t{y} * width + x]; }
  const Rgb& at(uint32_t x, uint32_t y) const { return pixels[size_t{y} * width + x]; }

  uint32_t width, height;
  std::vector<Rgb> pixels;  // Row by row, the top row first.
};

// The sRGB curve of IEC 61966-2-1: linear light in [0, 1] to its 8-bit code, rounded to nearest.
// Values outside are clamped; NaN becomes 0.
uint8_t EncodeSrgb(float linear);

// RESOURCE_EXHAUSTED or INTERNAL with libpng's words. REQUIRES: width and height above 0.
absl::StatusOr<std::string> FormatPng(const Image& image);
absl::Status WritePng(const std::string& path, const Image& image);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_FORMATS_PNG_H_
