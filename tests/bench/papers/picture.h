// SPDX-License-Identifier: Apache-2.0
//
// Scenes and rays of the papers' tables over real scenes: a picture's camera rays as packets of any
// square size or one by one, shadow rays from a light to what they hit, and paths that bounce off
// it.
//
// Packets are filled within the timed call, in every variant alike. Single thread.
//
// Thread safety: functions over their arguments.
//
//   SL_ASSIGN_OR_RETURN(PaperScene scene, ReadPaperScene("builtin:hall", options, pool));
//   const Picture picture = MakePicture(scene, 512, 512, /*side=*/4);
//   std::vector<Hit> hits = TracePackets(scene.indexed, culling, picture, &stats);
#ifndef SIGHTLINE_TESTS_BENCH_PAPERS_PICTURE_H_
#define SIGHTLINE_TESTS_BENCH_PAPERS_PICTURE_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "core/accel/indexed_geometry.h"
#include "core/base/parallel.h"
#include "core/mesh/builtin/builtin.h"
#include "core/traverse/culled_kernels.h"
#include "core/traverse/leaf_culling.h"
#include "core/traverse/trace_ray.h"
#include "tests/bench/papers/papers.h"

namespace sightline::bench {

struct PaperScene {
  std::string name;
  IndexedGeometry indexed;  // Without any tree.
  BuiltinView view;         // The scene's first.
};
// A built-in scene, or a file within the options' folder. NotFound: there is no such file.
absl::StatusOr<PaperScene> ReadPaperScene(const std::string& name, const PaperOptions& options,
                                          ThreadPool& pool);

// As ReadPaperScene, but a file that is not there is none: the report names it as not measured.
absl::StatusOr<std::optional<PaperScene>> ReadIfThere(const std::string& paper,
                                                      const std::string& name,
                                                      const PaperOptions& options,
                                                      PaperReport* report, Context& context,
                                                      ThreadPool& pool);

// Targets (directions of camera rays, ends of segments) in the order of packets.
struct Picture {
  Vec3f origin;
  bool segments = false;
  int packet_rays = 0;
  std::vector<Vec3f> targets;
  std::vector<uint32_t> sources;  // Of the targets; empty: none.
};
// REQUIRES: `side` divides the width and the height, and is at most 16.
Picture MakePicture(const PaperScene& scene, uint32_t width, uint32_t height, int side);

// From the light to what the picture's rays hit, packet by packet; a ray that hit nothing goes to
// the packet's first hit (paper 004, section 5), and packets without any are left out.
Picture ShadowsOf(const PaperScene& scene, const Picture& picture, const std::vector<Hit>& hits,
                  Vec3d light);

// What a path tracer asks, each ray naming the triangle that it begins or ends on.
struct Paths {
  std::vector<TraceRay> closest;  // Every path's camera ray, then its bounces.
  std::vector<TraceRay> any;      // To each of their hits, from the light.
};
// A path begins with every `step`th of the picture's rays, and bounces `depth` times: into a
// direction about the normal of what it hit, on the side that it came from, as likely as its cosine
// (what a matt surface reflects). REQUIRES: the scene has a kd-tree.
Paths PathsOf(const PaperScene& scene, const Picture& picture, size_t step, int depth, Vec3d light);

std::vector<TraceRay> RaysOf(const Picture& picture);

// REQUIRES, of both: the scene has the tree that `culling` names. Any hit where the picture's rays
// are segments, else closest; by `trace`, if given, in place of the engine's walk.
std::vector<Hit> TracePackets(const IndexedGeometry& scene, const LeafCulling& culling,
                              const Picture& picture, WalkStats* stats,
                              TraceCulledPacketFn trace = nullptr);
std::vector<Hit> TraceSingly(const IndexedGeometry& scene, const LeafCulling& culling,
                             const std::vector<TraceRay>& rays, bool any, WalkStats* stats);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_PAPERS_PICTURE_H_
