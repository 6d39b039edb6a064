// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/papers/engine.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/base/check.h"
#include "core/light/light.h"
#include "core/traverse/kernels.h"
#include "tests/bench/papers/papers.h"

namespace sightline::bench {

std::vector<TimedWay> EngineRays::Beside(TimedWay papers) {
  std::vector<TimedWay> ways = {std::move(papers)};
  for (const EngineWay& way : kEngineWays) ways.push_back({way.name, Trace(way.options())});
  return ways;
}

absl::Status EngineRays::CheckSame(const std::vector<Hit>& hits) {
  for (const EngineWay& way : kEngineWays) {
    Trace(way.options())();
    if (!status_.ok()) return status_;
    SIGHTLINE_CHECK(Found(hits)) << way.name << " finds something else than the paper's way, in "
                                 << scene_.name;
  }
  return status_;
}

EnginePicture::EnginePicture(const PaperScene& scene, uint32_t width, uint32_t height, int side)
    : EngineRays(scene), side_(static_cast<size_t>(side)) {
  const BuiltinView& view = scene.view;
  const auto camera = LookAt(view.eye, view.at, view.up, view.fov_y_degrees, width, height);
  SIGHTLINE_CHECK(camera.ok()) << camera.status();
  camera_ = *camera;
}

absl::Status EnginePicture::Ask(const QueryOptions& options) {
  return TraceTile(scene().indexed, camera_, {0, 0, camera_.width, camera_.height}, {},
                   {.hits = false, .ids = true, .depth = true}, options, &result_);
}

bool EnginePicture::Found(const std::vector<Hit>& hits) const {
  const size_t columns = camera_.width / side_, rays = side_ * side_;
  if (hits.size() != result_.triangle.size() || hits.size() != result_.depth.size()) return false;
  for (size_t i = 0; i < hits.size(); ++i) {
    const size_t packet = i / rays, ray = i % rays;
    const size_t x = packet % columns * side_ + ray % side_;
    const size_t y = packet / columns * side_ + ray / side_;
    const size_t pixel = y * camera_.width + x;
    if (hits[i].triangle != result_.triangle[pixel] ||
        std::bit_cast<uint32_t>(hits[i].t) != std::bit_cast<uint32_t>(result_.depth[pixel])) {
      return false;
    }
  }
  return true;
}

EngineShadows::EngineShadows(const PaperScene& scene, const Picture& shadows)
    : EngineRays(scene), shadows_(shadows), valid_(shadows.targets.size(), 1) {
  light_.value = shadows.origin;
}

absl::Status EngineShadows::Ask(const QueryOptions& options) {
  return ComputeShadows(scene().indexed, {shadows_.targets, shadows_.sources, valid_}, {&light_, 1},
                        {}, {.ordered = true}, {}, options, &result_);
}

bool EngineShadows::Found(const std::vector<Hit>& hits) const {
  if (result_.lit_bits.size() != (hits.size() + 7) / 8) return false;
  for (size_t i = 0; i < hits.size(); ++i) {
    const bool lit = (result_.lit_bits[i / 8] >> (i % 8) & 1) != 0;
    if (lit != (hits[i].triangle == kNoTriangle)) return false;
  }
  return true;
}

std::vector<Hit> TraceSinglyByEngine(const IndexedGeometry& scene,
                                     const std::vector<TraceRay>& rays, bool any,
                                     WalkStats* stats) {
  const Kernels& kernels = KernelsFor(SimdTarget::kBest);
  std::vector<Hit> hits(rays.size());
  (any ? kernels.occluded_single : kernels.closest_single)(scene, rays, hits, nullptr, stats);
  return hits;
}

void AddBeside(const std::string& what, double rays, const std::vector<TimedWay>& ways,
               uint64_t repeats, PaperReport* report) {
  SIGHTLINE_CHECK_GE(ways.size(), 2u);
  std::vector<std::function<void()>> calls;
  for (const TimedWay& way : ways) calls.push_back(way.run);
  const std::vector<double> seconds = SecondsByTurns(calls, repeats);
  for (size_t i = 0; i < ways.size(); ++i) {
    report->Add({{"asked", what},
                 {"way", ways[i].name},
                 {"seconds", seconds[i]},
                 {"Mrays_per_s", rays / seconds[i] * 1e-6},
                 {"times_paper", seconds[0] / seconds[i]}});
  }
  const size_t best =
      static_cast<size_t>(std::min_element(seconds.begin() + 1, seconds.end()) - seconds.begin());
  report->Conclude(
      absl::StrFormat("%s: %s is %.2f times as fast as the fastest of the paper's "
                      "ways (%s).",
                      what, ways[best].name, seconds[0] / seconds[best], ways[0].name));
}

}  // namespace sightline::bench
