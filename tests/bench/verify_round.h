// SPDX-License-Identifier: Apache-2.0
//
// One round of the soak: a case, put to the engine in several ways, and the comparisons.
//
// Thread safety: a round runs on one thread; rounds of one scene may run side by side.
//
//   VerifyReport report;
//   VerifyRound(scene, options, Random(seed, number), "batch 3, round 5", &report).Run();
#ifndef SIGHTLINE_TESTS_BENCH_VERIFY_ROUND_H_
#define SIGHTLINE_TESTS_BENCH_VERIFY_ROUND_H_

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "core/query/mirrors.h"
#include "core/query/options.h"
#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "core/traverse/trace_ray.h"
#include "tests/bench/random.h"
#include "tests/bench/verify.h"
#include "tests/bench/verify_cases.h"

namespace sightline::bench {

class VerifyRound {
 public:
  VerifyRound(const VerifyScene& scene, const VerifyOptions& options, Random random,
              std::string name, VerifyReport* report);
  void Run();

 private:
  struct Way {
    Strategy strategy = Strategy::kAuto;
    SimdTarget simd = SimdTarget::kBest;
    Structure structure = Structure::kAuto;
    std::optional<LeafCulling> culling = std::nullopt;
    int packet_side = 16;
    bool pixel_shadow_packets = false;
    bool bit_by_bit = false;  // Points handed over in parts, each with the hints of the last.
    // Of the tallies: without what is drawn by lot for each round.
    std::string Name() const;
  };
  // Says whether element i of a comparison agrees, and if not describes it.
  using Same = std::function<bool(size_t i, std::string* what)>;

  // AUTO, one other on the BVH by lot, and one more: on another tree where the scene has one.
  std::vector<Way> SomeWays();
  Way OtherOnBvh();
  Way OnAnotherTree();
  LeafCulling SomeCulling();
  QueryOptions Ask(const Way& way) const;
  void Compare(absl::string_view kind, const Way& way, absl::string_view reference, size_t count,
               const Same& same);
  bool BruteForceAllowed() const;
  uint64_t BruteForceRays() const;  // That a round can afford; at least 1.

  void RunTiles();
  void CompareTiles(const Way& way, absl::string_view reference, const TileResult& got,
                    const TileResult& truth, size_t samples);
  void CheckPixels(const CameraCase& camera, const std::vector<Mirror>& mirrors, const Way& way,
                   const TileResult& got);
  Hit WalkPixel(const CameraCase& camera, const PreparedMirrors& mirrors, uint32_t x,
                uint32_t y) const;
  void RunShadows(PreparedPoints points);
  void CompareShadows(const Way& way, absl::string_view reference, const ShadowResult& got,
                      const ShadowResult& truth, size_t points, size_t samples);
  void CompareBitByBit(const PreparedPoints& points, std::span<const LightSample> samples,
                       double t_min, const ShadowResult& truth);
  void CheckPairs(const PreparedPoints& points, std::span<const LightSample> samples, double t_min,
                  const Way& way, const ShadowResult& got);
  void RunSegments();
  void CompareSegments(const Way& way, absl::string_view reference, const SegmentResult& got,
                       const SegmentResult& truth, size_t first);

  const VerifyScene& scene_;
  const VerifyOptions& options_;
  Random random_;
  const std::string name_;
  VerifyReport& report_;
  uint32_t mask_ = 0xFFFFFFFFu;
  bool rtt_shared_edges_ = false;
};

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_VERIFY_ROUND_H_
