// SPDX-License-Identifier: Apache-2.0
//
// The scene of a benchmark: a mesh file with the views that a file of views holds for it, or a
// built-in scene with its own views. Read before anything is timed.
//
// The file of views is JSON, an object by unpacked file name ("bunny.ply" also for bunny.ply.xz):
//   {"bunny.ply": {"up": [0, 1, 0], "views": [{
//      "eye": [x, y, z], "at": [x, y, z], "fov_y_deg": 60, "lights": [[x, y, z], ...],
//      "suns": [[x, y, z], ...], "area": {"center": [..], "u": [..], "v": [..]}}, ...]}}
// World coordinates; suns are directions toward the sun; the area light is center ± u ± v.
//
// Thread safety: plain values and functions.
//
//   SL_ASSIGN_OR_RETURN(SceneSource source, ReadScene("bunny.ply.xz", /*views_file=*/""));
//   SL_ASSIGN_OR_RETURN(IndexedGeometry scene, IndexScene(source, {}, pool));
#ifndef SIGHTLINE_TESTS_BENCH_BENCH_SCENE_H_
#define SIGHTLINE_TESTS_BENCH_BENCH_SCENE_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "core/accel/binary_bvh_builder.h"
#include "core/accel/bvh_builder.h"
#include "core/accel/indexed_geometry.h"
#include "core/accel/kd_builder.h"
#include "core/base/parallel.h"
#include "core/mesh/builtin/builtin.h"
#include "core/mesh/object.h"

namespace sightline::bench {

struct SceneSource {
  std::string name;  // "bunny.ply", "builtin:hall:1M".
  std::vector<ObjectInput> objects;
  std::vector<BuiltinView> views;  // Empty where none are known.
  Vec3d up{0, 0, 1};               // The scene's; what the sky is above.
};

// `scene` is a file that client/import reads, builtin:NAME[:TRIANGLES][,seed=N], or the same
// without "builtin:" where no such file exists. `views_file` empty: views.json beside the scene
// file, or a built-in scene's own views; a scene without views there has none (not an error). With
// a `views_file`, the scene has to be in it.
absl::StatusOr<SceneSource> ReadScene(const std::string& scene, const std::string& views_file);

// What is built over a scene.
struct IndexOptions {
  BvhBuildOptions bvh = {};
  std::optional<KdBuildOptions> kd_tree = std::nullopt;
  std::optional<BinaryBvhOptions> binary_bvh = std::nullopt;
};

// Compiles and builds on the pool.
absl::StatusOr<IndexedGeometry> IndexScene(const SceneSource& source, const IndexOptions& options,
                                           ThreadPool& pool);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_BENCH_SCENE_H_
