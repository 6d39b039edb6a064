// SPDX-License-Identifier: Apache-2.0
//
// How the peer is asked: filling rays, calling Embree, writing results.
#include <immintrin.h>

#include <algorithm>
#include <array>
#include <limits>
#include <type_traits>

#include "core/base/check.h"
#include "tests/bench/embree_peer.h"

namespace sightline::bench {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// Rays of one call of a stream: 48 KiB of them, which stay in the second-level cache.
constexpr size_t kStreamRays = 1024;
static_assert(kStreamRays % 8 == 0);

// Flush-to-zero and denormals-are-zero, as Embree wants its threads, until the end of the scope.
class ScopedFlushToZero {
 public:
  ScopedFlushToZero() : saved_(_mm_getcsr()) { _mm_setcsr(saved_ | kBoth); }
  ~ScopedFlushToZero() { _mm_setcsr(saved_); }
  ScopedFlushToZero(const ScopedFlushToZero&) = delete;
  ScopedFlushToZero& operator=(const ScopedFlushToZero&) = delete;

 private:
  static constexpr unsigned kBoth = 0x8040;
  const unsigned saved_;
};

RTCIntersectContext MakeContext(bool coherent) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags =
      coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  return context;
}

template <int N>
struct Packet;
template <>
struct Packet<4> {
  using Ray = RTCRay4;
  using RayHit = RTCRayHit4;
  static constexpr auto kOccluded = &rtcOccluded4;
  static constexpr auto kIntersect = &rtcIntersect4;
};
template <>
struct Packet<8> {
  using Ray = RTCRay8;
  using RayHit = RTCRayHit8;
  static constexpr auto kOccluded = &rtcOccluded8;
  static constexpr auto kIntersect = &rtcIntersect8;
};
template <>
struct Packet<16> {
  using Ray = RTCRay16;
  using RayHit = RTCRayHit16;
  static constexpr auto kOccluded = &rtcOccluded16;
  static constexpr auto kIntersect = &rtcIntersect16;
};

// What no packet changes.
template <int N>
void SetConstants(typename Packet<N>::Ray* ray) {
  for (int lane = 0; lane < N; ++lane) {
    ray->tnear[lane] = 0;
    ray->time[lane] = 0;
    ray->mask[lane] = 0xFFFFFFFFu;
    ray->id[lane] = 0;
    ray->flags[lane] = 0;
  }
}

// ---- Any hit

// Rays by number: where ray i starts and where it leads. Either may be the same for all.
struct Ends {
  std::span<const Vec3f> from, to;  // Of one element where all rays share it.
  bool directions = false;          // `to` holds directions: rays without an end.

  size_t size() const { return std::max(from.size(), to.size()); }
  bool one_origin() const { return from.size() == 1; }
  bool one_target() const { return to.size() == 1; }
};

// Bits of lanes that were found occluded: Embree sets tfar to -inf.
template <int N>
uint32_t OccludedBits(const float* tfar) {
  if constexpr (N == 4) {
    return static_cast<uint32_t>(_mm_movemask_ps(_mm_load_ps(tfar)));
  } else {
    uint32_t bits = 0;
    for (int lane = 0; lane < N; lane += 8) {
      bits |= static_cast<uint32_t>(_mm256_movemask_ps(_mm256_load_ps(tfar + lane))) << lane;
    }
    return bits;
  }
}

