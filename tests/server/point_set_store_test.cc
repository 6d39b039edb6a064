// SPDX-License-Identifier: Apache-2.0
#include "server/points/point_set_store.h"

#include <memory>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "server/base/error.h"

namespace sightline {
namespace {

class PointSetStoreTest : public testing::Test {
 protected:
  static PointSet Make(const std::string& scene, const std::string& id, size_t points = 10) {
    PointSet set;
    set.scene_id = scene;
    set.point_set_id = id;
    set.points.positions.resize(points);
    set.points.sources.resize(points);
    set.points.valid.resize(points);
    return set;
  }

  absl::Time now_ = absl::FromUnixSeconds(1000);
  Limits limits_ = [] {
    Limits limits;
    limits.max_point_sets = 3;
    limits.max_point_set_bytes = 4096;
    return limits;
  }();
  PointSetStore store_{limits_, [this] { return now_; }};
};

TEST_F(PointSetStoreTest, ASetLivesAsLongAsItsLease) {
  ASSERT_TRUE(store_.Add(Make("s", "a"), absl::Seconds(10)).ok());
  now_ += absl::Seconds(9);
  EXPECT_TRUE(store_.Renew("s", "a", absl::Seconds(10)).ok());
  now_ += absl::Seconds(9);
  absl::StatusOr<PointSetView> held = store_.Get("s", "a");
  ASSERT_TRUE(held.ok());
  now_ += absl::Seconds(1);
  const absl::Status gone = store_.Get("s", "a").status();
  EXPECT_EQ(gone.code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(ReasonOf(gone), v1::ERROR_REASON_POINT_SET_NOT_FOUND);
  EXPECT_FALSE(store_.Renew("s", "a", absl::Seconds(10)).ok());
  EXPECT_TRUE(store_.List("s", "", 10).empty());
  store_.Sweep();
  EXPECT_EQ(held->set->points.size(), 10u);  // Who found it keeps it.
  held->set.reset();
  EXPECT_EQ(store_.memory_bytes(), 0u);
}

// As an item of a stream does that nobody reads.
TEST_F(PointSetStoreTest, WhatIsHeldCountsUntilItIsLetGoOf) {
  constexpr size_t kPoints = 120;  // Half of the budget, with some over.
  std::vector<std::shared_ptr<const PointSet>> held;
  absl::Status refused;
  for (int i = 0; i < 3 && refused.ok(); ++i) {
    const absl::StatusOr<PointSetView> made =
        store_.Add(Make("s", "a", kPoints), absl::Seconds(10));
    refused = made.status();
    if (!made.ok()) break;
    held.push_back(made->set);
    ASSERT_TRUE(store_.Remove("s", "a").ok());
  }
  EXPECT_EQ(held.size(), 1u);
  EXPECT_EQ(ReasonOf(refused), v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET) << refused;
  EXPECT_EQ(store_.memory_bytes(), PointSetStore::BytesFor(kPoints));
  held.clear();
  EXPECT_EQ(store_.memory_bytes(), 0u);
  EXPECT_TRUE(store_.Add(Make("s", "a", kPoints), absl::Seconds(10)).ok());
}

// What expired makes room for the very request that finds it so, not for the next one.
TEST_F(PointSetStoreTest, ExpiredSetsAreFreedBeforeRoomIsAskedFor) {
  constexpr size_t kPoints = 120;  // Half of the budget, with some over.
  const uint64_t bytes = PointSetStore::BytesFor(kPoints);
  ASSERT_GT(2 * bytes, limits_.max_point_set_bytes);
  const auto expire_one = [&](const char* id) {
    ASSERT_TRUE(store_.Add(Make("s", id, kPoints), absl::Seconds(10)).ok());
    now_ += absl::Seconds(10);
  };
  expire_one("a");
  absl::Status status = store_.CheckRoom("s", "b", kPoints);
  EXPECT_TRUE(status.ok()) << status;
  expire_one("a");
  status = store_.SetAside(bytes);
  EXPECT_TRUE(status.ok()) << status;
  store_.GiveBack(bytes);
  expire_one("a");
  status = store_.Add(Make("s", "b", kPoints), absl::Seconds(10)).status();
  EXPECT_TRUE(status.ok()) << status;
}

// As where memory runs out, which ends the request and not the process (memory_guard.h).
TEST_F(PointSetStoreTest, AnAddThatThrowsGivesBackWhatWasSetAside) {
  bool out_of_memory = false;
  PointSetStore store(limits_, [&] {
    if (out_of_memory) throw std::bad_alloc();
    return now_;
  });
  MemoryCharge charge(store);
  ASSERT_TRUE(charge.Add(100).ok());
  out_of_memory = true;
  EXPECT_THROW((void)store.Add(Make("s", "a"), absl::Seconds(10), charge.Leave()), std::bad_alloc);
  EXPECT_EQ(store.memory_bytes(), 0u);
}

TEST_F(PointSetStoreTest, ASetMayOutliveItsStore) {
  auto store = std::make_unique<PointSetStore>(limits_, [this] { return now_; });
  absl::StatusOr<PointSetView> made = store->Add(Make("s", "a"), absl::Seconds(10));
  ASSERT_TRUE(made.ok());
  store.reset();
  EXPECT_EQ(made->set->points.size(), 10u);
  made->set.reset();
}

TEST_F(PointSetStoreTest, SweepFreesWithoutBeingAsked) {
  ASSERT_TRUE(store_.Add(Make("s", "a"), absl::Seconds(10)).ok());
  EXPECT_GT(store_.memory_bytes(), 0u);
  now_ += absl::Seconds(10);
  store_.Sweep();
  EXPECT_EQ(store_.memory_bytes(), 0u);
}

// They may be asked for on a thread of gRPC's, and large ones take a while to free.
TEST_F(PointSetStoreTest, LookingForASetFreesNone) {
  ASSERT_TRUE(store_.Add(Make("s", "a"), absl::Seconds(10)).ok());
  now_ += absl::Seconds(10);
  EXPECT_FALSE(store_.Get("s", "a").ok());
  EXPECT_FALSE(store_.Renew("s", "a", absl::Seconds(10)).ok());
  EXPECT_TRUE(store_.List("s", "", 10).empty());
  EXPECT_EQ(store_.memory_bytes(), PointSetStore::BytesFor(10));
  ASSERT_TRUE(store_.Add(Make("s", "a"), absl::Seconds(10)).ok());
  EXPECT_EQ(store_.memory_bytes(), PointSetStore::BytesFor(10));
}

TEST_F(PointSetStoreTest, NamesAreUniqueWithinAScene) {
  ASSERT_TRUE(store_.Add(Make("s", "a"), absl::Seconds(10)).ok());
  EXPECT_EQ(store_.Add(Make("s", "a"), absl::Seconds(10)).status().code(),
            absl::StatusCode::kAlreadyExists);
  EXPECT_TRUE(store_.Add(Make("t", "a"), absl::Seconds(10)).ok());
}

TEST_F(PointSetStoreTest, LimitsAreKept) {
  EXPECT_EQ(ReasonOf(store_.CheckRoom("s", "big", 1000)), v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET);
  EXPECT_EQ(ReasonOf(store_.CheckRoom("s", "huge", uint64_t{1} << 58)),
            v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET);
  for (const char* id : {"a", "b", "c"}) {
    ASSERT_TRUE(store_.Add(Make("s", id), absl::Seconds(10)).ok());
  }
  EXPECT_EQ(ReasonOf(store_.Add(Make("s", "d"), absl::Seconds(10)).status()),
            v1::ERROR_REASON_LIMIT_EXCEEDED);
}

TEST_F(PointSetStoreTest, WhatWasSetAsideForASetBecomesItsOwn) {
  const uint64_t most = limits_.max_point_set_bytes;
  MemoryCharge charge(store_);
  ASSERT_TRUE(charge.Add(most).ok());
  EXPECT_EQ(ReasonOf(store_.Add(Make("s", "a"), absl::Seconds(10)).status()),
            v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET);
  ASSERT_TRUE(store_.Add(Make("s", "a"), absl::Seconds(10), charge.Leave()).ok());
  EXPECT_EQ(store_.memory_bytes(), PointSetStore::BytesFor(10));
  // Whether it is taken or not.
  ASSERT_TRUE(charge.Add(100).ok());
  EXPECT_FALSE(store_.Add(Make("s", "a"), absl::Seconds(10), charge.Leave()).ok());
  EXPECT_EQ(store_.memory_bytes(), PointSetStore::BytesFor(10));
}

TEST_F(PointSetStoreTest, ListsBySceneInPages) {
  for (const char* id : {"c", "a"}) {
    ASSERT_TRUE(store_.Add(Make("s", id), absl::Seconds(10)).ok());
  }
  ASSERT_TRUE(store_.Add(Make("r", "b"), absl::Seconds(10)).ok());
  ASSERT_EQ(store_.List("s", "", 10).size(), 2u);
  EXPECT_EQ(store_.List("s", "", 1)[0].set->point_set_id, "a");
  EXPECT_EQ(store_.List("s", "a", 10)[0].set->point_set_id, "c");
  store_.RemoveScene("s", /*scene_tag=*/0);
  EXPECT_TRUE(store_.List("s", "", 10).empty());
  EXPECT_EQ(store_.List("r", "", 10).size(), 1u);
  EXPECT_TRUE(store_.Remove("r", "b").ok());
  EXPECT_EQ(store_.Remove("r", "b").code(), absl::StatusCode::kNotFound);
}

TEST_F(PointSetStoreTest, ASceneTakesItsOwnSetsWithItAlone) {
  ASSERT_TRUE(store_.Add(Make("s", "a"), absl::Seconds(10)).ok());
  PointSet later = Make("s", "later");
  later.scene_tag = 1;
  ASSERT_TRUE(store_.Add(std::move(later), absl::Seconds(10)).ok());
  store_.RemoveScene("s", /*scene_tag=*/0);
  ASSERT_EQ(store_.List("s", "", 10).size(), 1u);
  EXPECT_EQ(store_.List("s", "", 10)[0].set->point_set_id, "later");
  store_.RemoveScene("s", /*scene_tag=*/1);
  EXPECT_TRUE(store_.List("s", "", 10).empty());
}

}  // namespace
}  // namespace sightline
