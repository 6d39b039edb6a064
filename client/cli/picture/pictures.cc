// SPDX-License-Identifier: Apache-2.0
#include "client/cli/picture/pictures.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "client/cli/picture/color_map.h"
#include "core/base/check.h"

namespace sightline::cli {
namespace {

Vec3d ToVec(const client::Point3& p) { return {p[0], p[1], p[2]}; }

Vec3d Unit(Vec3d v) {
  const double length = Length(v);
  return length > 0 && std::isfinite(length) ? v * (1.0 / length) : Vec3d{};
}

Rgb Mix(Rgb a, Rgb b, float t) { return a * (1.0f - t) + b * t; }

// From a low horizon's grey to a calm blue: what lies behind the scene.
Rgb Background(uint32_t y, uint32_t height) {
  const float t = (static_cast<float>(y) + 0.5f) / static_cast<float>(height);
  return Mix({0.22f, 0.29f, 0.38f}, {0.68f, 0.70f, 0.71f}, t * t * (3.0f - 2.0f * t));
}

// Rays of pixels relative to the eye; a hit is at depth · ray.
class Rays {
 public:
  explicit Rays(const client::Camera& camera)
      : forward_(ToVec(camera.forward)),
        right_(ToVec(camera.right) *
               (camera.tan_half_fov_y * camera.width / std::max(1u, camera.height))),
        up_(ToVec(camera.up) * camera.tan_half_fov_y),
        width_(camera.width),
        height_(camera.height) {}
  Vec3d operator()(uint32_t x, uint32_t y) const {
    return forward_ + right_ * (2.0 * (x + 0.5) / width_ - 1.0) +
           up_ * (1.0 - 2.0 * (y + 0.5) / height_);
  }

