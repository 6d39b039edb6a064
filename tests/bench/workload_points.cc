// SPDX-License-Identifier: Apache-2.0
//
// shadow, sun, area and points: lights × points, one bit each. Both sides get the same floats.
//
// A unit of shadow and sun is a view and one of its lights; of area a view, all samples of its
// light together; of points a share of the points, against all lights.
//
// Unless the spec says otherwise our side is not told which triangle a point lies on, since the
// peer cannot be told: both then answer the same question. The points are placed off their
// surfaces, so that neither needs to know.
#include <algorithm>
#include <atomic>
#include <bit>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/base/aligned_vector.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/query/shadows.h"
#include "tests/bench/peer_order.h"
#include "tests/bench/point_sets.h"
#include "tests/bench/workload.h"

namespace sightline::bench {
namespace {

constexpr uint32_t kAreaSamples = 16;
constexpr int kBoxLights = 64;
// Queries of one unit of `points`, at least: some tenths of a second of the slower side.
constexpr uint64_t kUnitQueries = 16'000'000;

// Ranges are handed out in runs, so that each call is told what comes next: time and again a thread
// takes one in so many of its share of those that are left. The last runs are of one range each, as
// tiles of other workloads are, so that no thread waits long for another.
constexpr size_t kShareOfRest = 2;

constexpr size_t kPeerPoints = 1 << 16;
static_assert(kPeerPoints % 8 == 0, "a bit each, in bytes");

struct Unit {
  size_t view = 0;
  size_t set = 0;                      // Which points, ...
  size_t first_range = 0, ranges = 0;  // ... and which of their ranges.
  std::vector<LightSample> samples;
};

// A sample and a point of a range, and what we say of them.
struct Pair {
  size_t sample = 0, point = 0;
  bool lit = false;
};

// What the peer says of a range, and what it needs for that; memory is kept from run to run.
struct PeerOutput {
  AlignedVector<uint8_t> lit_bits;  // Rows as in ShadowResult.
  PeerOrder order;
  AlignedVector<uint8_t> sorted_bits;
};

bool Bit(const uint8_t* bits, size_t i) { return bits[i / 8] >> (i % 8) & 1; }

class PointWorkload : public Workload {
 public:
  PointWorkload(const WorkloadSpec& spec, const IndexedGeometry& scene, ThreadPool& pool,
                std::vector<PointSet> sets, std::vector<Unit> units, size_t views)
      : Workload(spec.options),
        scene_(scene),
        pool_(pool),
        sets_(std::move(sets)),
        units_(std::move(units)),
        views_(views) {
    size_t most = 0;
    for (const Unit& unit : units_) most = std::max(most, unit.ranges);
    ours_.resize(most);
    theirs_.resize(most);
  }

  size_t units() const override { return units_.size(); }
  uint64_t queries(size_t unit) const override {
    uint64_t points = 0;
    for (size_t r = 0; r < units_[unit].ranges; ++r) points += RangeOf(unit, r).count;
    return points * units_[unit].samples.size();
  }
  size_t views() const override { return views_; }
  size_t view(size_t unit) const override { return units_[unit].view; }
  std::vector<PeerMode> peer_modes() const override {
    using Start = PeerMode::Start;
    const bool directional = units_.front().samples.front().directional;
    if (directional) return AllModes(std::vector<Start>{Start::kPoint}, /*sorted=*/true);
    return AllModes(std::vector<Start>{Start::kLight, Start::kPoint}, /*sorted=*/true);
  }

  bool sample_overpays_sorting() const override {
    return std::any_of(units_.begin(), units_.end(), [](const Unit& unit) {
      return SampleOf(unit, Share::kSample).light_step > 1;
    });
  }

  void RunOurs(size_t unit) override {
    ran_ = units_[unit].ranges;
    const size_t threads = static_cast<size_t>(pool_.threads());
    std::atomic<size_t> taken = 0;
    pool_.ParallelFor(threads, 1, [&](size_t, size_t) {
      size_t begin = taken.load(std::memory_order_relaxed);
      while (begin < ran_) {
        const size_t some = std::max<size_t>((ran_ - begin) / (kShareOfRest * threads), 1);
        if (!taken.compare_exchange_weak(begin, begin + some, std::memory_order_relaxed)) continue;
        RunRanges(unit, begin, begin + some);
        begin = taken.load(std::memory_order_relaxed);
      }
    });
  }

