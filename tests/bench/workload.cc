// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/workload.h"

#include <algorithm>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace sightline::bench {

absl::StatusOr<std::unique_ptr<Workload>> MakeWorkload(const WorkloadSpec& spec,
                                                       const SceneSource& source,
                                                       const IndexedGeometry& scene,
                                                       ThreadPool& pool) {
  if (scene.bvh.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", source.name, "' has no triangle that can be hit"));
  }
  SL_RETURN_IF_ERROR(CheckOptions(scene, spec.options));
  if (spec.name == "segments") return MakeSegmentWorkload(spec, source, scene, pool);
  if (spec.name == "points") return MakePointWorkload(spec, source, scene, pool);
  if (source.views.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", source.name, "' has no views: workload ", spec.name,
                     " needs --views, or a views.json beside the scene file"));
  }
  if (spec.name == "primary") return MakePrimaryWorkload(spec, source, scene, pool);
  if (spec.name == "shadow" || spec.name == "sun" || spec.name == "area") {
    return MakePointWorkload(spec, source, scene, pool);
  }
  return absl::InvalidArgumentError(absl::StrCat("unknown workload '", spec.name, "'"));
}

std::string Describe(const WorkloadSpec& spec) {
  if (spec.name != "points") return spec.name;
  return absl::StrCat(spec.name, "-", spec.lights, spec.shuffled ? "-shuffled" : "");
}

absl::StatusOr<Camera> ViewCamera(const WorkloadSpec& spec, const BuiltinView& view) {
  return LookAt(view.eye, view.at, view.up, view.fov_y_degrees, spec.width, spec.height);
}

std::vector<TileRect> CutImage(uint32_t width, uint32_t height, uint32_t side) {
  std::vector<TileRect> tiles;
  for (uint32_t y = 0; y < height; y += side) {
    for (uint32_t x = 0; x < width; x += side) {
      tiles.push_back({x, y, std::min(side, width - x), std::min(side, height - y)});
    }
  }
  return tiles;
}

}  // namespace sightline::bench
