// SPDX-License-Identifier: Apache-2.0
//
// What is asked of both sides, cut into units that are timed by turns: a view, a view and one of
// its lights, or a share of a set of points. Results stay in the workload, so that they can be
// compared after each side has run a unit.
//
// A unit runs from its arrays (camera, points, segments) to result arrays: cutting into tiles or
// ranges, filling rays and gathering results are within it, on both sides, and both cut alike. The
// arrays themselves (the view's hits, the surface points) are made before anything is timed.
//
// Thread safety: none; RunOurs and RunPeer use the pool that the workload was made with.
//
//   SL_ASSIGN_OR_RETURN(auto workload, MakeWorkload(spec, source, scene, pool));
//   workload->RunOurs(0);
//   workload->RunPeer(peer, mode, 0, Share::kAll);
//   Agreement agreement;
//   workload->Compare(0, &agreement);
#ifndef SIGHTLINE_TESTS_BENCH_WORKLOAD_H_
#define SIGHTLINE_TESTS_BENCH_WORKLOAD_H_

#include <cstdint>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "absl/hash/hash.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/accel/indexed_geometry.h"
#include "core/base/parallel.h"
#include "core/query/options.h"
#include "tests/bench/agreement.h"
#include "tests/bench/bench_scene.h"
#include "tests/bench/embree_peer.h"

namespace sightline::bench {

// One side of the square tiles that an image is cut into, in pixels: the unit of work of a thread.
inline constexpr uint32_t kTileSide = 64;
// The share of the work that picks the peer's mode: one tile or range in so many, or one light of
// all ranges.
inline constexpr size_t kSampleStep = 16;

enum class Share : uint8_t { kAll, kSample };

class Workload {
 public:
  explicit Workload(const QueryOptions& options) : options_(options) {}
  virtual ~Workload() = default;

  // How the engine is asked from here on.
  void Use(const QueryOptions& options) { options_ = options; }

  virtual size_t units() const = 0;
  virtual uint64_t queries(size_t unit) const = 0;
  // How many views they come from (0 if from none), and which one a unit does. REQUIRES of view():
  // they come from views.
  virtual size_t views() const = 0;
  virtual size_t view(size_t unit) const = 0;
  // What the peer may be asked in.
  virtual std::vector<PeerMode> peer_modes() const = 0;
  // Whether a sample pays more for sorting than its share: it sorts all points for a few of the
  // lights. A mode that sorts can then be slower on it, and yet faster on the whole.
  virtual bool sample_overpays_sorting() const { return false; }

  virtual void RunOurs(size_t unit) = 0;
  // kSample: every kSampleStep-th tile or range alone, or of few ranges every kSampleStep-th light.
  virtual void RunPeer(const EmbreeScene& peer, PeerMode mode, size_t unit, Share share) = 0;
  // Holds the results of the last run of either side, both of `unit`, against each other. If the
  // agreement is to be settled, what they differ in is put to the single-ray walk and to brute
  // force, and a sample of all queries to the single-ray walk.
  virtual void Compare(size_t unit, Agreement* agreement) = 0;
  // Of the results of our last run, bit for bit: the same numbers for the same answers, cut alike.
  virtual uint64_t OurDigest() const = 0;
  // Of our last run.
  virtual QueryStats OurStats() const = 0;

 protected:
  const QueryOptions& options() const { return options_; }

 private:
  QueryOptions options_;
};

// One digest of both.
template <typename Array>
uint64_t AddToDigest(uint64_t digest, const Array& results) {
  using T = typename Array::value_type;
  static_assert(std::is_trivially_copyable_v<T>);
  return absl::HashOf(digest, absl::string_view(reinterpret_cast<const char*>(results.data()),
                                                results.size() * sizeof(T)));
}

struct WorkloadSpec {
  std::string name;  // primary, shadow, sun, area, points or segments.
  uint32_t width = 1920, height = 1080;
  uint64_t points = 1'000'000;  // Of points and segments.
  std::string lights = "sky";   // Of points: sky (145 directions) or lights (64 points).
  bool shuffled = false;        // Of points.
  bool sources = false;         // Whether our side is told which triangle a point lies on.
  uint64_t range = 0;           // Points or segments handed to the engine in one call; 0: as suits.
  // How many threads points are cut for; 0: as many as the pool has. Workloads of different pools
  // have the same units, ranges and digests where it is the same.
  int cut_for_threads = 0;
  QueryOptions options;
};

// What a workload is called in figures: points say their lights and order.
std::string Describe(const WorkloadSpec& spec);

// `source`, `scene` and `pool` must outlive the workload. InvalidArgument: an unknown name, or a
// scene without the views that it needs; what CheckOptions says of the spec's options.
using WorkloadMaker = absl::StatusOr<std::unique_ptr<Workload>>(const WorkloadSpec& spec,
                                                                const SceneSource& source,
                                                                const IndexedGeometry& scene,
                                                                ThreadPool& pool);
WorkloadMaker MakeWorkload;
// The kinds, made by MakeWorkload.
WorkloadMaker MakePrimaryWorkload;
WorkloadMaker MakePointWorkload;  // shadow, sun, area and points.
WorkloadMaker MakeSegmentWorkload;

// The view's camera at the spec's size.
absl::StatusOr<Camera> ViewCamera(const WorkloadSpec& spec, const BuiltinView& view);

// The image cut into tiles, row by row.
std::vector<TileRect> CutImage(uint32_t width, uint32_t height, uint32_t side = kTileSide);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_WORKLOAD_H_