template <int N>
void OccludedPackets(RTCScene scene, RTCIntersectContext* context, const Ends& ends, bool invert,
                     uint8_t* bits) {
  alignas(64) typename Packet<N>::Ray ray;
  alignas(64) int valid[N];
  SetConstants<N>(&ray);
  const size_t n = ends.size();
  const bool one_origin = ends.one_origin(), one_target = ends.one_target();
  const float tfar = ends.directions ? kInfinity : 1.0f;
  std::fill(bits, bits + (n + 7) / 8, uint8_t{0});
  for (size_t first = 0; first < n; first += N) {
    const size_t count = std::min<size_t>(N, n - first);
    for (size_t lane = 0; lane < N; ++lane) {
      const size_t i = first + std::min(lane, count - 1);
      const Vec3f from = ends.from[one_origin ? 0 : i];
      const Vec3f to = ends.to[one_target ? 0 : i];
      const Vec3f along = ends.directions ? to : to - from;
      ray.org_x[lane] = from.x;
      ray.org_y[lane] = from.y;
      ray.org_z[lane] = from.z;
      ray.dir_x[lane] = along.x;
      ray.dir_y[lane] = along.y;
      ray.dir_z[lane] = along.z;
      ray.tfar[lane] = tfar;
      valid[lane] = lane < count ? -1 : 0;
    }
    Packet<N>::kOccluded(valid, scene, context, &ray);
    uint32_t found = OccludedBits<N>(ray.tfar);
    if (invert) found = ~found;
    found &= (1u << count) - 1;  // N <= 16.
    bits[first / 8] |= static_cast<uint8_t>(found << (first % 8));
    if (N == 16 && first + 8 < n) bits[first / 8 + 1] = static_cast<uint8_t>(found >> 8);
  }
}

void FillRay(const Ends& ends, size_t i, RTCRay* ray) {
  const Vec3f from = ends.from[ends.one_origin() ? 0 : i];
  const Vec3f to = ends.to[ends.one_target() ? 0 : i];
  const Vec3f along = ends.directions ? to : to - from;
  *ray = {.org_x = from.x,
          .org_y = from.y,
          .org_z = from.z,
          .tnear = 0,
          .dir_x = along.x,
          .dir_y = along.y,
          .dir_z = along.z,
          .time = 0,
          .tfar = ends.directions ? kInfinity : 1.0f,
          .mask = 0xFFFFFFFFu,
          .id = 0,
          .flags = 0};
}

void OccludedSingle(RTCScene scene, RTCIntersectContext* context, const Ends& ends, bool invert,
                    uint8_t* bits) {
  const size_t n = ends.size();
  for (size_t first = 0; first < n; first += 8) {
    uint32_t byte = 0;
    for (size_t i = first; i < std::min(first + 8, n); ++i) {
      RTCRay ray;
      FillRay(ends, i, &ray);
      rtcOccluded1(scene, context, &ray);
      byte |= static_cast<uint32_t>((ray.tfar < 0) != invert) << (i - first);
    }
    bits[first / 8] = static_cast<uint8_t>(byte);
  }
}

void OccludedStream(RTCScene scene, RTCIntersectContext* context, const Ends& ends, bool invert,
                    uint8_t* bits) {
  alignas(64) std::array<RTCRay, kStreamRays> rays;
  const size_t n = ends.size();
  for (size_t first = 0; first < n; first += kStreamRays) {
    const size_t count = std::min(kStreamRays, n - first);
    for (size_t i = 0; i < count; ++i) FillRay(ends, first + i, &rays[i]);
    rtcOccluded1M(scene, context, rays.data(), static_cast<unsigned>(count), sizeof(RTCRay));
    for (size_t i = 0; i < count; i += 8) {
      uint32_t byte = 0;
      for (size_t k = i; k < std::min(i + 8, count); ++k) {
        byte |= static_cast<uint32_t>((rays[k].tfar < 0) != invert) << (k - i);
      }
      bits[(first + i) / 8] = static_cast<uint8_t>(byte);
    }
  }
}

// Bit i: ray i is blocked, or free with `invert`.
void Occluded(const EmbreeScene& scene, PeerMode mode, const Ends& ends, bool invert,
              uint8_t* bits) {
  const ScopedFlushToZero flush;
  RTCIntersectContext context = MakeContext(mode.coherent);
  switch (mode.entry) {
    case PeerMode::Entry::kSingle:
      return OccludedSingle(scene.get(), &context, ends, invert, bits);
    case PeerMode::Entry::kPacket4:
      return OccludedPackets<4>(scene.get(), &context, ends, invert, bits);
    case PeerMode::Entry::kPacket8:
      return OccludedPackets<8>(scene.get(), &context, ends, invert, bits);
    case PeerMode::Entry::kPacket16:
      return OccludedPackets<16>(scene.get(), &context, ends, invert, bits);
    case PeerMode::Entry::kStream:
      return OccludedStream(scene.get(), &context, ends, invert, bits);
  }
}

