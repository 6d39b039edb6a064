// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/papers/predicate_passes.h"

#include <bit>

#include "core/accel/bvh.h"
#include "core/base/check.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/bench/papers/predicate_passes.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: this comes before everything that is compiled once per target.
#include "hwy/foreach_target.h"
// clang-format on

#include "core/traverse/packet_lanes-inl.h"
#include "core/traverse/single-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

// Calls visit(leaf) for sixteen triangles at a time.
template <class Visit>
HWY_INLINE void ForEachLeaf(const bench::PredicateData& data, const Visit& visit) {
  for (uint32_t at = 0; at < data.triangles; at += kMaxLeafTriangles) {
    visit(LeafView(data.rows.data() + at, data.triangles, kMaxLeafTriangles));
  }
}

// One ray, a leaf's triangles in lanes: as a walk of single rays visits a leaf.
template <bool kDistances>
uint64_t PredicateTriangles(bench::PredicateData* data) {
  uint64_t hits = 0;
  WalkStats stats;
  for (const RayPacket& packet : data->packets) {
    for (int i = 0; i < packet.count; ++i) {
      const TraceRay query = packet.trace_ray(i);
      Hit best;
      ForEachLeaf(*data, [&](const LeafView& leaf) HWY_ATTR {
        TestLeaf(leaf, query, data->scene.geometry, &stats, [&](uint32_t lane) HWY_ATTR {
          if constexpr (kDistances) {
            KeepCloser(leaf, lane, query, &best);
          } else {
            best.triangle = leaf.id(lane);
          }
          return false;  // All of them are asked.
        });
      });
      hits += best.triangle != kNoTriangle ? 1 : 0;
    }
  }
  return hits;
}

// A packet's rays in lanes, one triangle after another: as a walk of packets visits a leaf. Lanes
// that are blocked are asked on.
template <bool kDistances>
uint64_t PredicateRays(bench::PredicateData* data) {
  uint64_t hits = 0;
  WalkStats stats;
  for (RayPacket& packet : data->packets) {
    PacketLanes<!kDistances> lanes(data->scene, packet, &stats);
    const uint32_t all = lanes.active(0);
    ForEachLeaf(*data, [&](const LeafView& leaf) HWY_ATTR {
      FacingTriangle facing[kMaxLeafTriangles];
      const uint32_t count = TurnTriangles(lanes, leaf, (1u << kMaxLeafTriangles) - 1, facing);
      for (uint32_t i = 0; i < count; ++i) {
        for (uint32_t g = 0; g < lanes.groups(); ++g) {
          lanes.Test(leaf, facing[i], g, all);
        }
      }
    });
    for (int i = 0; i < packet.count; ++i) hits += packet.triangle[i] != kNoTriangle ? 1 : 0;
  }
  return hits;
}

uint64_t PredicatePass(bench::PassForm form, bool distances, bench::PredicateData* data) {
  if (form == bench::PassForm::kRays) {
    return distances ? PredicateRays<true>(data) : PredicateRays<false>(data);
  }
  return distances ? PredicateTriangles<true>(data) : PredicateTriangles<false>(data);
}

uint64_t PredicatePreparation(bench::PredicateData* data) {
  uint64_t sum = 0;
  WalkStats stats;
  for (RayPacket& packet : data->packets) {
    const PacketLanes<false> lanes(data->scene, packet, &stats);
    ForEachLeaf(*data, [&](const LeafView& leaf) HWY_ATTR {
      FacingTriangle facing[kMaxLeafTriangles];
      const uint32_t count = TurnTriangles(lanes, leaf, (1u << kMaxLeafTriangles) - 1, facing);
      for (uint32_t i = 0; i < count; ++i) sum += std::bit_cast<uint32_t>(facing[i].depth);
    });
  }
  return sum;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline::bench {

uint64_t PredicateData::rays() const {
  uint64_t rays = 0;
  for (const RayPacket& packet : packets) rays += static_cast<uint64_t>(packet.count);
  return rays;
}

PredicateData MakePredicateData(const std::vector<std::array<Vec3f, 3>>& triangles,
                                const std::vector<SyntheticPacket>& packets, size_t packet_rays) {
  SIGHTLINE_CHECK(triangles.size() % kMaxLeafTriangles == 0);
  SIGHTLINE_CHECK(packet_rays >= 1 && packet_rays <= size_t{RayPacket::kMaxRays});
  PredicateData data;
  data.triangles = static_cast<uint32_t>(triangles.size());
  for (int corner = 0; corner < 3; ++corner) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const auto& triangle : triangles) data.rows.push_back(triangle[corner][axis]);
    }
  }
  for (uint32_t id = 0; id < data.triangles; ++id) data.rows.push_back(std::bit_cast<float>(id));
  for (const SyntheticPacket& packet : packets) {
    SIGHTLINE_CHECK(packet.directions.size() % packet_rays == 0 && packet_rays % 8 == 0);
    for (size_t first = 0; first < packet.directions.size(); first += packet_rays) {
      RayPacket& rays = data.packets.emplace_back();
      rays.origin = packet.origin;
      rays.segments = false;
      rays.count = static_cast<int>(packet_rays);
      for (size_t i = 0; i < packet_rays; ++i) {
        const Vec3f d = packet.directions[first + i];
        rays.target_x[i] = d.x;
        rays.target_y[i] = d.y;
        rays.target_z[i] = d.z;
        rays.target_source[i] = kNoTriangle;
      }
    }
  }
  return data;
}

uint64_t RunPredicatePass(PassForm form, int lanes, bool distances, PredicateData* data) {
  SIGHTLINE_CHECK(form != PassForm::kOne && (lanes == 8 || lanes == 16) && HasLanes(lanes));
  return lanes == 16 ? N_AVX3::PredicatePass(form, distances, data)
                     : N_AVX2::PredicatePass(form, distances, data);
}

uint64_t RunPredicatePreparation(int lanes, PredicateData* data) {
  SIGHTLINE_CHECK((lanes == 8 || lanes == 16) && HasLanes(lanes));
  return lanes == 16 ? N_AVX3::PredicatePreparation(data) : N_AVX2::PredicatePreparation(data);
}

}  // namespace sightline::bench
#endif  // HWY_ONCE
