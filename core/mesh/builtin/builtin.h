// SPDX-License-Identifier: Apache-2.0
//
// Sightline's own scenes: made, not read, so that tests, demo and benchmarks need no file. Each is
// sized by a number of triangles up to ten million and comes with three views of the kind the
// benchmark uses.
//
// - Deterministic: the same spec gives the same bits on every
//   machine and compiler (no libm function whose last digit is
//   open, our own random numbers, one order of operations).
// - Sized by finer tessellation and more furniture, leaves
//   and windows, not by copies: within 10 % of the target.
//   What a view looks at stays where it is at every size.
// - Metres, z up, x east and y north, in every scene.
// - Vertices are shared by index within an object; columns,
//   balls, blocks, pots, branches and buildings are closed
//   solids (every directed edge has its reverse once) with
//   fronts outward. Grounds, leaves and rugs are sheets.
//
// Thread safety: pure functions; a scene is plain data.
//
//   SL_ASSIGN_OR_RETURN(BuiltinSpec spec, ParseBuiltin("forest:2M,seed=7"));
//   SL_ASSIGN_OR_RETURN(BuiltinScene scene, MakeBuiltin(spec));  // scene.views[0].eye, ...
#ifndef SIGHTLINE_CORE_MESH_BUILTIN_BUILTIN_H_
#define SIGHTLINE_CORE_MESH_BUILTIN_BUILTIN_H_

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/geometry/vec3.h"
#include "core/mesh/object.h"

namespace sightline {

// A rectangle of light: center ± u ± v.
struct BuiltinAreaLight {
  Vec3d center, u, v;
};

// A camera and its lights, for 16:9 pictures. Written down before any tuning: do not tune to them.
struct BuiltinView {
  Vec3d eye, at, up;
  double fov_y_degrees = 60;
  std::vector<Vec3d> lights;  // Three points that leave about 90, 50 and 10 % of the view lit.
  std::vector<Vec3d>
      suns;               // Unit directions toward the sun, 60, 30 and 8 degrees above the horizon.
  BuiltinAreaLight area;  // Around the second light.
};

struct BuiltinScene {
  std::vector<ObjectInput> objects;  // Uniquely named, without transforms.
  std::vector<BuiltinView> views;    // Three.
  std::vector<Vec3d> many_lights;    // The office's sixteen ceiling lights; empty elsewhere.
};

inline constexpr uint64_t kMaxBuiltinTriangles = 10'000'000;
inline constexpr uint64_t kDefaultBuiltinSeed = 1;

struct BuiltinSpec {
  std::string name;
  uint64_t target_triangles = 0;  // 0: the scene's default.
  uint64_t seed = kDefaultBuiltinSeed;

  friend bool operator==(const BuiltinSpec&, const BuiltinSpec&) = default;
};

struct BuiltinInfo {
  std::string_view name;
  std::string_view description;  // One line, for --help.
  uint64_t default_triangles;
  uint64_t min_triangles;  // The least target that can be met.
};

// Every built-in scene, in the order of the documentation.
std::span<const BuiltinInfo> BuiltinScenes();

// Reads NAME[:TRIANGLES][,seed=N], without the "builtin:" of the command line; TRIANGLES is a whole
// number or one with k or M behind it ("250k", "2M", "1.5M"). InvalidArgument names what is wrong,
// the known names or the limits.
absl::StatusOr<BuiltinSpec> ParseBuiltin(std::string_view text);

// "NAME:TRIANGLES,seed=N", every part written out: what ParseBuiltin reads back as the same scene.
// REQUIRES: a known name.
std::string FormatBuiltin(const BuiltinSpec& spec);

// Makes the scene: up to some seconds for ten million triangles. InvalidArgument for an unknown
// name or a target outside [min_triangles, kMaxBuiltinTriangles]; the status of `cancel` once that
// stops, which is looked at between objects.
absl::StatusOr<BuiltinScene> MakeBuiltin(const BuiltinSpec& spec,
                                         const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_BUILTIN_BUILTIN_H_