// ---- First hit

// Four pixels of a 2×2 square, as CameraRays::Directions numbers them.
struct Quad {
  uint32_t x, y;
};

// The quads of a tile: 4×4 blocks row by row, four quads in each. Those outside an odd tile are
// among them.
class Quads {
 public:
  explicit Quads(const TileRect& tile)
      : tile_(tile), columns_((tile.width + 3) / 4), rows_((tile.height + 3) / 4) {}
  uint32_t count() const { return columns_ * rows_ * 4; }
  Quad operator[](uint32_t i) const {
    const uint32_t block = i / 4;
    return {tile_.x + block % columns_ * 4 + (i & 1) * 2, tile_.y + block / columns_ * 4 + (i & 2)};
  }

 private:
  const TileRect tile_;
  const uint32_t columns_, rows_;
};

// Arrays for some pixels of an image, those from (x, y) on, in rows `stride` pixels apart.
struct PixelArrays {
  float *depth, *u, *v;
  uint32_t* triangle;
  uint32_t x, y;
  size_t stride;
};

class CameraTile {
 public:
  CameraTile(const CameraRays& rays, const TileRect& tile, const PixelArrays& out)
      : rays_(rays),
        quads_(tile),
        end_x_(tile.x + tile.width),
        end_y_(tile.y + tile.height),
        out_(out) {}

  template <int N>
  void Packets(RTCScene scene, RTCIntersectContext* context) {
    alignas(64) typename Packet<N>::RayHit packet;
    alignas(64) int valid[N];
    SetConstants<N>(&packet.ray);
    for (int lane = 0; lane < N; ++lane) {
      packet.ray.org_x[lane] = rays_.eye().x;
      packet.ray.org_y[lane] = rays_.eye().y;
      packet.ray.org_z[lane] = rays_.eye().z;
      packet.hit.instID[0][lane] = RTC_INVALID_GEOMETRY_ID;
    }
    for (uint32_t q = 0; q < quads_.count(); q += N / 4) {
      for (int k = 0; k < N / 4; ++k) {
        const Quad quad = quads_[q + static_cast<uint32_t>(k)];
        const bool inside = Inside(quad);
        const Quad source = inside ? quad : quads_[q];
        if (inside || Inside(source)) {
          rays_.Directions(source.x, source.y, packet.ray.dir_x + 4 * k, packet.ray.dir_y + 4 * k,
                           packet.ray.dir_z + 4 * k);
        }
        for (uint32_t i = 0; i < 4; ++i) {
          valid[4 * k + static_cast<int>(i)] = inside && Inside(quad, i) ? -1 : 0;
        }
      }
      for (int lane = 0; lane < N; ++lane) {
        packet.ray.tfar[lane] = kInfinity;
        packet.hit.geomID[lane] = RTC_INVALID_GEOMETRY_ID;
        packet.hit.primID[lane] = RTC_INVALID_GEOMETRY_ID;
        packet.hit.u[lane] = 0;
        packet.hit.v[lane] = 0;
      }
      Packet<N>::kIntersect(valid, scene, context, &packet);
      for (int k = 0; k < N / 4; ++k) {
        const Quad quad = quads_[q + static_cast<uint32_t>(k)];
        if (!Inside(quad)) continue;
        Write(quad, packet.ray.tfar + 4 * k, out_.depth);
        Write(quad, packet.hit.primID + 4 * k, out_.triangle);
        Write(quad, packet.hit.u + 4 * k, out_.u);
        Write(quad, packet.hit.v + 4 * k, out_.v);
      }
    }
  }

