// SPDX-License-Identifier: Apache-2.0
//
// Scenes, and cameras, lights, points and segments in them, for tests that put one question to
// core/query in every way there is: strategy × instruction set × partition × threads.
//
// Thread safety: none.
#ifndef SIGHTLINE_TESTS_PROPERTY_QUERY_CASES_H_
#define SIGHTLINE_TESTS_PROPERTY_QUERY_CASES_H_

#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/accel/bvh_builder.h"
#include "core/accel/indexed_geometry.h"
#include "core/accel/kd_builder.h"
#include "core/geometry/camera.h"
#include "core/light/light.h"
#include "core/query/options.h"
#include "core/query/points.h"
#include "core/query/segments.h"
#include "core/query/tiles.h"
#include "tests/support/random.h"

namespace sightline::testing_support {

struct QueryScene {
  std::string name;
  IndexedGeometry indexed;
  std::vector<Camera> cameras;  // World coordinates, small images.
};

// The nasty scenes of tests/core/traverse, with cameras at odd places. These and the next have a
// kd-tree beside the BVH.
std::vector<QueryScene> MakeNastyQueryScenes(TestRng& rng);
// Built-in scenes at a small size, through their own first view.
std::vector<QueryScene> MakeBuiltinQueryScenes();

// Beside the BVH; a failure fails the test.
void AddKdTree(const KdBuildOptions& options, IndexedGeometry* indexed);

// The same scenes with a BVH built by this preset alone, or with a kd-tree built so.
std::vector<QueryScene> Rebuilt(std::vector<QueryScene> scenes, BvhPreset preset);
std::vector<QueryScene> Rebuilt(std::vector<QueryScene> scenes, const KdBuildOptions& options);

// Point lights outside, amid the points, on a surface and at a vertex, and directions; one is
// invalid.
std::vector<LightSample> MakeSamples(const IndexedGeometry& scene, TestRng& rng);
// Stored points on, near and off the surfaces; some have a source, some are invalid.
PreparedPoints MakePoints(const IndexedGeometry& scene, TestRng& rng, size_t count);
PreparedSegments MakeSegments(const IndexedGeometry& scene, TestRng& rng, size_t count);

// A way of asking.
struct Way {
  Strategy strategy;
  SimdTarget simd;
  Structure structure = Structure::kAuto;
  int rtt_antialiasing = 1;
  bool rtt_shared_edges = false;
  int rtt_side_by_side = 0;
  std::optional<LeafCulling> leaf_culling = {};
  int packet_side = 16;
  bool pixel_shadow_packets = false;
  std::string Name() const;
  QueryOptions Options(uint32_t mask = 0xFFFFFFFFu) const {
    return {.strategy = strategy,
            .structure = structure,
            .rtt_antialiasing = rtt_antialiasing,
            .rtt_shared_edges = rtt_shared_edges,
            .rtt_side_by_side = rtt_side_by_side,
            .leaf_culling = leaf_culling,
            .packet_side = packet_side,
            .pixel_shadow_packets = pixel_shadow_packets,
            .simd = simd,
            .mask = mask};
  }
};
// Every strategy × instruction set of this machine, on the BVH and, if it is there, on the kd-tree,
// with and without culling within leaves; the first is brute force, the reference.
std::vector<Way> AllWays(bool kd_tree = false);
// Those that a scene without a BVH can be asked in.
std::vector<Way> WaysWithoutBvh();
// All of `ways`; under a sanitizer every third, from a random one on, so that scenes share them.
std::vector<Way> InTurn(const std::vector<Way>& ways, TestRng& rng);

// Of two arrays of one kind.
template <typename Array>
bool SameBytes(const Array& a, const Array& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(*a.data())) == 0);
}

inline bool Bit(const std::vector<uint8_t>& bits, size_t i) { return bits[i / 8] >> (i % 8) & 1; }

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_PROPERTY_QUERY_CASES_H_