 private:
  Vec3d forward_, right_, up_;
  double width_, height_;
};

// The values at shares `low` and `high` of what is finite and positive, for a scale that a few
// extreme values do not stretch; {1, 1} if there are none.
std::pair<double, double> Percentiles(std::vector<double> values, double low, double high) {
  std::erase_if(values, [](double v) { return !(v > 0) || !std::isfinite(v); });
  if (values.empty()) return {1, 1};
  const auto at = [&values](double place) {
    const auto n = static_cast<ptrdiff_t>(place);
    std::nth_element(values.begin(), values.begin() + n, values.end());
    return values[static_cast<size_t>(n)];
  };
  // Outward to the next value, so that a few values are not cut.
  const auto last = static_cast<double>(values.size() - 1);
  const double lo = at(std::floor(low * last));
  return {lo, at(std::ceil(high * last))};
}

// Where `value` stands between lo (0) and hi (1) in even steps of the logarithm.
float LogShare(double value, double lo, double hi) {
  if (!(hi > lo)) return 0.5f;
  return static_cast<float>(std::log(std::max(value, lo) / lo) / std::log(hi / lo));
}

// Alike in lightness but for the first, which most pixels have: what costs most stands out, for
// readers with any colour vision.
const StrategyKeyEntry kStrategyKey[] = {
    {"blue", "whole shafts, no test of the ray", OklchToRgb(0.48f, 0.12f, 4.4f)},
    {"yellow", "a shaft's relevant triangles, tested with the ray", OklchToRgb(0.86f, 0.15f, 1.6f)},
    {"green", "a packet: boxes together, triangles ray by ray", OklchToRgb(0.68f, 0.14f, 2.6f)},
    {"red", "the ray by itself", OklchToRgb(0.58f, 0.21f, 0.45f)}};

}  // namespace

std::span<const StrategyKeyEntry> StrategyKey() { return kStrategyKey; }

Image StrategyPicture(const client::TileImage& image, const client::Camera& camera,
                      std::span<const uint8_t> answered_by) {
  const std::vector<Vec3d> normals = PixelNormals(image, camera);
  SIGHTLINE_CHECK_EQ(answered_by.size(), normals.size());
  const Rays ray(camera);
  Image picture(image.width, image.height);
  for (uint32_t y = 0; y < image.height; ++y) {
    for (uint32_t x = 0; x < image.width; ++x) {
      const size_t i = size_t{y} * image.width + x;
      const size_t by = answered_by[i];
      if (by == 0 || by > std::size(kStrategyKey)) {
        picture.pixels[i] = {0.045f, 0.045f, 0.05f};
        continue;
      }
      // What is seen of nothing is as if it faced the eye.
      const Vec3d normal = normals[i];
      const auto facing = static_cast<float>(
          normal == Vec3d{} ? 1.0 : std::max(0.0, -Dot(normal, Unit(ray(x, y)))));
      picture.pixels[i] = kStrategyKey[by - 1].light * (0.35f + 0.65f * facing);
    }
  }
  return picture;
}

Rgb ObjectColor(uint32_t object) {
  // Multiples of the golden ratio spread any number of hues evenly (Weyl); lightness takes another
  // irrational, so that neighbours in number differ in both.
  const double k = static_cast<double>(object) + 1.0;
  const auto fraction = [](double x) { return static_cast<float>(x - std::floor(x)); };
  const float hue = 2.0f * std::numbers::pi_v<float> * fraction(k * 0.6180339887498949 + 0.05);
  const float lightness = 0.74f + 0.14f * fraction(k * 0.7548776662466927);
  return OklchToRgb(lightness, 0.055f, hue);
}

std::vector<Vec3d> PixelNormals(const client::TileImage& image, const client::Camera& camera) {
  const uint32_t w = image.width, h = image.height;
  SIGHTLINE_CHECK(image.depth.size() == size_t{w} * h &&
                  image.object.size() == image.depth.size() &&
                  image.triangle.size() == image.depth.size());
  const Rays ray(camera);
  std::vector<Vec3d> normals(size_t{w} * h);
  const auto hit = [&](size_t i) { return image.object[i] != client::kNone; };
  // The step from pixel i at (x, y) to whichever neighbour along (dx, dy) fits its surface best;
  // zero if there is none. Within a plane 1/depth changes evenly: the smaller change is the
  // likelier neighbour.
  const auto step = [&](uint32_t x, uint32_t y, int dx, int dy) -> Vec3d {
    const size_t i = size_t{y} * w + x;
    double best = std::numeric_limits<double>::infinity();
    Vec3d result;
    for (int sign : {1, -1}) {
      const int64_t nx = int64_t{x} + sign * dx, ny = int64_t{y} + sign * dy;
      if (nx < 0 || ny < 0 || nx >= w || ny >= h) continue;
      const size_t j = static_cast<size_t>(ny) * w + static_cast<size_t>(nx);
      if (!hit(j)) continue;
      double misfit = std::abs(1.0 / image.depth[j] - 1.0 / image.depth[i]);
      if (image.object[j] != image.object[i]) misfit += 1e30;  // Only where nothing else is there.
      if (image.object[j] == image.object[i] && image.triangle[j] == image.triangle[i]) misfit = -1;
      if (misfit >= best) continue;
      best = misfit;
      const Vec3d there =
          ray(static_cast<uint32_t>(nx), static_cast<uint32_t>(ny)) * double{image.depth[j]};
      result = (there - ray(x, y) * double{image.depth[i]}) * static_cast<double>(sign);
    }
    return result;
  };
  for (uint32_t y = 0; y < h; ++y) {
    for (uint32_t x = 0; x < w; ++x) {
      const size_t i = size_t{y} * w + x;
      if (!hit(i)) continue;
      const Vec3d view = Unit(-ray(x, y));
      Vec3d normal = Unit(Cross(step(x, y, 1, 0), step(x, y, 0, 1)));
      if (normal == Vec3d{}) normal = view;  // A lone pixel.
      normals[i] = Dot(normal, view) < 0 ? -normal : normal;
    }
  }
  return normals;
}

Image LitPicture(const client::TileImage& image, const client::Camera& camera,
                 std::span<const client::Light> lights, Vec3d up) {
  // A warm key, a cool fill, then neutral ones: their shadows can be told apart.
  static constexpr Rgb kTints[] = {
      {1.00f, 0.90f, 0.76f}, {0.76f, 0.88f, 1.00f}, {0.95f, 0.95f, 0.95f}};
  const std::vector<Vec3d> normals = PixelNormals(image, camera);
  const size_t n = normals.size();
  SIGHTLINE_CHECK(image.lit.size() >= lights.size() * n);
  const Rays ray(camera);
  const Vec3d eye = ToVec(camera.eye), sky = Unit(up);
  const double weights = std::accumulate(
      lights.begin(), lights.end(), 0.0,
      [](double sum, const client::Light& light) { return sum + std::abs(light.weight); });
  const auto strength = static_cast<float>(1.05 / std::pow(std::max(1.0, weights), 0.7));
  Image picture(image.width, image.height);
  for (uint32_t y = 0; y < image.height; ++y) {
    for (uint32_t x = 0; x < image.width; ++x) {
      const size_t i = size_t{y} * image.width + x;
      if (image.object[i] == client::kNone) {
        picture.pixels[i] = Background(y, image.height);
        continue;
      }
      const Vec3d normal = normals[i];
      const Vec3d view = ray(x, y);
      const Vec3d at = eye + view * double{image.depth[i]};
      const auto facing = static_cast<float>(std::max(0.0, -Dot(normal, Unit(view))));
      const auto upward = static_cast<float>(0.5 + 0.5 * Dot(normal, sky));
      // Ambient light comes from above and, faintly, from the eye: shape shows in full shadow too.
      const float open = lights.empty() ? 0.75f : 0.11f;
      Rgb light =
          Rgb{0.82f, 0.92f, 1.0f} * (0.05f + 0.10f * upward) + Rgb{1, 1, 1} * (open * facing);
      for (size_t k = 0; k < lights.size(); ++k) {
        if (image.lit[k * n + i] != 1) continue;
        const Vec3d toward = lights[k].kind == client::Light::Kind::kDirectional
                                 ? ToVec(lights[k].direction)
                                 : ToVec(lights[k].position) - at;
        const auto slope = static_cast<float>(std::max(0.0, Dot(normal, Unit(toward))));
        light = light + kTints[k % std::size(kTints)] *
                            (strength * slope * static_cast<float>(std::abs(lights[k].weight)));
      }
      const Rgb color = ObjectColor(image.object[i]) * light;
      // Bright sums bend toward white instead of clipping.
      const auto bend = [](float c) { return 1.0f - std::exp(-1.5f * c); };
      picture.pixels[i] = {bend(color.r), bend(color.g), bend(color.b)};
    }
  }
  return picture;
}

Image DepthPicture(const client::TileImage& image) {
  SIGHTLINE_CHECK(image.depth.size() == size_t{image.width} * image.height);
  const auto [lo, hi] =
      Percentiles(std::vector<double>(image.depth.begin(), image.depth.end()), 0.005, 0.995);
  Image picture(image.width, image.height);
  for (size_t i = 0; i < picture.pixels.size(); ++i) {
    picture.pixels[i] = std::isfinite(image.depth[i])
                            ? ColorMap::Depth()(1.0f - LogShare(image.depth[i], lo, hi))
                            : Rgb{0.045f, 0.045f, 0.05f};
  }
  return picture;
}

Image CostPicture(const client::TileImage& image) {
  // A node is a test of eight boxes.
  const auto work = [](const client::TileImage::TileCost& cost) {
    const double pixels = double{static_cast<double>(cost.rect.width)} * cost.rect.height;
    return pixels == 0 ? 0.0
                       : (8.0 * static_cast<double>(cost.statistics.nodes) +
                          static_cast<double>(cost.statistics.triangle_tests)) /
                             pixels;
  };
  std::vector<double> all;
  for (const auto& cost : image.costs) all.push_back(work(cost));
  // Tiles of mere background cost next to nothing: five doublings below the top are told apart.
  auto [lo, hi] = Percentiles(all, 0.02, 0.995);
  lo = std::max(lo, hi / 32);
  Image picture(image.width, image.height);
  for (const auto& cost : image.costs) {
    const double value = work(cost);
    const Rgb color = ColorMap::Cost()(value > 0 ? LogShare(value, lo, hi) : 0.0f);
    for (uint32_t y = 0; y < cost.rect.height; ++y) {
      for (uint32_t x = 0; x < cost.rect.width; ++x) {
        picture.at(cost.rect.x + x, cost.rect.y + y) = color;
      }
    }
  }
  return picture;
}

}  // namespace sightline::cli