  // Of a sample every range is whole, since sorting gains by how dense points lie: every
  // kSampleStep-th range, or, of fewer, each against every kSampleStep-th light.
  void RunPeer(const EmbreeScene& peer, PeerMode mode, size_t unit, Share share) override {
    const size_t ranges = units_[unit].ranges;
    const Steps steps = SampleOf(units_[unit], share);
    const size_t some = (ranges + steps.range_step - 1) / steps.range_step;
    pool_.ParallelFor(some, 1, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        PeerRange(peer, mode, unit, i * steps.range_step, steps.light_step);
      }
    });
  }

  void Compare(size_t unit, Agreement* agreement) override {
    for (size_t r = 0; r < units_[unit].ranges; ++r) {
      const std::vector<Pair> differing = DifferingPairs(unit, r);
      agreement->disagreements += differing.size();
      if (!agreement->settle) continue;
      // Many differences, and a sample of ranges whatever the peer says of them, are settled by
      // tracing the whole range.
      const size_t pairs = RangeOf(unit, r).count * units_[unit].samples.size();
      const bool whole = r % kSampleStep == unit % kSampleStep || differing.size() > pairs / 16;
      if (whole) CheckRange(unit, r, agreement);
      for (const Pair& pair : differing) {
        if (!whole) CheckPair(unit, r, pair, Strategy::kSingle, agreement);
        if (agreement->CanAffordBruteForce(scene_)) {
          CheckPair(unit, r, pair, Strategy::kBruteForce, agreement);
        }
      }
    }
    agreement->queries += queries(unit);
  }

  QueryStats OurStats() const override {
    QueryStats stats;
    for (size_t r = 0; r < ran_; ++r) stats.Add(ours_[r].stats);
    return stats;
  }

  uint64_t OurDigest() const override {
    uint64_t digest = 0;
    for (size_t r = 0; r < ran_; ++r) digest = AddToDigest(digest, ours_[r].lit_bits);
    return digest;
  }

 private:
  // Every which range, and every which light, is in a share of a unit.
  struct Steps {
    size_t range_step = 1, light_step = 1;
  };
  static Steps SampleOf(const Unit& unit, Share share) {
    if (share == Share::kAll) return {};
    if (unit.ranges >= kSampleStep) return {.range_step = kSampleStep};
    return {.light_step = std::min(kSampleStep, unit.samples.size())};
  }

  const PointSet::Range& RangeOf(size_t unit, size_t r) const {
    return sets_[units_[unit].set].ranges[units_[unit].first_range + r];
  }

  // The points of ranges begin .. end - 1.
  PointSet::Range RangesOf(size_t unit, size_t begin, size_t end) const {
    const PointSet::Range& first = RangeOf(unit, begin);
    const PointSet::Range& last = RangeOf(unit, end - 1);
    return {first.begin, last.begin + last.count - first.begin};
  }

  // A run of ranges.
  void RunRanges(size_t unit, size_t begin, size_t end) {
    const PointSet& set = sets_[units_[unit].set];
    ShadowHints hints;
    for (size_t r = begin; r < end; ++r) {
      ShadowOptions shadow = {.hints = &hints};
      if (r + 1 < ran_) shadow.next = set.Slice(RangesOf(unit, r + 1, ran_));
      const absl::Status status =
          ComputeShadows(scene_, set.Slice(RangeOf(unit, r)), units_[unit].samples, {}, shadow,
                         {.bits = true}, options(), &ours_[r]);
      SIGHTLINE_CHECK(status.ok()) << status;
    }
  }

  // Every light_step-th sample: rows of the others stay as they are.
  void PeerRange(const EmbreeScene& peer, PeerMode mode, size_t unit, size_t r, size_t light_step) {
    std::span<const Vec3f> positions = sets_[units_[unit].set].Positions(RangeOf(unit, r));
    PeerOutput& out = theirs_[r];
    const size_t row = (positions.size() + 7) / 8;
    const std::vector<LightSample>& samples = units_[unit].samples;
    out.lit_bits.resize(samples.size() * row);
    if (mode.sorted) {
      out.order.Sort(positions);
      positions = out.order.positions();
      out.sorted_bits.resize(kPeerPoints / 8);
      std::fill(out.lit_bits.begin(), out.lit_bits.end(), uint8_t{0});
    }
    // So many points at a time as stay in the cache while the lights go by.
    for (size_t first = 0; first < positions.size(); first += kPeerPoints) {
      const std::span<const Vec3f> some =
          positions.subspan(first, std::min(kPeerPoints, positions.size() - first));
      for (size_t s = 0; s < samples.size(); s += light_step) {
        uint8_t* const bits = &out.lit_bits[s * row];
        if (!mode.sorted) {
          TracePoints(peer, mode, some, samples[s], bits + first / 8);
          continue;
        }
        TracePoints(peer, mode, some, samples[s], out.sorted_bits.data());
        out.order.PutBack(out.sorted_bits.data(), first, some.size(), bits);
      }
    }
  }

