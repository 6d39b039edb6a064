// SPDX-License-Identifier: Apache-2.0
#include "server/stream/item_points.h"

#include <algorithm>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/mesh/builtin/builtin.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

class ItemPointsTest : public testing::Test {
 protected:
  void SetUp() override {
    ThreadPool pool(1);
    scene_ = *BuildScene("box", 1, MakeBuiltin(*ParseBuiltin("box:1000"))->objects, std::nullopt,
                         {}, pool);
    for (const Vec3f vertex : scene_->geometry.vertices) {
      decoded_.positions.push_back(ToDouble(vertex) + scene_->geometry.origin);
    }
    decoded_.positions.resize(std::max<size_t>(decoded_.positions.size(), 1000), Vec3d{0, 0, 1});
    for (size_t i = 0; i < decoded_.positions.size(); ++i) {
      decoded_.normals.push_back({rng_.Uniform(-1, 1), rng_.Uniform(-1, 1), rng_.Uniform(-1, 1)});
    }
    decoded_.positions[11].z = 1e300;
  }
  size_t size() const { return decoded_.positions.size(); }

  testing_support::TestRng rng_;
  std::shared_ptr<const Scene> scene_;
  DecodedPoints decoded_;
  PlacementPace pace_;
  CancelToken cancel_;
};

// By ranges and by places, in any order.
TEST_F(ItemPointsTest, PartsMakeTheWhole) {
  for (const PointOptions& options : {PointOptions{}, PointOptions{.attach_distance = 0.3},
                                      PointOptions{.attach_distance = 0.3, .offset = 1e-4}}) {
    const PreparedPoints whole =
        *PreparePoints(*scene_, {decoded_.positions, decoded_.normals, {}}, options);
    // Attached points are mostly cleared of what they touch.
    ASSERT_TRUE(whole.near_surface > 0 || options.attach_distance > 0);
    ASSERT_EQ(whole.attached > 0, options.attach_distance > 0);
    for (const bool by_places : {false, true}) {
      const std::unique_ptr<ItemPoints> points =
          *ItemPoints::Own(*scene_, decoded_, options, &pace_, &cancel_);
      ASSERT_EQ(points->size(), size());
      EXPECT_TRUE(points->wants_placing());
      EXPECT_TRUE(std::ranges::equal(points->Range(0, size()).valid, whole.valid));
      for (size_t begin = 0; begin < size();) {
        const size_t count = std::min(size() - begin, 1 + rng_.Below(200));
        std::vector<uint32_t> places(count);
        std::iota(places.begin(), places.end(), 0);
        if (by_places) std::shuffle(places.begin(), places.end(), rng_);
        PreparedPoints placed;
        const absl::StatusOr<PointRange> part =
            by_places ? points->Place(begin, places, &cancel_, &placed)
                      : points->Place(begin, count, &cancel_, &placed);
        ASSERT_TRUE(part.ok()) << part.status();
        for (size_t i = 0; i < count; ++i) {
          EXPECT_EQ(part->positions[i], whole.positions[begin + places[i]]);
          EXPECT_EQ(part->sources[i], whole.sources[begin + places[i]]);
          EXPECT_EQ(part->valid[i], whole.valid[begin + places[i]]);
        }
        begin += count;
      }
      EXPECT_EQ(points->near_surface(), whole.near_surface);
    }
  }
}

// They are where they were when the set was made, and nothing is counted twice.
TEST_F(ItemPointsTest, ARangeOfASetIsReady) {
  auto set = std::make_shared<PointSet>();
  set->points = *PreparePoints(*scene_, {decoded_.positions, {}, {}}, {});
  const std::unique_ptr<ItemPoints> points = ItemPoints::OfSet(set, 100, 300);
  EXPECT_FALSE(points->wants_placing());
  EXPECT_EQ(points->size(), 300u);
  PreparedPoints placed;
  const absl::StatusOr<PointRange> part = points->Place(50, 200, &cancel_, &placed);
  ASSERT_TRUE(part.ok());
  EXPECT_EQ(part->positions.data(), set->points.positions.data() + 150);
  EXPECT_EQ(part->valid.size(), 200u);
  const std::vector<uint32_t> places = {7, 0};
  const absl::StatusOr<PointRange> some = points->Place(50, places, &cancel_, &placed);
  ASSERT_TRUE(some.ok());
  EXPECT_EQ(some->positions[0], set->points.positions[157]);
  EXPECT_EQ(some->sources[1], set->points.sources[150]);
  EXPECT_EQ(points->near_surface(), 0u);
}

TEST_F(ItemPointsTest, ACancelEndsAPart) {
  const PointOptions options{.attach_distance = 0.3};
  const std::unique_ptr<ItemPoints> points =
      *ItemPoints::Own(*scene_, decoded_, options, &pace_, &cancel_);
  cancel_.Cancel();
  PreparedPoints placed;
  EXPECT_TRUE(absl::IsCancelled(points->Place(0, size(), &cancel_, &placed).status()));
  EXPECT_EQ(points->near_surface(), 0u);
  EXPECT_TRUE(
      absl::IsCancelled(ItemPoints::Own(*scene_, decoded_, options, &pace_, &cancel_).status()));
}

// They take no time: whoever sends many of them first would get parts of any length for the rest.
TEST_F(ItemPointsTest, InvalidPointsSayNothingOfThePace) {
  decoded_.positions.assign(size(), Vec3d{0, 0, 1e300});
  const PointOptions options{.attach_distance = 0.3};
  const std::unique_ptr<ItemPoints> points =
      *ItemPoints::Own(*scene_, decoded_, options, &pace_, &cancel_);
  PreparedPoints placed;
  ASSERT_TRUE(points->Place(0, size(), &cancel_, &placed).ok());
  EXPECT_EQ(pace_.MostPoints(), PlacementPace::kFirstPoints);
}

TEST(PlacementPaceTest, AsManyAsFitAPart) {
  using std::chrono::microseconds;
  using std::chrono::nanoseconds;
  PlacementPace pace;
  EXPECT_EQ(pace.MostPoints(), PlacementPace::kFirstPoints);
  pace.Add(1000, microseconds(2000));
  EXPECT_EQ(pace.MostPoints(), 2000u);  // Of 2 us each.
  for (int i = 0; i < 500; ++i) pace.Add(1000, microseconds(10));
  EXPECT_GT(pace.MostPoints(), 350'000u);
  for (int i = 0; i < 500; ++i) pace.Add(1, std::chrono::seconds(1));
  EXPECT_EQ(pace.MostPoints(), PlacementPace::kLeastPoints);
  PlacementPace quick;
  quick.Add(1, nanoseconds(0));
  EXPECT_GT(quick.MostPoints(), 1'000'000u);
}

}  // namespace
}  // namespace sightline
