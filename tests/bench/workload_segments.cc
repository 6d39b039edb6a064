// SPDX-License-Identifier: Apache-2.0
//
// segments: random, incoherent segments, both ends anywhere in the scene's box. One unit.
#include <algorithm>
#include <bit>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/query/segments.h"
#include "tests/bench/random.h"
#include "tests/bench/workload.h"

namespace sightline::bench {
namespace {

// One range of segments, without sources.
PreparedSegments RandomSegments(const Box3f& box, size_t count, uint64_t stream) {
  Random random(/*seed=*/1, stream);
  const auto anywhere = [&] {
    Vec3f at;
    for (int axis = 0; axis < 3; ++axis) {
      at[axis] = static_cast<float>(random.Uniform(box.lo[axis], box.hi[axis]));
    }
    return at;
  };
  PreparedSegments segments;
  for (size_t i = 0; i < count; ++i) {
    segments.from.push_back(anywhere());
    segments.to.push_back(anywhere());
  }
  segments.from_source.assign(count, kNoTriangle);
  segments.to_source.assign(count, kNoTriangle);
  segments.valid.assign(count, 1);
  return segments;
}

PreparedSegments OneOf(const PreparedSegments& all, size_t i) {
  return {.from = {all.from[i]},
          .to = {all.to[i]},
          .from_source = {kNoTriangle},
          .to_source = {kNoTriangle},
          .valid = {1}};
}

class SegmentWorkload : public Workload {
 public:
  SegmentWorkload(const WorkloadSpec& spec, const IndexedGeometry& scene, ThreadPool& pool)
      : Workload(spec.options), scene_(scene), pool_(pool), queries_(spec.points) {
    const uint64_t range = spec.range > 0 ? spec.range : 65'536;
    for (uint64_t begin = 0; begin < spec.points; begin += range) {
      ranges_.push_back(RandomSegments(scene.geometry.bounds, std::min(range, spec.points - begin),
                                       ranges_.size()));
    }
    ours_.resize(ranges_.size());
    theirs_.resize(ranges_.size());
  }

  size_t units() const override { return 1; }
  uint64_t queries(size_t) const override { return queries_; }
  size_t views() const override { return 0; }
  size_t view(size_t) const override { return 0; }
  std::vector<PeerMode> peer_modes() const override {
    return AllModes(std::vector<PeerMode::Start>{PeerMode::Start::kLight, PeerMode::Start::kPoint});
  }

  void RunOurs(size_t) override {
    pool_.ParallelFor(ranges_.size(), 1, [&](size_t begin, size_t end) {
      for (size_t r = begin; r < end; ++r) {
        const absl::Status status =
            TestSegments(scene_, ranges_[r], {.bits = true}, options(), &ours_[r]);
        SIGHTLINE_CHECK(status.ok()) << status;
      }
    });
  }

  void RunPeer(const EmbreeScene& peer, PeerMode mode, size_t, Share share) override {
    pool_.ParallelFor(ranges_.size(), 1, [&](size_t begin, size_t end) {
      for (size_t r = begin; r < end; ++r) {
        const size_t n = ranges_[r].size();
        const size_t count = share == Share::kAll ? n : std::max<size_t>(1, n / kSampleStep);
        theirs_[r].resize((n + 7) / 8);
        TraceSegments(peer, mode, std::span(ranges_[r].from).first(count),
                      std::span(ranges_[r].to).first(count), theirs_[r].data());
      }
    });
  }

  void Compare(size_t, Agreement* agreement) override {
    for (size_t r = 0; r < ranges_.size(); ++r) {
      for (size_t byte = 0; byte < theirs_[r].size(); ++byte) {
        const uint8_t ours = ours_[r].blocked_bits[byte];
        uint32_t differing = ours ^ theirs_[r][byte];
        for (; differing != 0; differing &= differing - 1) {
          const int bit = std::countr_zero(differing);
          Settle(r, byte * 8 + static_cast<size_t>(bit), ours >> bit & 1, agreement);
        }
      }
      if (!agreement->settle || r % kSampleStep != 0) continue;
      SegmentResult truth;
      Test(ranges_[r], Strategy::kSingle, &truth);
      agreement->by_single += ranges_[r].size();
      for (size_t i = 0; i < ranges_[r].size(); ++i) {
        const bool blocked = ours_[r].blocked_bits[i / 8] >> (i % 8) & 1;
        if ((truth.blocked_bits[i / 8] >> (i % 8) & 1) != blocked) {
          AddDifference(r, i, blocked, Strategy::kSingle, agreement);
        }
      }
    }
    agreement->queries += queries_;
  }

  QueryStats OurStats() const override {
    QueryStats stats;
    for (const SegmentResult& range : ours_) stats.Add(range.stats);
    return stats;
  }

  uint64_t OurDigest() const override {
    uint64_t digest = 0;
    for (const SegmentResult& range : ours_) digest = AddToDigest(digest, range.blocked_bits);
    return digest;
  }

 private:
  void Settle(size_t r, size_t i, bool blocked, Agreement* agreement) const {
    ++agreement->disagreements;
    if (!agreement->settle) return;
    ++agreement->by_single;
    CheckOne(r, i, blocked, Strategy::kSingle, agreement);
    if (!agreement->CanAffordBruteForce(scene_)) return;
    ++agreement->by_brute_force;
    CheckOne(r, i, blocked, Strategy::kBruteForce, agreement);
  }

  void CheckOne(size_t r, size_t i, bool blocked, Strategy strategy, Agreement* agreement) const {
    SegmentResult truth;
    Test(OneOf(ranges_[r], i), strategy, &truth);
    if ((truth.blocked_bits[0] & 1) != blocked) {
      AddDifference(r, i, blocked, strategy, agreement);
    }
  }

  void Test(const PreparedSegments& segments, Strategy strategy, SegmentResult* result) const {
    QueryOptions asked = options();
    asked.strategy = strategy;
    const absl::Status status = TestSegments(scene_, segments, {.bits = true}, asked, result);
    SIGHTLINE_CHECK(status.ok()) << status;
  }

  void AddDifference(size_t r, size_t i, bool blocked, Strategy strategy,
                     Agreement* agreement) const {
    agreement->AddBeyondRounding(absl::StrCat("range ", r, ", segment ", i, ": ",
                                              blocked ? "blocked" : "free", ", but ",
                                              StrategyName(strategy), " says otherwise"));
  }

  const IndexedGeometry& scene_;
  ThreadPool& pool_;
  const uint64_t queries_;
  std::vector<PreparedSegments> ranges_;
  std::vector<SegmentResult> ours_;
  std::vector<std::vector<uint8_t>> theirs_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<Workload>> MakeSegmentWorkload(const WorkloadSpec& spec,
                                                              const SceneSource&,
                                                              const IndexedGeometry& scene,
                                                              ThreadPool& pool) {
  return std::make_unique<SegmentWorkload>(spec, scene, pool);
}

}  // namespace sightline::bench