  void Single(RTCScene scene, RTCIntersectContext* context) {
    for (uint32_t q = 0; q < quads_.count(); ++q) {
      RTCRayHit rays[4];
      const uint32_t count = FillRays(quads_[q], rays);
      for (uint32_t i = 0; i < count; ++i) rtcIntersect1(scene, context, &rays[i]);
      WriteRays(rays, count);
    }
  }

  void Stream(RTCScene scene, RTCIntersectContext* context) {
    alignas(64) std::array<RTCRayHit, kStreamRays> rays;
    uint32_t count = 0;
    for (uint32_t q = 0; q < quads_.count(); ++q) {
      count += FillRays(quads_[q], &rays[count]);
      if (count + 4 <= kStreamRays && q + 1 < quads_.count()) continue;
      rtcIntersect1M(scene, context, rays.data(), count, sizeof(RTCRayHit));
      WriteRays(rays.data(), count);
      count = 0;
    }
  }

 private:
  bool Inside(Quad quad) const { return quad.x < end_x_ && quad.y < end_y_; }
  bool Inside(Quad quad, uint32_t i) const {
    return quad.x + (i & 1) < end_x_ && quad.y + (i >> 1) < end_y_;
  }
  size_t PixelOf(Quad quad, uint32_t i) const {
    return (quad.y - out_.y + (i >> 1)) * out_.stride + quad.x - out_.x + (i & 1);
  }

  // Two pixels at a time where all four are inside.
  template <typename T>
  void Write(Quad quad, const T* values, T* image) const {
    static_assert(sizeof(T) == sizeof(float));
    if (Inside(quad, 3)) {
      const __m128 four = _mm_load_ps(reinterpret_cast<const float*>(values));
      _mm_storel_pi(reinterpret_cast<__m64*>(image + PixelOf(quad, 0)), four);
      _mm_storeh_pi(reinterpret_cast<__m64*>(image + PixelOf(quad, 2)), four);
      return;
    }
    for (uint32_t i = 0; i < 4; ++i) {
      if (Inside(quad, i)) image[PixelOf(quad, i)] = values[i];
    }
  }

  // Rays of the quad's pixels inside the tile; each remembers its pixel in its id.
  uint32_t FillRays(Quad quad, RTCRayHit* rays) const {
    if (!Inside(quad)) return 0;
    float dx[4], dy[4], dz[4];
    rays_.Directions(quad.x, quad.y, dx, dy, dz);
    uint32_t count = 0;
    for (uint32_t i = 0; i < 4; ++i) {
      if (!Inside(quad, i)) continue;
      RTCRayHit& one = rays[count++];
      one.ray = {.org_x = rays_.eye().x,
                 .org_y = rays_.eye().y,
                 .org_z = rays_.eye().z,
                 .tnear = 0,
                 .dir_x = dx[i],
                 .dir_y = dy[i],
                 .dir_z = dz[i],
                 .time = 0,
                 .tfar = kInfinity,
                 .mask = 0xFFFFFFFFu,
                 .id = static_cast<unsigned>(PixelOf(quad, i)),
                 .flags = 0};
      one.hit.u = 0;
      one.hit.v = 0;
      one.hit.primID = RTC_INVALID_GEOMETRY_ID;
      one.hit.geomID = RTC_INVALID_GEOMETRY_ID;
      one.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    }
    return count;
  }

  void WriteRays(const RTCRayHit* rays, uint32_t count) const {
    for (uint32_t i = 0; i < count; ++i) {
      const size_t pixel = rays[i].ray.id;
      out_.depth[pixel] = rays[i].ray.tfar;
      out_.triangle[pixel] = rays[i].hit.primID;
      out_.u[pixel] = rays[i].hit.u;
      out_.v[pixel] = rays[i].hit.v;
    }
  }

  const CameraRays& rays_;
  const Quads quads_;
  const uint32_t end_x_, end_y_;
  const PixelArrays out_;
};

