// SPDX-License-Identifier: Apache-2.0
//
// Turns are checked on a clock that only the sides move.
#include "tests/bench/measure.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline::bench {
namespace {

using ::testing::ElementsAre;

// Sides whose units take so many seconds each, and what ran in which order.
struct Runs {
  double time = 0;
  std::vector<std::pair<size_t, size_t>> order;  // Side and unit.
  Side Make(size_t side, double seconds) {
    return {[this, side, seconds](size_t unit) {
      order.emplace_back(side, unit);
      time += seconds;
    }};
  }
};

Timings Time(Runs& runs, size_t units, const std::vector<Side>& sides, size_t repeats,
             const std::function<size_t(size_t)>& group = nullptr) {
  return TimeByTurns(
      {units, [](size_t unit) { return 10 * (unit + 1); }, group}, sides, repeats, [](size_t) {},
      [&runs] { return runs.time; });
}

TEST(TimeByTurnsTest, TheSideThatBeginsChangesFromUnitToUnitAndPassToPass) {
  Runs runs;
  // Two passes bring the faster one to 0.3 s: 2 · 3 · 0.0625 s.
  const Timings timings = Time(runs, 3, {runs.Make(0, 0.0625), runs.Make(1, 0.125)}, 1);
  EXPECT_THAT(runs.order, ElementsAre(std::pair(0, 0), std::pair(1, 0), std::pair(1, 1),
                                      std::pair(0, 1), std::pair(0, 2), std::pair(1, 2),  //
                                      std::pair(1, 0), std::pair(0, 0), std::pair(0, 1),
                                      std::pair(1, 1), std::pair(1, 2), std::pair(0, 2)));
  EXPECT_THAT(timings.queries, ElementsAre(120.0));
  EXPECT_DOUBLE_EQ(timings.Ratio(0, 1).median, 2);
  EXPECT_DOUBLE_EQ(timings.Rate(0).median, 120 / 0.375);
  EXPECT_DOUBLE_EQ(timings.TotalRatio(0, 1), 2);
  EXPECT_EQ(timings.UnitsPerRepetition(), 6);
}

TEST(TimeByTurnsTest, LongPassesAreSharedAmongRepetitions) {
  Runs runs;
  // Two units bring a side to 3 s; five repetitions of two units go once round the ten.
  const Timings timings = Time(runs, 10, {runs.Make(0, 1.5), runs.Make(1, 0.5)}, 5,
                               [](size_t unit) { return unit / 5; });
  std::vector<size_t> units;
  for (size_t i = 0; i < runs.order.size(); i += 2) units.push_back(runs.order[i].second);
  EXPECT_THAT(units, ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9));
  EXPECT_THAT(timings.queries, ElementsAre(30.0, 70.0, 110.0, 150.0, 190.0));
  EXPECT_THAT(timings.seconds[0], ElementsAre(3.0, 3.0, 3.0, 3.0, 3.0));
  // Groups have figures of the repetitions that they were in alone.
  EXPECT_THAT(timings.groups[0].queries, ElementsAre(30.0, 70.0, 50.0, 0.0, 0.0));
  EXPECT_DOUBLE_EQ(timings.groups[0].Ratio(1, 0).min, 3);
  EXPECT_DOUBLE_EQ(timings.groups[1].Ratio(1, 0).max, 3);
  EXPECT_DOUBLE_EQ(timings.groups[0].TotalRatio(1, 0), 3);
  EXPECT_EQ(timings.UnitsPerRepetition(), 2);
  EXPECT_DOUBLE_EQ(timings.groups[0].UnitsPerRepetition(), 5.0 / 3);
}

// The median is over shares of the work that differ, the total over all of it, and over no unit
// more often than over another: of three repetitions of three units the last two units are a second
// round that has no end.
TEST(TimeByTurnsTest, TheTotalIsOfWholeRounds) {
  Runs runs;
  const auto side = [&runs](size_t side, double one, double others) {
    return Side{[&runs, side, one, others](size_t unit) {
      runs.order.emplace_back(side, unit);
      runs.time += unit == 0 ? one : others;
    }};
  };
  const Timings timings = Time(runs, 7, {side(0, 4, 4), side(1, 60, 8)}, 3,
                               [](size_t unit) { return unit == 0 ? 0 : 1; });
  EXPECT_THAT(timings.units, ElementsAre(3, 3, 3));
  EXPECT_DOUBLE_EQ(timings.Ratio(0, 1).median, 76.0 / 12);
  EXPECT_DOUBLE_EQ(timings.TotalRatio(0, 1), (60 + 6 * 8.0) / (7 * 4.0));
  EXPECT_DOUBLE_EQ(timings.groups[0].TotalRatio(0, 1), 15);
  EXPECT_DOUBLE_EQ(timings.groups[1].TotalRatio(0, 1), 2);
}

TEST(TimeByTurnsTest, AllUnitsHaveTheirTurnHoweverLongTheyTake) {
  Runs runs;
  Time(runs, 7, {runs.Make(0, 100)}, 3);
  std::vector<size_t> units;
  for (const auto& [side, unit] : runs.order) units.push_back(unit);
  EXPECT_THAT(units, ElementsAre(0, 1, 2, 3, 4, 5, 6, 0, 1));
}

TEST(TimeByTurnsTest, CleaningUpIsNotTimed) {
  Runs runs;
  Side side = runs.Make(0, 0.25);
  side.clean_up = [&runs] { runs.time += 50; };
  EXPECT_THAT(Time(runs, 2, {side}, 2).seconds[0], ElementsAre(0.5, 0.5));
}

