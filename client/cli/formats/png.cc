// SPDX-License-Identifier: Apache-2.0
#include "client/cli/formats/png.h"

#include <png.h>

#include <cmath>
#include <csetjmp>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/formats/file.h"
#include "core/base/check.h"

namespace sightline::cli {
namespace {

struct Sink {
  std::string bytes;
  std::string error;
};

// libpng leaves through longjmp; nothing with a destructor may live between this and the setjmp.
[[noreturn]] void OnError(png_structp png, png_const_charp message) {
  static_cast<Sink*>(png_get_error_ptr(png))->error = message;
  std::longjmp(png_jmpbuf(png), 1);
}
void OnWarning(png_structp, png_const_charp) {}
void OnWrite(png_structp png, png_bytep data, size_t size) {
  static_cast<Sink*>(png_get_io_ptr(png))->bytes.append(reinterpret_cast<char*>(data), size);
}
void OnFlush(png_structp) {}

// Plain data in and out, so that a longjmp crosses no destructor.
bool Encode(const uint8_t* rgb, uint32_t width, uint32_t height, Sink* sink) {
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, sink, OnError, OnWarning);
  if (png == nullptr) {
    sink->error = "libpng does not start";
    return false;
  }
  png_infop info = png_create_info_struct(png);
  if (info == nullptr || setjmp(png_jmpbuf(png)) != 0) {
    png_destroy_write_struct(&png, &info);
    return false;
  }
  png_set_write_fn(png, sink, OnWrite, OnFlush);
  png_set_user_limits(png, 0x7FFFFFFF, 0x7FFFFFFF);
  png_set_IHDR(png, info, width, height, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
  png_set_compression_level(png, 6);
  png_write_info(png, info);
  for (uint32_t y = 0; y < height; ++y) {
    png_write_row(png, const_cast<png_bytep>(rgb + size_t{3} * width * y));
  }
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  return true;
}

}  // namespace

uint8_t EncodeSrgb(float linear) {
  if (!(linear > 0.0f)) return 0;
  if (linear >= 1.0f) return 255;
  const double x = linear;
  const double encoded = x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1.0 / 2.4) - 0.055;
  return static_cast<uint8_t>(std::floor(encoded * 255.0 + 0.5));
}

absl::StatusOr<std::string> FormatPng(const Image& image) {
  SIGHTLINE_CHECK(image.width > 0 && image.height > 0);
  std::vector<uint8_t> rgb(image.pixels.size() * 3);
  for (size_t i = 0; i < image.pixels.size(); ++i) {
    rgb[3 * i] = EncodeSrgb(image.pixels[i].r);
    rgb[3 * i + 1] = EncodeSrgb(image.pixels[i].g);
    rgb[3 * i + 2] = EncodeSrgb(image.pixels[i].b);
  }
  Sink sink;
  if (!Encode(rgb.data(), image.width, image.height, &sink)) {
    return absl::InternalError(absl::StrCat("libpng: ", sink.error));
  }
  return std::move(sink.bytes);
}

absl::Status WritePng(const std::string& path, const Image& image) {
  absl::StatusOr<std::string> bytes = FormatPng(image);
  if (!bytes.ok()) return bytes.status();
  return WriteFile(path, *bytes);
}

}  // namespace sightline::cli
