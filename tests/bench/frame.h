// SPDX-License-Identifier: Apache-2.0
//
// One picture with shadows, as a renderer asks for it: what each pixel sees, and which of the
// view's lights reach it. For what it costs to build a scene and draw it once.
//
// Each side makes its points of its own distances, and both in the same way: a share of kStepBack
// of the way back to the eye, the least that keeps most surfaces from shadowing themselves. The
// distances differ in their last bits, so a few pixels along shadow edges do. The engine may also
// place them as TraceTile does: beside all triangles they touch, by a derived bound, so that none
// shadows itself.
//
// Thread safety: none; each side runs on the pool that the frame was made with.
//
//   SL_ASSIGN_OR_RETURN(Frame frame, Frame::Make(view, 1920, 1080, geometry, pool));
//   frame.DrawOurs(scene, Frame::Points::kSteppedBack, {});
//   frame.DrawPeer(peer, camera_mode, shadow_mode);
#ifndef SIGHTLINE_TESTS_BENCH_FRAME_H_
#define SIGHTLINE_TESTS_BENCH_FRAME_H_

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "core/accel/indexed_geometry.h"
#include "core/base/parallel.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "tests/bench/bench_scene.h"
#include "tests/bench/embree_peer.h"
#include "tests/bench/peer_order.h"

namespace sightline::bench {

inline constexpr float kStepBack = 0x1p-16f;

class Frame {
 public:
  enum class Points : uint8_t { kSteppedBack, kPlaced };

  static absl::StatusOr<Frame> Make(const BuiltinView& view, uint32_t width, uint32_t height,
                                    const SceneGeometry& geometry, ThreadPool& pool);

  void DrawOurs(const IndexedGeometry& scene, Points points, const QueryOptions& options);
  void DrawPeer(const EmbreeScene& peer, PeerMode camera_mode, PeerMode shadow_mode);

  // Of the last picture of either side: pixel × light pairs that are lit.
  uint64_t our_lit() const;
  uint64_t peer_lit() const;

 private:
  struct OurTile {
    TileResult result;
    std::vector<Vec3f> points;  // Where they are stepped back.
    std::vector<uint8_t> valid;
    ShadowResult shadows;
  };
  struct PeerTile {
    std::vector<Vec3f> points;
    std::vector<uint8_t> lit_bits;  // A row per light, a bit per point.
    PeerOrder order;                // Where the mode sorts.
    std::vector<uint8_t> sorted_bits;
  };
  Frame(const Camera& camera, std::vector<LightSample> samples, Vec3d origin, ThreadPool& pool);
  // What is seen in a tile, moved toward the eye: 16×16 pixels by 4×4, and by 2×2 in those, as
  // shafts and packets like it. `depth` is the tile's first pixel's, `stride` from row to row.
  void StepBack(const TileRect& tile, const float* depth, size_t stride,
                std::vector<Vec3f>* points) const;
  void DrawSteppedBack(const IndexedGeometry& scene, const QueryOptions& options, size_t t);
  void DrawPeerTile(const EmbreeScene& peer, PeerMode camera_mode, PeerMode shadow_mode, size_t t);

  Camera camera_;
  std::vector<LightSample> samples_;
  CameraRays rays_;
  ThreadPool* pool_;
  std::vector<TileRect> tiles_;
  std::vector<OurTile> ours_;  // By tile.
  ImageArrays image_;
  std::vector<PeerTile> peer_;  // By tile.
};

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_FRAME_H_