TEST(SpreadTest, MedianOfEvenAndOddNumbers) {
  EXPECT_EQ(SpreadOf({3, 1, 2}).median, 2);
  const Spread four = SpreadOf({4, 1, 2, 3});
  EXPECT_EQ(four.median, 2.5);
  EXPECT_EQ(four.min, 1);
  EXPECT_EQ(four.max, 4);
}

// A workload whose modes take so many turns of a clock of its own.
class FakeWorkload : public Workload {
 public:
  explicit FakeWorkload(double* time) : Workload({}), time_(*time) {}
  size_t units() const override { return 3; }
  uint64_t queries(size_t) const override { return 1; }
  size_t views() const override { return 0; }
  size_t view(size_t) const override { return 0; }
  std::vector<PeerMode> peer_modes() const override {
    return AllModes(std::vector<PeerMode::Start>{PeerMode::Start::kPoint}, /*sorted=*/true);
  }
  void RunOurs(size_t) override {}
  void RunPeer(const EmbreeScene&, PeerMode mode, size_t unit, Share share) override {
    EXPECT_EQ(share, Share::kSample);
    units_seen_ |= 1u << unit;
    const bool best = mode.entry == PeerMode::Entry::kPacket8 && mode.sorted && !mode.coherent;
    // The best one is disturbed in its first trial: its best time counts.
    time_ += best ? (calls_++ < 3 ? 9.0 : 0.0625) : 0.125;
  }
  void Compare(size_t, Agreement*) override {}
  uint64_t OurDigest() const override { return 0; }
  QueryStats OurStats() const override { return {}; }
  uint32_t units_seen() const { return units_seen_; }

 private:
  double& time_;
  int calls_ = 0;
  uint32_t units_seen_ = 0;
};

// Modes that sort pay for all of it on a sample of every sixteenth light: 16 seconds, and as many
// as others do for a sixteenth of the lights, or half of it if the sorting helps.
class SortingWorkload : public FakeWorkload {
 public:
  SortingWorkload(double* time, double unsorted, bool sample_overpays)
      : FakeWorkload(time), time_(*time), unsorted_(unsorted), sample_overpays_(sample_overpays) {}
  size_t units() const override { return 1; }
  bool sample_overpays_sorting() const override { return sample_overpays_; }
  void RunPeer(const EmbreeScene&, PeerMode mode, size_t, Share share) override {
    const bool packets = mode.entry == PeerMode::Entry::kPacket4 && !mode.coherent;
    const double lights = share == Share::kAll ? 16 : 1, rays = packets ? 0.5 : 1.0;
    time_ += mode.sorted ? 16 + lights * rays * unsorted_ / 2 : lights * rays * unsorted_;
    whole_ += share == Share::kAll ? 1 : 0;
  }
  int whole() const { return whole_; }

 private:
  double& time_;
  const double unsorted_;
  const bool sample_overpays_;
  int whole_ = 0;
};

class PickModeTest : public testing::Test {
 protected:
  void SetUp() override {
    auto device = EmbreeDevice::Open(1, SimdTarget::kBest);
    ASSERT_TRUE(device.ok()) << device.status();
    device_ = *std::move(device);
    SceneGeometry geometry;
    geometry.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    geometry.triangles = {{0, 1, 2}};
    mesh_.emplace(geometry);
    auto peer = EmbreeScene::Build(*device_, *mesh_, {});
    ASSERT_TRUE(peer.ok()) << peer.status();
    peer_ = *std::move(peer);
  }
  // By a clock that is so many times as slow as theirs: what they take is to end no trials.
  std::string Picked(Workload& workload, double slow) {
    return PickMode(workload, *peer_, [this, slow] { return time_ / slow; }).Name();
  }

  double time_ = 0;
  std::unique_ptr<EmbreeDevice> device_;
  std::optional<PeerMesh> mesh_;
  std::unique_ptr<EmbreeScene> peer_;
};

TEST_F(PickModeTest, TheFastestByItsBestTimeOverAllUnits) {
  FakeWorkload workload(&time_);
  EXPECT_EQ(Picked(workload, 8), "packet8 from point, sorted");
  EXPECT_EQ(workload.units_seen(), 7u);
}

// As they come: 8 s of the sample, 128 of all. Sorted: 20 s of the sample, 80 of all.
TEST_F(PickModeTest, SortingThatTheSampleOverpaysIsJudgedByTheWhole) {
  SortingWorkload workload(&time_, /*unsorted=*/16, /*sample_overpays=*/true);
  EXPECT_EQ(Picked(workload, 1024), "packet4 from point, sorted");
  EXPECT_EQ(workload.whole(), 2 * 5);
}

// 0.5 s of the sample, 8 of all; and 16.25 s of the sample, 20 of all.
TEST_F(PickModeTest, SortingThatIsNotWorthItIsNotChosen) {
  SortingWorkload workload(&time_, /*unsorted=*/1, /*sample_overpays=*/true);
  EXPECT_EQ(Picked(workload, 1024), "packet4 from point");
  EXPECT_EQ(workload.whole(), 2 * 5);
}

TEST_F(PickModeTest, NothingIsTriedInFullWhereTheSampleIsFairOrSortingWinsIt) {
  SortingWorkload fair(&time_, /*unsorted=*/16, /*sample_overpays=*/false);
  EXPECT_EQ(Picked(fair, 1024), "packet4 from point");
  EXPECT_EQ(fair.whole(), 0);
  SortingWorkload worth_it(&time_, /*unsorted=*/100, /*sample_overpays=*/true);
  EXPECT_EQ(Picked(worth_it, 4096), "packet4 from point, sorted");
  EXPECT_EQ(worth_it.whole(), 0);
}

}  // namespace
}  // namespace sightline::bench
