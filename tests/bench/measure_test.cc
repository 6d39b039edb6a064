// SPDX-License-Identifier: Apache-2.0
//
// Turns are checked on a clock that only the sides move.
#include "tests/bench/measure.h"

#include <algorithm>
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

TEST(PickModeTest, TheFastestByItsBestTimeOverAllUnits) {
  const auto device = EmbreeDevice::Open(1, SimdTarget::kBest);
  ASSERT_TRUE(device.ok()) << device.status();
  SceneGeometry geometry;
  geometry.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  geometry.triangles = {{0, 1, 2}};
  const PeerMesh mesh(geometry);
  const auto peer = EmbreeScene::Build(**device, mesh, {});
  ASSERT_TRUE(peer.ok()) << peer.status();
  double time = 0;
  FakeWorkload workload(&time);
  // Disturbed by less than what ends the trials.
  const PeerMode mode = PickMode(workload, **peer, [&time] { return time / 8; });
  EXPECT_EQ(mode.Name(), "packet8 from point, sorted");
  EXPECT_EQ(workload.units_seen(), 7u);
}

}  // namespace
}  // namespace sightline::bench
