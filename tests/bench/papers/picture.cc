// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/papers/picture.h"

#include <filesystem>
#include <memory>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/geometry/camera.h"
#include "core/mesh/scene_geometry.h"
#include "tests/bench/bench_scene.h"
#include "tests/bench/random.h"

namespace sightline::bench {

absl::StatusOr<PaperScene> ReadPaperScene(const std::string& name, const PaperOptions& options,
                                          ThreadPool& pool) {
  std::string path = name;
  if (!absl::StartsWith(name, "builtin:")) {
    path = absl::StrCat(options.scenes_folder, "/", name);
    if (!std::filesystem::exists(path)) {
      return absl::NotFoundError(absl::StrCat("there is no '", path, "'"));
    }
  }
  SL_ASSIGN_OR_RETURN(const SceneSource source, ReadScene(path, /*views_file=*/""));
  if (source.views.empty()) {
    return absl::InvalidArgumentError(absl::StrCat("'", path, "' has no views"));
  }
  absl::StatusOr<SceneGeometry> geometry = absl::UnknownError("not compiled");
  pool.ParallelFor(1, 1, [&](size_t, size_t) {
    geometry = CompileScene(source.objects, std::nullopt, MeshLimits{});
  });
  SL_RETURN_IF_ERROR(geometry.status());
  PaperScene scene;
  scene.name = source.name;
  scene.indexed.geometry = *std::move(geometry);
  scene.view = source.views[0];
  return scene;
}

absl::StatusOr<std::optional<PaperScene>> ReadIfThere(const std::string& paper,
                                                      const std::string& name,
                                                      const PaperOptions& options,
                                                      PaperReport* report, Context& context,
                                                      ThreadPool& pool) {
  absl::StatusOr<PaperScene> scene = ReadPaperScene(name, options, pool);
  if (scene.ok()) return *std::move(scene);
  if (!absl::IsNotFound(scene.status())) return scene.status();
  context.err << scene.status().message() << ": left out" << std::endl;
  report->NotMeasured(paper, name, std::string(scene.status().message()));
  return std::nullopt;
}

Picture MakePicture(const PaperScene& scene, uint32_t width, uint32_t height, int side) {
  const BuiltinView& view = scene.view;
  const auto camera = LookAt(view.eye, view.at, view.up, view.fov_y_degrees, width, height);
  SIGHTLINE_CHECK(camera.ok()) << camera.status();
  const auto step = static_cast<uint32_t>(side);
  SIGHTLINE_CHECK(side >= 1 && side <= 16 && width % step == 0 && height % step == 0);
  Picture picture;
  picture.origin = ToFloat(view.eye - scene.indexed.geometry.origin);
  picture.packet_rays = side * side;
  picture.targets.reserve(size_t{width} * height);
  for (uint32_t y0 = 0; y0 < height; y0 += step) {
    for (uint32_t x0 = 0; x0 < width; x0 += step) {
      for (uint32_t i = 0; i < step * step; ++i) {
        picture.targets.push_back(PixelDirection(*camera, x0 + i % step, y0 + i / step));
      }
    }
  }
  return picture;
}

Picture ShadowsOf(const PaperScene& scene, const Picture& picture, const std::vector<Hit>& hits,
                  Vec3d light) {
  Picture shadows;
  shadows.origin = ToFloat(light - scene.indexed.geometry.origin);
  shadows.segments = true;
  shadows.packet_rays = picture.packet_rays;
  const auto size = static_cast<size_t>(picture.packet_rays);
  for (size_t first = 0; first < hits.size(); first += size) {
    size_t filler = first;
    while (filler < first + size && hits[filler].triangle == kNoTriangle) ++filler;
    if (filler == first + size) continue;
    for (size_t i = first; i < first + size; ++i) {
      const size_t from = hits[i].triangle == kNoTriangle ? filler : i;
      shadows.targets.push_back(picture.origin + picture.targets[from] * hits[from].t);
      shadows.sources.push_back(hits[from].triangle);
    }
  }
  return shadows;
}

namespace {

Vec3d OnUnitSphere(Random& random) {
  for (;;) {
    const Vec3d v{random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(-1, 1)};
    const double length = Length(v);
    if (length > 0.1 && length <= 1) return v * (1 / length);
  }
}

// About the normal of the triangle, on the side that the ray came from: a sphere that touches the
// surface there has as much of itself in a direction as the cosine says.
Vec3f Bounce(const SceneGeometry& geometry, uint32_t triangle, Vec3f came, Random& random) {
  const auto [a, b, c] = geometry.Corners(triangle);
  const Vec3d ad = ToDouble(a), normal = Cross(ToDouble(b) - ad, ToDouble(c) - ad);
  const double turn = Dot(normal, ToDouble(came)) > 0 ? -1 : 1;
  const Vec3d up = normal * (turn / Length(normal)), along = up + OnUnitSphere(random);
  return ToFloat(Length(along) > 1e-3 ? along : up);
}

}  // namespace

Paths PathsOf(const PaperScene& scene, const Picture& picture, size_t step, int depth,
              Vec3d light) {
  LeafCulling culling = LeafCulling::None();
  culling.tree = CulledTree::kKdTree;
  const Vec3f from = ToFloat(light - scene.indexed.geometry.origin);
  Random random(17);
  Paths paths;
  std::vector<TraceRay> rays;
  for (size_t i = 0; i < picture.targets.size(); i += step) {
    rays.push_back({.ray = PredicateRay::Ray(picture.origin, picture.targets[i])});
  }
  for (int bounce = 0; bounce <= depth; ++bounce) {
    WalkStats stats;
    const std::vector<Hit> hits = TraceSingly(scene.indexed, culling, rays, /*any=*/false, &stats);
    std::vector<TraceRay> next;
    for (size_t i = 0; i < rays.size(); ++i) {
      if (hits[i].triangle == kNoTriangle) continue;
      const PredicateRay& ray = rays[i].ray;
      const Vec3f at = ray.origin + ray.target * hits[i].t;
      paths.any.push_back({.ray = PredicateRay::Segment(from, at), .to_source = hits[i].triangle});
      next.push_back({.ray = PredicateRay::Ray(
                          at, Bounce(scene.indexed.geometry, hits[i].triangle, ray.target, random)),
                      .from_source = hits[i].triangle});
    }
    paths.closest.insert(paths.closest.end(), rays.begin(), rays.end());
    rays = std::move(next);
  }
  return paths;
}

std::vector<TraceRay> RaysOf(const Picture& picture) {
  std::vector<TraceRay> rays(picture.targets.size());
  for (size_t i = 0; i < rays.size(); ++i) {
    rays[i].ray = {picture.origin, picture.targets[i], picture.segments};
    if (!picture.sources.empty()) rays[i].to_source = picture.sources[i];
  }
  return rays;
}

std::vector<Hit> TracePackets(const IndexedGeometry& scene, const LeafCulling& culling,
                              const Picture& picture, WalkStats* stats, TraceCulledPacketFn trace) {
  const CulledKernels& kernels = CulledKernelsFor(SimdTarget::kBest);
  if (trace == nullptr) trace = picture.segments ? kernels.occluded_packet : kernels.closest_packet;
  std::vector<Hit> hits(picture.targets.size());
  const auto packet = std::make_unique<RayPacket>();
  packet->origin = picture.origin;
  packet->segments = picture.segments;
  packet->count = picture.packet_rays;
  const auto size = static_cast<size_t>(picture.packet_rays);
  for (size_t first = 0; first < hits.size(); first += size) {
    for (size_t i = 0; i < size; ++i) {
      packet->target_x[i] = picture.targets[first + i].x;
      packet->target_y[i] = picture.targets[first + i].y;
      packet->target_z[i] = picture.targets[first + i].z;
      packet->target_source[i] = picture.sources.empty() ? kNoTriangle : picture.sources[first + i];
    }
    trace(scene, culling, *packet, nullptr, stats);
    for (size_t i = 0; i < size; ++i) hits[first + i] = packet->hit(static_cast<int>(i));
  }
  return hits;
}

std::vector<Hit> TraceSingly(const IndexedGeometry& scene, const LeafCulling& culling,
                             const std::vector<TraceRay>& rays, bool any, WalkStats* stats) {
  const CulledKernels& kernels = CulledKernelsFor(SimdTarget::kBest);
  std::vector<Hit> hits(rays.size());
  (any ? kernels.occluded_single : kernels.closest_single)(scene, culling, rays, hits, nullptr,
                                                           stats);
  return hits;
}

}  // namespace sightline::bench
