// SPDX-License-Identifier: Apache-2.0
//
// The peer: Embree 3 over the very vertex floats and indices of a compiled scene, and every way of
// asking it that the benchmark chooses from.
//
// A mode is an entry point (single rays, packets of 4, 8 or 16, streams), the coherent flag, the
// end that rays start from, and whether points are sorted. Packets are filled in the order of the
// arrays given, which for pixels is 2×2 in 4×4 (Morton) order: Embree's best. Points may be sorted
// first, at the cost of the sorting. What does not change from packet to packet is written once.
//
// Segments are handed over as they are: from one end to the other, tnear = 0, tfar = 1. Embree
// knows no source triangles; the points it gets are placed off their surfaces already. Rays that
// run to the light and rays that come from it are both tried. Those that come from it often find
// their own receiver just before their end, 2 to 17 % of them, since Embree rounds the
// distance: wrong, but after the whole way has been walked, so that it costs as much as the right
// answer. An epsilon at that end (tfar < 1) was tried: it lets light through single sheets instead,
// on up to 15 % of the rays of a terrain.
//
// Flush-to-zero and denormals-are-zero are set around every call here, as Embree asks, and put back
// afterwards.
//
// Thread safety: a built EmbreeScene may be traced by any number of threads. Building uses Embree's
// own threads, as many as the device was opened with.
//
//   SL_ASSIGN_OR_RETURN(auto device, EmbreeDevice::Open(2, SimdTarget::kBest));
//   PeerMesh mesh(geometry);
//   SL_ASSIGN_OR_RETURN(auto scene, EmbreeScene::Build(*device, mesh, {}));
//   TracePoints(*scene, mode, positions, sample, lit_bits);
#ifndef SIGHTLINE_TESTS_BENCH_EMBREE_PEER_H_
#define SIGHTLINE_TESTS_BENCH_EMBREE_PEER_H_

#include <embree3/rtcore.h>
#include <immintrin.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "core/base/aligned_vector.h"
#include "core/base/parallel.h"
#include "core/geometry/camera.h"
#include "core/light/light.h"
#include "core/mesh/object.h"
#include "core/mesh/scene_geometry.h"
#include "core/query/tiles.h"
#include "core/traverse/simd_target.h"

namespace sightline::bench {

class EmbreeDevice {
 public:
  // With `simd` kAvx2, Embree uses no wider instructions either.
  static absl::StatusOr<std::unique_ptr<EmbreeDevice>> Open(int threads, SimdTarget simd);
  ~EmbreeDevice();
  EmbreeDevice(const EmbreeDevice&) = delete;
  EmbreeDevice& operator=(const EmbreeDevice&) = delete;

  RTCDevice get() const { return device_; }
  // What Embree's memory monitor says is allocated now. Buffers that it shares are not in it.
  int64_t allocated_bytes() const { return allocated_; }
  // "Embree 3.13.5".
  static std::string Name();

 private:
  EmbreeDevice() = default;
  static bool OnMemory(void* self, ssize_t bytes, bool post);
  RTCDevice device_ = nullptr;
  std::atomic<int64_t> allocated_{0};
};

struct EmbreeOptions {
  // Of scene and geometry alike. kLow and kRefit are what Embree offers for dynamic scenes: a scene
  // of quality LOW, flagged as dynamic, with its geometry of quality LOW or REFIT.
  enum class Quality : uint8_t { kLow, kMedium, kHigh, kRefit };
  Quality quality = Quality::kHigh;
  bool robust = true;
  bool compact = false;
};

// A geometry's floats and indices as Embree wants to share them: with something readable behind the
// last vertex, since it loads four floats at a time.
class PeerMesh {
 public:
  explicit PeerMesh(const SceneGeometry& geometry);
  // The same of objects as they were read: doubles placed in the world, relative to `origin`,
  // rounded, and the objects' indices put together; on the pool. What a user of Embree has to do,
  // without the checks that CompileScene makes.
  PeerMesh(std::span<const ObjectInput> objects, Vec3d origin, ThreadPool& pool);
  const AlignedVector<Vec3f>& vertices() const { return vertices_; }
  const AlignedVector<std::array<uint32_t, 3>>& triangles() const { return triangles_; }
  size_t vertex_count() const { return vertices_.size() - 1; }
  size_t triangle_count() const { return triangles_.size() - 1; }
  // Of both buffers, without what stands behind the last element.
  size_t bytes() const;

