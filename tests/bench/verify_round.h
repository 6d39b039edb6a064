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
#include <span>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
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
    bool culls = false;  // Within leaves; packets of 8×8.
    std::string Name() const;
  };
  // Says whether element i of a comparison agrees, and if not describes it.
  using Same = std::function<bool(size_t i, std::string* what)>;

  // AUTO, and two others by lot.
  std::vector<Way> SomeWays();
  QueryOptions Ask(const Way& way) const;
  void Compare(absl::string_view kind, const Way& way, absl::string_view reference, size_t count,
               const Same& same);
  bool BruteForceAllowed() const;
  uint64_t BruteForceRays() const;  // That a round can afford; at least 1.

  void RunTiles();
  void CompareTiles(const Way& way, absl::string_view reference, const TileResult& got,
                    const TileResult& truth, size_t samples);
  void CheckPixels(const CameraCase& camera, const Way& way, const TileResult& got);
  void RunShadows(PreparedPoints points);
  void CompareShadows(const Way& way, absl::string_view reference, const ShadowResult& got,
                      const ShadowResult& truth, size_t points, size_t samples);
  void CheckPairs(const PreparedPoints& points, std::span<const LightSample> samples,
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
};

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_VERIFY_ROUND_H_
