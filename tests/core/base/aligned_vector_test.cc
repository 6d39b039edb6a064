// SPDX-License-Identifier: Apache-2.0
#include "core/base/aligned_vector.h"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <new>
#include <span>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using ::testing::ElementsAre;

template <typename T>
bool Aligned(const AlignedVector<T>& v) {
  return reinterpret_cast<uintptr_t>(v.data()) % 64 == 0;
}

TEST(AlignedVectorTest, StaysAlignedAndKeepsItsElementsWhileItGrows) {
  struct Odd {
    uint8_t bytes[7];
  };
  AlignedVector<Odd> v;
  EXPECT_TRUE(v.empty());
  for (int i = 0; i < 1000; ++i) {
    v.push_back(Odd{{static_cast<uint8_t>(i), 0, 0, 0, 0, 0, static_cast<uint8_t>(i >> 8)}});
    ASSERT_TRUE(Aligned(v));
  }
  ASSERT_EQ(v.size(), 1000u);
  for (int i = 0; i < 1000; ++i) {
    ASSERT_EQ(v[i].bytes[0] + (v[i].bytes[6] << 8), i);
  }
}

TEST(AlignedVectorTest, ResizeFillsOnlyWhatIsNew) {
  AlignedVector<int> v = {1, 2};
  v.resize(4, 9);
  EXPECT_THAT(v, ElementsAre(1, 2, 9, 9));
  v.resize(1);
  v.resize(3);
  EXPECT_THAT(v, ElementsAre(1, 0, 0));
}

TEST(AlignedVectorTest, UninitializedGrowthKeepsTheOldPart) {
  AlignedVector<int> v = {1, 2, 3};
  v.ResizeUninitialized(1 << 20);
  EXPECT_EQ(v.size(), 1u << 20);
  EXPECT_EQ(v.capacity(), 1u << 20);
  EXPECT_EQ(v[0] + v[1] + v[2], 6);
  v.back() = 5;
  EXPECT_EQ(v[(1 << 20) - 1], 5);
}

TEST(AlignedVectorTest, AnElementOfItsOwnMayBePushed) {
  AlignedVector<int> v = {7};
  v.shrink_to_fit();
  ASSERT_EQ(v.capacity(), 1u);
  v.push_back(v[0]);
  v.resize(40, v[1]);
  EXPECT_EQ(std::count(v.begin(), v.end(), 7), 40);
}

TEST(AlignedVectorTest, CopiesAndMoves) {
  AlignedVector<int> a = {1, 2, 3};
  AlignedVector<int> b = a;
  EXPECT_EQ(a, b);
  b[0] = 4;
  EXPECT_FALSE(a == b);
  const int* const data = b.data();
  AlignedVector<int> c = std::move(b);
  EXPECT_EQ(c.data(), data);
  a = c;
  EXPECT_THAT(a, ElementsAre(4, 2, 3));
  AlignedVector<int>& self = a;
  a = self;
  a = std::move(self);
  EXPECT_THAT(a, ElementsAre(4, 2, 3));
  a = AlignedVector<int>();
  EXPECT_TRUE(a.empty());
}

TEST(AlignedVectorTest, ConvertsToSpansAndFromRanges) {
  const std::vector<int> source = {5, 6};
  AlignedVector<int> v(source.begin(), source.end());
  std::span<const int> view = v;
  EXPECT_THAT(view, ElementsAre(5, 6));
  EXPECT_THAT(AlignedVector<int>(3, 8), ElementsAre(8, 8, 8));
}

TEST(AlignedVectorTest, ReserveAndShrink) {
  AlignedVector<double> v;
  v.reserve(100);
  EXPECT_EQ(v.capacity(), 100u);
  v.push_back(1);
  v.shrink_to_fit();
  EXPECT_EQ(v.capacity(), 1u);
  v.pop_back();
  v.shrink_to_fit();
  EXPECT_EQ(v.data(), nullptr);
}

class BorrowedVectorTest : public ::testing::Test {
 protected:
  AlignedVector<int> Borrow(size_t n) {
    return AlignedVector<int>::Borrow(std::span(std::as_const(*lent_)).first(n), lent_);
  }
  const std::shared_ptr<AlignedVector<int>> lent_ =
      std::make_shared<AlignedVector<int>>(AlignedVector<int>{1, 2, 3, 4});
};

TEST_F(BorrowedVectorTest, ReadsWhatItsOwnerHoldsAndHoldsTheOwner) {
  {
    const AlignedVector<int> v = Borrow(3);
    EXPECT_TRUE(v.borrowed());
    EXPECT_EQ(v.data(), std::as_const(*lent_).data());
    EXPECT_THAT(v, ElementsAre(1, 2, 3));
    EXPECT_EQ(lent_.use_count(), 2);
    const AlignedVector<int> moved = Borrow(2);
    EXPECT_EQ(lent_.use_count(), 3);
  }
  EXPECT_EQ(lent_.use_count(), 1);
  EXPECT_FALSE(Borrow(0).borrowed());
}

TEST_F(BorrowedVectorTest, CopiesAreOrdinaryAndMovesStayBorrowed) {
  AlignedVector<int> v = Borrow(3);
  AlignedVector<int> copy = v;
  EXPECT_FALSE(copy.borrowed());
  copy[0] = 9;
  const AlignedVector<int> moved = std::move(v);
  EXPECT_TRUE(moved.borrowed());
  copy = moved;
  EXPECT_FALSE(copy.borrowed());
  EXPECT_EQ(copy, moved);
  copy = Borrow(1);
  copy = AlignedVector<int>{7, 8};
  EXPECT_THAT(copy, ElementsAre(7, 8));
  EXPECT_THAT(*lent_, ElementsAre(1, 2, 3, 4));
}

TEST_F(BorrowedVectorTest, WhateverChangesItsSizeCopiesFirst) {
  AlignedVector<int> pushed = Borrow(3), resized = Borrow(3), shorter = Borrow(3),
                     appended = Borrow(3), cleared = Borrow(3), reserved = Borrow(3);
  pushed.push_back(7);
  EXPECT_THAT(pushed, ElementsAre(1, 2, 3, 7));
  resized.resize(5, 9);
  EXPECT_THAT(resized, ElementsAre(1, 2, 3, 9, 9));
  shorter.resize(2);
  shorter.push_back(8);
  EXPECT_THAT(shorter, ElementsAre(1, 2, 8));
  appended.Append(std::vector<int>{5, 6});
  EXPECT_THAT(appended, ElementsAre(1, 2, 3, 5, 6));
  cleared.clear();
  EXPECT_TRUE(cleared.empty());
  cleared.push_back(4);
  EXPECT_THAT(cleared, ElementsAre(4));
  reserved.reserve(1);
  reserved[0] = 6;
  EXPECT_THAT(*lent_, ElementsAre(1, 2, 3, 4));
  EXPECT_EQ(lent_.use_count(), 1);
}

TEST(AlignedVectorTest, AppendGrowsByMoreThanOne) {
  AlignedVector<int> v;
  v.Append({});
  for (int i = 0; i < 100; ++i) v.Append(std::vector<int>{i, i});
  EXPECT_EQ(v.size(), 200u);
  EXPECT_EQ(v[199], 99);
  EXPECT_LE(v.capacity(), 400u);
}

TEST(AlignedVectorTest, AnImpossibleSizeThrowsInsteadOfWrapping) {
  AlignedVector<double> v;
  EXPECT_THROW(v.ResizeUninitialized(SIZE_MAX / 4), std::bad_alloc);
  EXPECT_TRUE(v.empty());
}

}  // namespace
}  // namespace sightline
