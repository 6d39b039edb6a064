// SPDX-License-Identifier: Apache-2.0
//
// What a thread's tracers lay out in turn lies in the same memory, and nothing of one is seen by
// the next.
#include "core/query/packet_store.h"

#include <cstddef>
#include <memory>
#include <thread>

#include "core/traverse/trace_ray.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

TEST(PacketStoreTest, TheNextHasTheMemoryAndNothingThatWasInIt) {
  const RayPacket* memory = nullptr;
  {
    PacketStore<RayPacket> packets;
    packets.Reserve(3);
    memory = packets.get();
    for (size_t i = 0; i < 3; ++i) {
      packets[i].first_leaf = 7;
      packets[i].mask = 1;
      packets[i].near = packets[i].t;
      packets[i].want_barycentrics = true;
    }
    packets.Reserve(2);  // There is room: nothing changes.
    EXPECT_EQ(packets.get(), memory);
    EXPECT_EQ(packets[2].first_leaf, 7u);
  }
  PacketStore<RayPacket> next;
  EXPECT_EQ(next.get(), nullptr);
  next.Reserve(2);
  EXPECT_EQ(next.get(), memory);
  const auto fresh = std::make_unique_for_overwrite<RayPacket>();
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(next[i].first_leaf, fresh->first_leaf);
    EXPECT_EQ(next[i].mask, fresh->mask);
    EXPECT_EQ(next[i].near, nullptr);
    EXPECT_FALSE(next[i].want_barycentrics);
  }
}

TEST(PacketStoreTest, TwoAtATimeHaveMemoryOfTheirOwn) {
  PacketStore<ParallelPacket> one, other;
  one.Reserve(1);
  other.Reserve(4);
  EXPECT_NE(one.get(), other.get());
  one.Reserve(2);  // More than there was: as new.
  EXPECT_EQ(one[1].point_box, nullptr);
  std::thread([] {
    PacketStore<ParallelPacket> elsewhere;
    elsewhere.Reserve(4);
    EXPECT_EQ(elsewhere[3].count, 0);
  }).join();
  EXPECT_EQ(other[3].count, 0);
}

// What is kept is the largest array there was.
TEST(PacketStoreTest, TheLargestIsKept) {
  const RayPacket* large = nullptr;
  {
    PacketStore<RayPacket> few, many;
    many.Reserve(16);
    few.Reserve(2);
    large = many.get();
  }
  {
    PacketStore<RayPacket> few;
    few.Reserve(1);
    EXPECT_EQ(few.get(), large);
  }
  PacketStore<RayPacket> many;
  many.Reserve(16);
  EXPECT_EQ(many.get(), large);
}

}  // namespace
}  // namespace sightline