// A tile's rows, `width` pixels each, to those of an image past the caches.
template <typename T>
void StreamRows(const T* from, uint32_t width, uint32_t rows, size_t stride, T* to) {
  static_assert(std::is_trivially_copyable_v<T>);
  constexpr size_t kLanes = sizeof(__m256i) / sizeof(T);
  for (; rows > 0; --rows, from += width, to += stride) {
    if (reinterpret_cast<uintptr_t>(to) % sizeof(__m256i) != 0 || width % kLanes != 0) {
      std::copy_n(from, width, to);
      continue;
    }
    for (size_t x = 0; x < width; x += kLanes) {
      _mm256_stream_si256(reinterpret_cast<__m256i*>(to + x),
                          _mm256_loadu_si256(reinterpret_cast<const __m256i*>(from + x)));
    }
  }
}

}  // namespace

void TraceCameraTile(const EmbreeScene& scene, PeerMode mode, const CameraRays& rays,
                     const TileRect& tile, uint32_t image_width, TileWrites writes,
                     ImageArrays* image) {
  static_assert(RTC_INVALID_GEOMETRY_ID == kNoTriangle, "a miss is marked alike on both sides");
  const ScopedFlushToZero flush;
  RTCIntersectContext context = MakeContext(mode.coherent);
  // Small enough for the second-level cache.
  constexpr uint32_t kMostPixels = 64 * 64;
  alignas(64) float depth[kMostPixels], u[kMostPixels], v[kMostPixels];
  alignas(64) uint32_t triangle[kMostPixels];
  const bool aside = writes == TileWrites::kPastCaches;
  if (aside) SIGHTLINE_CHECK_LE(uint64_t{tile.width} * tile.height, kMostPixels);
  const PixelArrays own = {depth, u, v, triangle, tile.x, tile.y, tile.width};
  const PixelArrays all = {
      image->depth.data(), image->u.data(), image->v.data(), image->triangle.data(), 0, 0,
      image_width};
  CameraTile tracer(rays, tile, aside ? own : all);
  switch (mode.entry) {
    case PeerMode::Entry::kSingle:
      tracer.Single(scene.get(), &context);
      break;
    case PeerMode::Entry::kPacket4:
      tracer.Packets<4>(scene.get(), &context);
      break;
    case PeerMode::Entry::kPacket8:
      tracer.Packets<8>(scene.get(), &context);
      break;
    case PeerMode::Entry::kPacket16:
      tracer.Packets<16>(scene.get(), &context);
      break;
    case PeerMode::Entry::kStream:
      tracer.Stream(scene.get(), &context);
      break;
  }
  if (!aside) return;
  const size_t first = size_t{tile.y} * image_width + tile.x;
  const auto stream = [&](const auto* from, auto* to) {
    StreamRows(from, tile.width, tile.height, image_width, to + first);
  };
  stream(depth, all.depth);
  stream(triangle, all.triangle);
  stream(u, all.u);
  stream(v, all.v);
  _mm_sfence();
}

void TracePoints(const EmbreeScene& scene, PeerMode mode, std::span<const Vec3f> positions,
                 const LightSample& sample, uint8_t* lit_bits) {
  const std::span<const Vec3f> light(&sample.value, 1);
  if (positions.empty()) return;
  if (sample.directional) {
    return Occluded(scene, mode, {positions, light, true}, /*invert=*/true, lit_bits);
  }
  if (mode.start == PeerMode::Start::kLight) {
    return Occluded(scene, mode, {light, positions, false}, /*invert=*/true, lit_bits);
  }
  Occluded(scene, mode, {positions, light, false}, /*invert=*/true, lit_bits);
}

void TraceSegments(const EmbreeScene& scene, PeerMode mode, std::span<const Vec3f> from,
                   std::span<const Vec3f> to, uint8_t* blocked_bits) {
  if (from.empty()) return;
  if (mode.start == PeerMode::Start::kLight) {
    return Occluded(scene, mode, {from, to, false}, /*invert=*/false, blocked_bits);
  }
  Occluded(scene, mode, {to, from, false}, /*invert=*/false, blocked_bits);
}

}  // namespace sightline::bench
