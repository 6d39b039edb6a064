// SPDX-License-Identifier: Apache-2.0
//
// The generators behind builtin.h, one file each: a Make function writes the objects to a
// SceneBuilder, a Views function gives the cameras and lights. What a generator writes depends on
// (detail, seed) alone.
//
// Thread safety: one thread per SceneBuilder.
//
//   SceneBuilder scene(1.0, seed, &objects);
//   MakeHall(scene);
#ifndef SIGHTLINE_CORE_MESH_BUILTIN_GENERATORS_H_
#define SIGHTLINE_CORE_MESH_BUILTIN_GENERATORS_H_

#include <cstdint>
#include <vector>

#include "core/mesh/builtin/builtin.h"
#include "core/mesh/builtin/scene_builder.h"

namespace sightline {

void MakeHall(SceneBuilder& scene);
void MakeRoom(SceneBuilder& scene);
void MakeOffice(SceneBuilder& scene);
void MakePlants(SceneBuilder& scene);
void MakeCity(SceneBuilder& scene);
void MakeForest(SceneBuilder& scene);
void MakeSphere(SceneBuilder& scene);
void MakeTerrain(SceneBuilder& scene);
void MakeBox(SceneBuilder& scene);

std::vector<BuiltinView> HallViews(uint64_t seed);
std::vector<BuiltinView> RoomViews(uint64_t seed);
std::vector<BuiltinView> OfficeViews(uint64_t seed);
std::vector<BuiltinView> PlantsViews(uint64_t seed);
std::vector<BuiltinView> CityViews(uint64_t seed);
std::vector<BuiltinView> ForestViews(uint64_t seed);
std::vector<BuiltinView> SphereViews(uint64_t seed);
std::vector<BuiltinView> TerrainViews(uint64_t seed);
std::vector<BuiltinView> BoxViews(uint64_t seed);

// Where the office's ceiling lights hang.
std::vector<Vec3d> OfficeLights();

// A view with its suns at 60, 30 and 8 degrees in the three azimuths (degrees from east toward
// north), and a level square area light of half size `area_half` around the second light.
inline BuiltinView MakeView(Vec3d eye, Vec3d at, double fov_y_degrees, std::vector<Vec3d> lights,
                            Vec3d azimuths, double area_half) {
  return {.eye = eye,
          .at = at,
          .up = {0, 0, 1},
          .fov_y_degrees = fov_y_degrees,
          .lights = lights,
          .suns = {DirectionDegrees(azimuths.x, 60), DirectionDegrees(azimuths.y, 30),
                   DirectionDegrees(azimuths.z, 8)},
          .area = {.center = lights[1], .u = {area_half, 0, 0}, .v = {0, area_half, 0}}};
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_BUILTIN_GENERATORS_H_
