// SPDX-License-Identifier: Apache-2.0
//
// The engine itself beside the papers' methods: the rays that their walks were timed with, asked as
// a query asks, by the predicate over the ordinary BVH, for the same results; and the rows that say
// by how much it is faster than the fastest of theirs.
//
// Thread safety: none; one thread's own.
//
//   EnginePicture engine(scene, 512, 512, /*side=*/4);
//   AddBeside("camera", 512 * 512, engine.Beside({"theirs", trace}), 5, &report);
//   SL_RETURN_IF_ERROR(engine.CheckSame(TracePackets(...)));
#ifndef SIGHTLINE_TESTS_BENCH_PAPERS_ENGINE_H_
#define SIGHTLINE_TESTS_BENCH_PAPERS_ENGINE_H_

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "core/geometry/camera.h"
#include "core/query/options.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "tests/bench/paper_report.h"
#include "tests/bench/papers/picture.h"

namespace sightline::bench {

// A way to ask rays that belong together: what a query does if nothing is said, and what that
// chooses among, each alone.
struct EngineWay {
  const char* name;
  Strategy strategy;
  QueryOptions options() const { return {.strategy = strategy, .structure = Structure::kBvh}; }
};
inline constexpr std::array kEngineWays = {
    EngineWay{"AUTO, BVH", Strategy::kAuto}, EngineWay{"SHAFT, BVH", Strategy::kShaft},
    EngineWay{"PACKET, BVH", Strategy::kPacket}, EngineWay{"SINGLE, BVH", Strategy::kSingle}};

// A way and what it takes to answer its questions once.
struct TimedWay {
  std::string name;
  std::function<void()> run;
};

// Rays that are asked by any of these ways. `scene` must outlive it, and have a BVH when it is
// asked.
class EngineRays {
 public:
  explicit EngineRays(const PaperScene& scene) : scene_(scene) {}
  virtual ~EngineRays() = default;
  EngineRays(const EngineRays&) = delete;  // Calls point to it.
  EngineRays& operator=(const EngineRays&) = delete;

  // A call that asks so.
  std::function<void()> Trace(const QueryOptions& options) {
    return [this, options] { status_.Update(Ask(options)); };
  }
  // The paper's way, and then the engine's.
  std::vector<TimedWay> Beside(TimedWay papers);
  // Asks by each of the engine's ways, and CHECKs that they find `hits`, the paper's. The first
  // error of these and all calls before.
  absl::Status CheckSame(const std::vector<Hit>& hits);

 protected:
  const PaperScene& scene() const { return scene_; }

 private:
  virtual absl::Status Ask(const QueryOptions& options) = 0;
  virtual bool Found(const std::vector<Hit>& hits) const = 0;  // By the last call.

  const PaperScene& scene_;
  absl::Status status_;
};

// A picture as MakePicture has it in packets of `side` by `side`, by TraceTile: which triangle each
// pixel sees, and how far.
class EnginePicture : public EngineRays {
 public:
  EnginePicture(const PaperScene& scene, uint32_t width, uint32_t height, int side);

 private:
  absl::Status Ask(const QueryOptions& options) override;
  bool Found(const std::vector<Hit>& hits) const override;

  const size_t side_;
  Camera camera_;
  TileResult result_;
};

// Shadow rays as ShadowsOf has them, by ComputeShadows: whether the light reaches each target. In
// their order: packets are neighbours already.
class EngineShadows : public EngineRays {
 public:
  // `shadows` must outlive it.
  EngineShadows(const PaperScene& scene, const Picture& shadows);

 private:
  absl::Status Ask(const QueryOptions& options) override;
  bool Found(const std::vector<Hit>& hits) const override;

  const Picture& shadows_;
  std::vector<uint8_t> valid_;
  LightSample light_;
  ShadowResult result_;
};

// Rays one by one, over the BVH. As TraceSingly.
std::vector<Hit> TraceSinglyByEngine(const IndexedGeometry& scene,
                                     const std::vector<TraceRay>& rays, bool any, WalkStats* stats);

// Times the ways by turns, the paper's fastest first, and adds a row for each to the table that is
// open: seconds, million of its `rays` a second, and how many times as fast as the first one. A
// sentence says what the fastest of the others reaches.
void AddBeside(const std::string& what, double rays, const std::vector<TimedWay>& ways,
               uint64_t repeats, PaperReport* report);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_PAPERS_ENGINE_H_
