// SPDX-License-Identifier: Apache-2.0
//
// A block of points, put to one light sample after another: what ComputeShadows and the lit outputs
// of tiles share. The points are laid out once for all samples. Internal to core/query.
//
// Thread safety: belongs to one thread.
//
//   SampleTracer tracer(scene, run, HitKind::kAny, /*t_min=*/0, &stats);
//   tracer.SetPoints(positions, sources);
//   SL_RETURN_IF_ERROR(tracer.Trace(sample));
//   ... tracer.triangle(i) == kNoTriangle: point i is lit.
#ifndef SIGHTLINE_CORE_QUERY_SAMPLE_TRACER_H_
#define SIGHTLINE_CORE_QUERY_SAMPLE_TRACER_H_

#include <cstdint>
#include <span>

#include "absl/status/status.h"
#include "core/accel/indexed_geometry.h"
#include "core/light/light.h"
#include "core/query/query_run.h"
#include "core/query/ray_block.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

class SampleTracer {
 public:
  // `t_min` as in ShadowOptions. All references must outlive the tracer.
  SampleTracer(const IndexedGeometry& scene, const QueryRun& run, HitKind kind, double t_min,
               QueryStats* stats)
      : scene_(scene), run_(run), kind_(kind), t_min_(t_min), stats_(stats) {}

  // At most kBlockRays points, all valid; kept by reference until the next call.
  void SetPoints(std::span<const Vec3f> positions, std::span<const uint32_t> sources);

  // A sample that is a point starts the segments, one that is a direction is what rays from the
  // points run toward. REQUIRES: sample.valid. On success triangle(i) is the first or, for kAny,
  // some blocker of point i.
  absl::Status Trace(const LightSample& sample);

  size_t count() const { return positions_.size(); }
  uint32_t triangle(size_t i) const { return triangles_[i]; }
  float t(size_t i) const { return packet_.t[i]; }  // kClosest only.
  // 64 points from 64·word: bit i set where point i is lit. Bits past the last point are 0.
  uint64_t LitBits(size_t word) const;

 private:
  absl::Status TraceOneByOne(const LightSample& sample, uint32_t mask);
  void LayOut(const LightSample& sample, float* x, float* y, float* z, uint32_t* sources);

  const IndexedGeometry& scene_;
  const QueryRun& run_;
  const HitKind kind_;
  const double t_min_;
  QueryStats* const stats_;
  std::span<const Vec3f> positions_;
  std::span<const uint32_t> sources_;
  bool packet_ready_ = false, parallel_ready_ = false;  // Rows hold the points.
  const uint32_t* triangles_ = nullptr;
  RayPacket packet_;
  ParallelPacket parallel_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_SAMPLE_TRACER_H_
