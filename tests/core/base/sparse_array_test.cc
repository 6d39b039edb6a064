// SPDX-License-Identifier: Apache-2.0
#include "core/base/sparse_array.h"

#include <cstdint>
#include <cstring>
#include <utility>

#include "gtest/gtest.h"

namespace sightline {
namespace {

struct alignas(64) Element {
  uint32_t values[16];
};

// Sizes on both sides of that from which memory comes from elsewhere.
TEST(SparseArrayTest, ElementsAreAlignedAndHoldWhatIsWritten) {
  for (const size_t size :
       {size_t{1}, size_t{1000}, (size_t{1} << 19) - 1, size_t{1} << 19, (size_t{1} << 20) + 3}) {
    SparseArray<Element> array(size);
    ASSERT_EQ(array.size(), size);
    EXPECT_EQ(reinterpret_cast<uintptr_t>(&array[0]) % alignof(Element), 0u) << size;
    EXPECT_EQ(&array[size - 1] - &array[0], static_cast<std::ptrdiff_t>(size - 1));
    array[0].values[0] = 1;
    array[size - 1].values[15] = 2;
    EXPECT_EQ(std::as_const(array)[0].values[0], 1u);
    EXPECT_EQ(std::as_const(array)[size - 1].values[15], 2u);
  }
}

TEST(SparseArrayTest, AnEmptyOneHoldsNothing) {
  const SparseArray<int> none, of_no_size(0);
  EXPECT_EQ(none.size(), 0u);
  EXPECT_EQ(of_no_size.size(), 0u);
}

TEST(SparseArrayTest, MovingTakesTheElementsAlong) {
  SparseArray<int> from(10);
  from[3] = 7;
  const int* const at = &from[3];
  SparseArray<int> to(std::move(from));
  EXPECT_EQ(&to[3], at);
  EXPECT_EQ(to[3], 7);
  SparseArray<int> assigned(100);
  assigned = std::move(to);
  EXPECT_EQ(assigned.size(), 10u);
  EXPECT_EQ(&assigned[3], at);
  EXPECT_EQ(assigned[3], 7);
}

}  // namespace
}  // namespace sightline