  // What the sides say differently of a range.
  std::vector<Pair> DifferingPairs(size_t unit, size_t r) const {
    std::vector<Pair> pairs;
    const size_t row = (RangeOf(unit, r).count + 7) / 8;
    for (size_t s = 0; s < units_[unit].samples.size(); ++s) {
      for (size_t byte = 0; byte < row; ++byte) {
        const uint8_t ours = ours_[r].lit_bits[s * row + byte];
        uint32_t differing = ours ^ theirs_[r].lit_bits[s * row + byte];
        for (; differing != 0; differing &= differing - 1) {
          const int bit = std::countr_zero(differing);
          pairs.push_back({s, byte * 8 + static_cast<size_t>(bit), (ours >> bit & 1) != 0});
        }
      }
    }
    return pairs;
  }

  void CheckPair(size_t unit, size_t r, const Pair& pair, Strategy strategy,
                 Agreement* agreement) const {
    ++(strategy == Strategy::kSingle ? agreement->by_single : agreement->by_brute_force);
    ShadowResult truth;
    const PointSet::Range one{RangeOf(unit, r).begin + pair.point, 1};
    Compute(unit, one, std::span(units_[unit].samples).subspan(pair.sample, 1), strategy, &truth);
    if (Bit(truth.lit_bits.data(), 0) != pair.lit)
      AddDifference(unit, r, pair, strategy, agreement);
  }

  void CheckRange(size_t unit, size_t r, Agreement* agreement) const {
    ShadowResult truth;
    Compute(unit, RangeOf(unit, r), units_[unit].samples, Strategy::kSingle, &truth);
    const size_t n = RangeOf(unit, r).count, row = (n + 7) / 8;
    agreement->by_single += n * units_[unit].samples.size();
    if (truth.lit_bits == ours_[r].lit_bits) return;
    for (size_t s = 0; s < units_[unit].samples.size(); ++s) {
      for (size_t i = 0; i < n; ++i) {
        const Pair pair{s, i, Bit(&ours_[r].lit_bits[s * row], i)};
        if (Bit(&truth.lit_bits[s * row], i) == pair.lit) continue;
        AddDifference(unit, r, pair, Strategy::kSingle, agreement);
      }
    }
  }

  void Compute(size_t unit, const PointSet::Range& range, std::span<const LightSample> samples,
               Strategy strategy, ShadowResult* result) const {
    QueryOptions asked = options();
    asked.strategy = strategy;
    const absl::Status status = ComputeShadows(scene_, sets_[units_[unit].set].Slice(range),
                                               samples, {}, {}, {.bits = true}, asked, result);
    SIGHTLINE_CHECK(status.ok()) << status;
  }

  void AddDifference(size_t unit, size_t r, const Pair& pair, Strategy strategy,
                     Agreement* agreement) const {
    agreement->AddBeyondRounding(absl::StrCat(
        "unit ", unit, ", sample ", pair.sample, ", point ", RangeOf(unit, r).begin + pair.point,
        ": ", pair.lit ? "lit" : "not lit", ", but ", StrategyName(strategy), " says otherwise"));
  }

  const IndexedGeometry& scene_;
  ThreadPool& pool_;
  const std::vector<PointSet> sets_;
  const std::vector<Unit> units_;
  const size_t views_;
  size_t ran_ = 0;                  // Ranges of that unit.
  std::vector<ShadowResult> ours_;  // One per range of the unit that ran last.
  std::vector<PeerOutput> theirs_;  // Likewise.
};

absl::StatusOr<std::vector<LightSample>> ToSamples(const std::vector<Light>& lights,
                                                   const SceneGeometry& geometry) {
  std::vector<LightSample> samples;
  for (size_t i = 0; i < lights.size(); ++i) {
    SL_RETURN_IF_ERROR(
        AppendSamples(lights[i], static_cast<uint32_t>(i), geometry.origin, &samples));
  }
  for (const LightSample& sample : samples) {
    if (!sample.valid) {
      return absl::InvalidArgumentError(
          absl::StrCat("light ", sample.light, " is not finite, or out of range"));
    }
  }
  return samples;
}

