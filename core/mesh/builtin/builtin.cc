// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/builtin/builtin.h"

#include <cstddef>
#include <iterator>
#include <optional>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/mesh/builtin/generators.h"
#include "core/mesh/builtin/scene_builder.h"

namespace sightline {
namespace {

constexpr BuiltinInfo kInfos[] = {
    {"hall", "columned hall with a vault, tables, chairs, crates and balls; cameras inside",
     250'000, 30'000},
    {"room", "furnished living room with books, cushions, plants and a window", 200'000, 15'000},
    {"office", "open office with desks, chairs and sixteen ceiling lights", 300'000, 60'000},
    {"plants", "potted plants of several kinds with many leaves", 300'000, 10'000},
    {"city", "blocks of buildings and towers around (500000, 4400000), metres", 1'000'000, 200'000},
    {"forest", "hilly ground with conifers, broad-leaved trees, ferns and stones", 1'000'000,
     80'000},
    {"sphere", "one closed, displaced sphere", 200'000, 1'500},
    {"terrain", "fractal mountains, eight kilometres square", 500'000, 200},
    {"box", "Cornell-like box with two blocks and a ball", 10'000, 300},
};

struct Generator {
  void (*make)(SceneBuilder&);
  std::vector<BuiltinView> (*views)(uint64_t seed);
};
// In the order of kInfos.
constexpr Generator kGenerators[] = {
    {MakeHall, HallViews},     {MakeRoom, RoomViews},       {MakeOffice, OfficeViews},
    {MakePlants, PlantsViews}, {MakeCity, CityViews},       {MakeForest, ForestViews},
    {MakeSphere, SphereViews}, {MakeTerrain, TerrainViews}, {MakeBox, BoxViews},
};
static_assert(std::size(kInfos) == std::size(kGenerators));

absl::StatusOr<size_t> Find(std::string_view name) {
  std::string known;
  for (size_t i = 0; i < std::size(kInfos); ++i) {
    if (kInfos[i].name == name) return i;
    absl::StrAppend(&known, i == 0 ? "" : ", ", std::string(kInfos[i].name));
  }
  return absl::InvalidArgumentError(absl::StrCat(
      "unknown built-in scene '", std::string(name), "'; known are ", known, "; a size up to ",
      kMaxBuiltinTriangles, " triangles may follow, as in ", "hall:1000000 or forest:2M,seed=7"));
}

absl::Status CheckTarget(const BuiltinInfo& info, uint64_t target) {
  if (target >= info.min_triangles && target <= kMaxBuiltinTriangles) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("built-in scene '", std::string(info.name), "' cannot have ", target,
                   " triangles; ask for ", info.min_triangles, " to ", kMaxBuiltinTriangles,
                   ", or leave the size out for ", info.default_triangles));
}

// A whole number below 2^64; digits only.
std::optional<uint64_t> ParseWhole(std::string_view text) {
  if (text.empty()) return std::nullopt;
  uint64_t value = 0;
  for (char c : text) {
    if (c < '0' || c > '9') return std::nullopt;
    const uint64_t digit = static_cast<uint64_t>(c - '0');
    if (value > (UINT64_MAX - digit) / 10) return std::nullopt;
    value = value * 10 + digit;
  }
  return value;
}

// "1000000", "250k", "2M", "1.5M"; at most six decimals, none left over after the factor.
std::optional<uint64_t> ParseCount(std::string_view text) {
  uint64_t factor = 1;
  if (!text.empty()) {
    const char last = text.back();
    factor = last == 'k' || last == 'K' ? 1'000 : last == 'm' || last == 'M' ? 1'000'000 : 1;
    if (factor != 1) text.remove_suffix(1);
  }
  std::string digits(text);
  if (const size_t point = digits.find('.'); point != std::string::npos) {
    const size_t decimals = digits.size() - point - 1;
    if (point == 0 || decimals == 0 || decimals > 6) return std::nullopt;
    digits.erase(point, 1);
    for (size_t i = 0; i < decimals; ++i) {
      if (factor == 1) return std::nullopt;
      factor /= 10;
    }
  }
  const std::optional<uint64_t> value = ParseWhole(digits);
  if (!value.has_value() || *value > UINT64_MAX / factor) return std::nullopt;
  return *value * factor;
}

uint64_t CountTriangles(const Generator& generator, double detail, uint64_t seed) {
  SceneBuilder counter(detail, seed, nullptr);
  generator.make(counter);
  return counter.Triangles();
}

// The detail whose scene comes nearest to `target`, by bisection on the logarithm. Counts rise with
// detail but for the dither of a few objects, so the nearest of all that were tried is kept.
double FitDetail(const Generator& generator, uint64_t target, uint64_t seed,
                 const CancelToken* cancel) {
  double low = 0x1p-14, high = 0x1p12, best = low;
  uint64_t best_error = UINT64_MAX;
  for (int step = 0; step < 40 && best_error != 0; ++step) {
    if (cancel != nullptr && cancel->cancelled()) break;
    const double middle = std::sqrt(low * high);
    const uint64_t count = CountTriangles(generator, middle, seed);
    const uint64_t error = count > target ? count - target : target - count;
    if (error < best_error) {
      best_error = error;
      best = middle;
    }
    (count > target ? high : low) = middle;
  }
  return best;
}

}  // namespace

std::span<const BuiltinInfo> BuiltinScenes() { return kInfos; }

absl::StatusOr<BuiltinSpec> ParseBuiltin(std::string_view text) {
  BuiltinSpec spec;
  const size_t name_end = text.find_first_of(":,");
  const absl::StatusOr<size_t> index = Find(text.substr(0, name_end));
  if (!index.ok()) return index.status();
  spec.name = kInfos[*index].name;
  const auto bad = [&](std::string_view part, std::string_view remedy) {
    return absl::InvalidArgumentError(absl::StrCat("built-in scene '", std::string(text), "': '",
                                                   std::string(part), "' ", std::string(remedy)));
  };
  bool first = name_end != std::string_view::npos && text[name_end] == ':';
  size_t at = name_end;
  while (at != std::string_view::npos) {
    const size_t end = text.find(',', at + 1);
    const std::string_view part =
        text.substr(at + 1, end == std::string_view::npos ? end : end - at - 1);
    constexpr std::string_view kSeed = "seed=";
    if (part.substr(0, kSeed.size()) == kSeed) {
      const std::optional<uint64_t> seed = ParseWhole(part.substr(kSeed.size()));
      if (!seed.has_value()) return bad(part, "is no seed; give a whole number below 2^64");
      spec.seed = *seed;
    } else if (first) {
      const std::optional<uint64_t> count = ParseCount(part);
      if (!count.has_value()) {
        return bad(part, "is no number of triangles; give one such as 1000000, 250k or 2M");
      }
      if (absl::Status status = CheckTarget(kInfos[*index], *count); !status.ok()) return status;
      spec.target_triangles = *count;
    } else {
      return bad(part, "is no option; the only one is seed=N, and the size stands before it");
    }
    first = false;
    at = end;
  }
  return spec;
}

std::string FormatBuiltin(const BuiltinSpec& spec) {
  const absl::StatusOr<size_t> index = Find(spec.name);
  SIGHTLINE_CHECK(index.ok()) << spec.name;
  const uint64_t target =
      spec.target_triangles == 0 ? kInfos[*index].default_triangles : spec.target_triangles;
  return absl::StrCat(spec.name, ":", target, ",seed=", spec.seed);
}

absl::StatusOr<BuiltinScene> MakeBuiltin(const BuiltinSpec& spec, const CancelToken* cancel) {
  const absl::StatusOr<size_t> index = Find(spec.name);
  if (!index.ok()) return index.status();
  const BuiltinInfo& info = kInfos[*index];
  const Generator& generator = kGenerators[*index];
  const uint64_t target =
      spec.target_triangles == 0 ? info.default_triangles : spec.target_triangles;
  if (absl::Status status = CheckTarget(info, target); !status.ok()) return status;

  BuiltinScene scene;
  const double detail = FitDetail(generator, target, spec.seed, cancel);
  SceneBuilder builder(detail, spec.seed, &scene.objects, cancel);
  generator.make(builder);
  if (cancel != nullptr && cancel->cancelled()) return cancel->ToStatus();
  SIGHTLINE_CHECK(builder.Triangles() == CountTriangles(generator, detail, spec.seed));
  scene.views = generator.views(spec.seed);
  if (info.name == "office") scene.many_lights = OfficeLights();
  return scene;
}

}  // namespace sightline
