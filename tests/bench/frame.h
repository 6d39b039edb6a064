// SPDX-License-Identifier: Apache-2.0
//
// One picture with shadows, as a renderer asks for it: what each pixel sees, and which of the
// view's lights reach it. For what it costs to build a scene and draw it once.
//
// The sides place their points as is usual for each: the engine beside the surface (TraceTile), the
// peer a share of kPeerStepBack of the way back to the eye, which costs it least. So the points are
// not the same floats here, and a few pixels along shadow edges differ.
//
// Thread safety: none; each side runs on the pool that the frame was made with.
//
//   SL_ASSIGN_OR_RETURN(Frame frame, Frame::Make(view, 1920, 1080, geometry, pool));
//   frame.DrawOurs(scene, {});
//   frame.DrawPeer(peer, camera_mode, shadow_mode);
#ifndef SIGHTLINE_TESTS_BENCH_FRAME_H_
#define SIGHTLINE_TESTS_BENCH_FRAME_H_

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "core/accel/indexed_geometry.h"
#include "core/base/parallel.h"
#include "core/query/tiles.h"
#include "tests/bench/bench_scene.h"
#include "tests/bench/embree_peer.h"
#include "tests/bench/peer_order.h"

namespace sightline::bench {

inline constexpr float kPeerStepBack = 0x1p-16f;

class Frame {
 public:
  static absl::StatusOr<Frame> Make(const BuiltinView& view, uint32_t width, uint32_t height,
                                    const SceneGeometry& geometry, ThreadPool& pool);

  void DrawOurs(const IndexedGeometry& scene, const QueryOptions& options);
  void DrawPeer(const EmbreeScene& peer, PeerMode camera_mode, PeerMode shadow_mode);

  // Of the last picture of either side: pixel × light pairs that are lit.
  uint64_t our_lit() const;
  uint64_t peer_lit() const;

 private:
  struct PeerTile {
    std::vector<Vec3f> points;
    std::vector<uint8_t> lit_bits;  // A row per light, a bit per point.
    PeerOrder order;                // Where the mode sorts.
    std::vector<uint8_t> sorted_bits;
  };
  Frame(const Camera& camera, std::vector<LightSample> samples, Vec3d origin, ThreadPool& pool);
  void DrawPeerTile(const EmbreeScene& peer, PeerMode camera_mode, PeerMode shadow_mode, size_t t);

  Camera camera_;
  std::vector<LightSample> samples_;
  CameraRays rays_;
  ThreadPool* pool_;
  std::vector<TileRect> tiles_;
  std::vector<TileResult> ours_;  // By tile.
  ImageArrays image_;
  std::vector<PeerTile> peer_;  // By tile.
};

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_FRAME_H_