// The lights of one view, each the lights of a unit.
std::vector<Light> LightsOf(const WorkloadSpec& spec, const BuiltinView& view) {
  std::vector<Light> lights;
  if (spec.name == "shadow") {
    for (const Vec3d at : view.lights) lights.push_back(Light::Point(at));
  } else if (spec.name == "sun") {
    for (const Vec3d toward : view.suns) lights.push_back(Light::Directional(toward));
  } else {
    lights.push_back({.kind = Light::Kind::kRectangle,
                      .position = view.area.center,
                      .half_u = view.area.u,
                      .half_v = view.area.v,
                      .sample_count = kAreaSamples});
  }
  return lights;
}

absl::StatusOr<std::unique_ptr<Workload>> MakeViewWorkload(const WorkloadSpec& spec,
                                                           const SceneSource& source,
                                                           const IndexedGeometry& scene,
                                                           ThreadPool& pool) {
  std::vector<PointSet> sets;
  std::vector<Unit> units;
  for (size_t v = 0; v < source.views.size(); ++v) {
    const BuiltinView& view = source.views[v];
    SL_ASSIGN_OR_RETURN(Camera camera, ViewCamera(spec, view));
    SL_ASSIGN_OR_RETURN(PointSet set, ViewHits(scene, camera, spec.sources, pool));
    if (set.size() == 0) continue;  // A view of nothing asks nothing.
    for (const Light& light : LightsOf(spec, view)) {
      SL_ASSIGN_OR_RETURN(std::vector<LightSample> samples, ToSamples({light}, scene.geometry));
      units.push_back({v, sets.size(), 0, set.ranges.size(), std::move(samples)});
    }
    sets.push_back(std::move(set));
  }
  if (units.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("no view of '", source.name, "' has both hits and lights"));
  }
  const size_t views = sets.size();
  return std::make_unique<PointWorkload>(spec, scene, pool, std::move(sets), std::move(units),
                                         views);
}

absl::StatusOr<std::unique_ptr<Workload>> MakeSurfaceWorkload(const WorkloadSpec& spec,
                                                              const SceneSource& source,
                                                              const IndexedGeometry& scene,
                                                              ThreadPool& pool) {
  // One thread takes them all at once; several take turns.
  const auto threads =
      static_cast<uint64_t>(spec.cut_for_threads > 0 ? spec.cut_for_threads : pool.threads());
  const uint64_t turns = threads == 1 ? 1 : 4 * threads;
  const uint64_t range = spec.range > 0 ? spec.range : (spec.points + turns - 1) / turns;
  SL_ASSIGN_OR_RETURN(PointSet set, SurfacePoints(scene,
                                                  {.count = spec.points,
                                                   .range = range,
                                                   .shuffled = spec.shuffled,
                                                   .with_sources = spec.sources},
                                                  pool));
  std::vector<Light> lights = BoxLights(scene.geometry, kBoxLights);
  if (spec.lights == "sky") {
    SL_ASSIGN_OR_RETURN(lights, SkyLights(source.up));
  }
  SL_ASSIGN_OR_RETURN(std::vector<LightSample> samples, ToSamples(lights, scene.geometry));
  const uint64_t range_queries = std::max<uint64_t>(1, range * samples.size());
  const size_t step = static_cast<size_t>(
      std::max<uint64_t>(turns, (kUnitQueries + range_queries - 1) / range_queries));
  std::vector<Unit> units;
  for (size_t first = 0; first < set.ranges.size(); first += step) {
    units.push_back({0, 0, first, std::min(step, set.ranges.size() - first), samples});
  }
  std::vector<PointSet> sets;
  sets.push_back(std::move(set));
  return std::make_unique<PointWorkload>(spec, scene, pool, std::move(sets), std::move(units),
                                         /*views=*/0);
}

}  // namespace

absl::StatusOr<std::unique_ptr<Workload>> MakePointWorkload(const WorkloadSpec& spec,
                                                            const SceneSource& source,
                                                            const IndexedGeometry& scene,
                                                            ThreadPool& pool) {
  if (spec.name == "points") return MakeSurfaceWorkload(spec, source, scene, pool);
  return MakeViewWorkload(spec, source, scene, pool);
}

}  // namespace sightline::bench
