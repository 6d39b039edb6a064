// SPDX-License-Identifier: Apache-2.0
#include "core/base/serial_number.h"

#include <set>
#include <thread>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

namespace sightline {
namespace {

TEST(SerialNumberTest, GoesAlongWithAMoveAndNotWithACopy) {
  SerialNumber first;
  const uint64_t value = first.value();
  EXPECT_NE(value, 0u);
  SerialNumber copy = first;
  EXPECT_NE(copy.value(), value);
  EXPECT_EQ(first.value(), value);
  SerialNumber moved = std::move(first);
  EXPECT_EQ(moved.value(), value);
  EXPECT_NE(first.value(), value);  // NOLINT(bugprone-use-after-move): what it is left with.
  const uint64_t before = copy.value();
  copy = moved;
  EXPECT_NE(copy.value(), value);
  EXPECT_NE(copy.value(), before);
  copy = std::move(moved);
  EXPECT_EQ(copy.value(), value);
  EXPECT_NE(moved.value(), value);  // NOLINT(bugprone-use-after-move)
}

TEST(SerialNumberTest, NoTwoThreadsGetTheSame) {
  constexpr int kEach = 1000;
  std::vector<std::vector<uint64_t>> taken(4);
  std::vector<std::thread> threads;
  threads.reserve(taken.size());
  for (std::vector<uint64_t>& some : taken) {
    threads.emplace_back([&some] {
      for (int i = 0; i < kEach; ++i) some.push_back(SerialNumber().value());
    });
  }
  for (std::thread& thread : threads) thread.join();
  std::set<uint64_t> all;
  for (const std::vector<uint64_t>& some : taken) all.insert(some.begin(), some.end());
  EXPECT_EQ(all.size(), 4u * kEach);
}

}  // namespace
}  // namespace sightline
