// SPDX-License-Identifier: Apache-2.0
#include "client/load/test_scene.h"

#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"
#include "client/cli/cancelled_work.h"
#include "client/cli/formats/table.h"
#include "client/cli/view_choice.h"
#include "core/base/status_macros.h"
#include "core/geometry/camera.h"

namespace sightline::load {
namespace {

// The path runs across the view, over this share of the distance to what is looked at.
constexpr double kPathShare = 0.1;
// Points are taken this share of their depth before the surface, toward the eye: on its lit side.
constexpr double kLift = 1e-3;
// The box of an edit, in shares of the distance from the eye.
constexpr double kBoxPlace = 0.5, kBoxHalf = 0.05;

client::Point3 ToPoint(Vec3d v) { return {v.x, v.y, v.z}; }

client::Camera ToClient(const Camera& camera) {
  return {.eye = ToPoint(camera.eye),
          .right = ToPoint(camera.right),
          .up = ToPoint(camera.up),
          .forward = ToPoint(camera.forward),
          .tan_half_fov_y = camera.tan_half_fov_y,
          .width = camera.width,
          .height = camera.height};
}

struct PathPlace {
  Vec3d eye, at;
};

absl::StatusOr<std::vector<PathPlace>> ReadPath(const std::string& file,
                                                const CancelToken* cancel) {
  SL_ASSIGN_OR_RETURN(const std::vector<double> rows, cli::ReadRows(file, 6, "places", cancel));
  if (rows.empty() || rows.size() > 6 * 32) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", file, "' has ", rows.size() / 6, " places; a path has 1 to 32"));
  }
  std::vector<PathPlace> places;
  for (size_t i = 0; i < rows.size(); i += 6) {
    places.push_back(
        {{rows[i], rows[i + 1], rows[i + 2]}, {rows[i + 3], rows[i + 4], rows[i + 5]}});
  }
  return places;
}

std::vector<PathPlace> PathAcross(const cli::ViewChoice& view, uint64_t count) {
  const Vec3d ahead = view.at - view.eye;
  const Vec3d across = Cross(ahead, view.up);
  // As long as `ahead`, whatever the length of `up`.
  const double length = Length(across);
  const Vec3d step = length > 0 ? across * (kPathShare * Length(ahead) / length) : Vec3d{};
  std::vector<PathPlace> places;
  for (uint64_t i = 0; i < count; ++i) {
    const double t = count == 1 ? 0 : static_cast<double>(i) / static_cast<double>(count - 1) - 0.5;
    places.push_back({view.eye + step * t, view.at});
  }
  return places;
}

// What the pixels of the cameras' images hit, lifted toward the eye.
absl::StatusOr<std::vector<double>> SurfacePoints(const cli::Session& session,
                                                  const std::string& scene,
                                                  const std::vector<client::Camera>& cameras) {
  std::vector<double> points;
  for (const client::Camera& camera : cameras) {
    client::TileQuery query{.scene = scene, .camera = camera, .outputs = {.depths = true}};
    SL_ASSIGN_OR_RETURN(const client::TileImage image,
                        session.client().TraceImage(query, session.stream()));
    const double aspect = static_cast<double>(camera.width) / camera.height;
    for (uint32_t y = 0; y < camera.height; ++y) {
      for (uint32_t x = 0; x < camera.width; ++x) {
        const double depth = image.depth[size_t{y} * camera.width + x];
        if (!std::isfinite(depth)) continue;
        const double sx = (2 * (x + 0.5) / camera.width - 1) * camera.tan_half_fov_y * aspect;
        const double sy = (1 - 2 * (y + 0.5) / camera.height) * camera.tan_half_fov_y;
        for (size_t i = 0; i < 3; ++i) {
          const double direction = camera.forward[i] + camera.right[i] * sx + camera.up[i] * sy;
          points.push_back(camera.eye[i] + direction * (depth * (1 - kLift)));
        }
      }
    }
  }
  return points;
}

ObjectInput Box(const std::string& name, Vec3d center, double half) {
  ObjectInput box{.name = name};
  for (uint32_t i = 0; i < 8; ++i) {
    box.vertices.push_back(center + Vec3d{(i & 1) != 0 ? half : -half, (i & 2) != 0 ? half : -half,
                                          (i & 4) != 0 ? half : -half});
  }
  box.indices = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                 2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
  return box;
}

}  // namespace

absl::StatusOr<TestScene> OpenTestScene(const cli::Session& session, const LoadOptions& options,
                                        std::ostream& err) {
  TestScene test;
  SL_ASSIGN_OR_RETURN(test.opened, cli::OpenScene(session, options.scene, err));
  SL_ASSIGN_OR_RETURN(const cli::ViewChoice view,
                      cli::ChooseView(session, *test.opened, options.scene, options.view,
                                      static_cast<double>(options.width) / options.height));
  std::vector<PathPlace> places = PathAcross(view, options.cameras);
  if (!options.path.empty()) {
    const cli::CancelledWork work(session.call().cancellation);
    SL_ASSIGN_OR_RETURN(places, ReadPath(options.path, work.token()));
  }
  for (const PathPlace& place : places) {
    SL_ASSIGN_OR_RETURN(
        const Camera camera,
        LookAt(place.eye, place.at, view.up, view.fov_y_degrees, options.width, options.height));
    test.cameras.push_back(ToClient(camera));
  }
  SL_ASSIGN_OR_RETURN(test.lights, options.lights.Lights(view.up));
  if (test.lights.empty()) {
    for (const Vec3d& light : view.lights)
      test.lights.push_back(client::Light::Point(ToPoint(light)));
  }
  SL_ASSIGN_OR_RETURN(test.surface,
                      SurfacePoints(session, test.opened->scene().name, test.cameras));
  const Vec3d ahead = places.front().at - places.front().eye;
  test.extra =
      Box("sightline-load", places.front().eye + ahead * kBoxPlace, kBoxHalf * Length(ahead));
  return test;
}

}  // namespace sightline::load