 private:
  // On huge pages, as ours are.
  AlignedVector<Vec3f> vertices_;
  AlignedVector<std::array<uint32_t, 3>> triangles_;
};

class EmbreeScene {
 public:
  // From arrays to ready to be traced. The buffers are shared, not copied; triangles that are inert
  // to us go along. REQUIRES: `device` and `mesh` outlive the scene.
  static absl::StatusOr<std::unique_ptr<EmbreeScene>> Build(const EmbreeDevice& device,
                                                            const PeerMesh& mesh,
                                                            const EmbreeOptions& options);
  ~EmbreeScene();
  EmbreeScene(const EmbreeScene&) = delete;
  EmbreeScene& operator=(const EmbreeScene&) = delete;

  // As after vertices moved. With kRefit the structure is fitted to them, else built anew.
  void CommitMovedVertices();
  RTCScene get() const { return scene_; }

 private:
  EmbreeScene() = default;
  RTCScene scene_ = nullptr;
  RTCGeometry geometry_ = nullptr;
};

struct PeerMode {
  enum class Entry : uint8_t { kSingle = 1, kPacket4 = 4, kPacket8 = 8, kPacket16 = 16, kStream };
  enum class Start : uint8_t { kEye, kLight, kPoint };
  Entry entry = Entry::kSingle;
  bool coherent = false;
  Start start = Start::kEye;
  // Of points alone: sorted in space first (peer_order.h), and the bits put back. TracePoints takes
  // points as they come; whoever calls it sorts.
  bool sorted = false;

  std::string Name() const;  // "packet16 coherent from light, sorted".
};

// Every entry × flag × start; if they may be `sorted`, each with and without.
std::vector<PeerMode> AllModes(std::span<const PeerMode::Start> starts, bool sorted = false);

// What is seen through the pixels, in row-major order of the image: as TraceTile's outputs, with
// misses marked alike.
struct ImageArrays {
  AlignedVector<float> depth, u, v;
  AlignedVector<uint32_t> triangle;
  void Resize(size_t pixels);
};

// The rays of a camera, to the bit those of PixelDirection, made the fast way: what depends on a
// column alone and what depends on a row alone is tabled in doubles, and one addition is left.
class CameraRays {
 public:
  // REQUIRES: the eye can be rebased (TraceTile refuses the camera otherwise).
  CameraRays(const Camera& camera, Vec3d origin);

  Vec3f eye() const { return eye_; }
  // The directions of pixels (x, y), (x+1, y), (x, y+1), (x+1, y+1), for x and y even and within
  // the image; those beyond an odd side repeat the last.
  void Directions(uint32_t x, uint32_t y, float* dx, float* dy, float* dz) const {
    float* const out[3] = {dx, dy, dz};
    for (int axis = 0; axis < 3; ++axis) {
      const __m256d columns =
          _mm256_broadcast_pd(reinterpret_cast<const __m128d*>(&column_[axis][x]));
      const __m256d rows =
          _mm256_permute4x64_pd(_mm256_castpd128_pd256(_mm_loadu_pd(&row_[axis][y])), 0b01010000);
      _mm_storeu_ps(out[axis], _mm256_cvtpd_ps(_mm256_add_pd(columns, rows)));
    }
  }

 private:
  Vec3f eye_;
  std::vector<double> column_[3], row_[3];  // Padded to an even number by repeating the last.
};

// Where a tile's results go. A tile in one piece past the caches, as TileOutputs::past_caches has
// it: better for whoever keeps a whole picture.
enum class TileWrites : uint8_t { kUsual, kPastCaches };

// The first triangle through each pixel of the tile. `image_width` pixels to a row of the arrays.
// REQUIRES: the tile begins on even pixels; past the caches it has 64 × 64 at most.
void TraceCameraTile(const EmbreeScene& scene, PeerMode mode, const CameraRays& rays,
                     const TileRect& tile, uint32_t image_width, TileWrites writes,
                     ImageArrays* image);

// Bit i: nothing stands between the sample and positions[i]. (n + 7) / 8 bytes, the rest of the
// last one zero. A directional sample's rays start at the points whatever the mode says.
void TracePoints(const EmbreeScene& scene, PeerMode mode, std::span<const Vec3f> positions,
                 const LightSample& sample, uint8_t* lit_bits);

// Bit i: something blocks the segment; rays run from `from` with Start::kLight, else from `to`.
void TraceSegments(const EmbreeScene& scene, PeerMode mode, std::span<const Vec3f> from,
                   std::span<const Vec3f> to, uint8_t* blocked_bits);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_EMBREE_PEER_H_
