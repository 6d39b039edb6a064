// SPDX-License-Identifier: Apache-2.0
#include "core/base/array_memory.h"

#include <cstdint>
#include <cstring>

#include "gtest/gtest.h"

namespace sightline {
namespace {

// Below, at and above the size from which huge pages are asked for, and sizes that fill none.
TEST(ArrayMemoryTest, EverySizeIsAlignedAndWritable) {
  for (const size_t bytes : {size_t{1}, size_t{4096}, (size_t{1} << 21) - 1, size_t{1} << 21,
                             (size_t{1} << 21) + 1, (size_t{5} << 21) + 12345}) {
    void* const array = AllocateArray(bytes);
    EXPECT_EQ(reinterpret_cast<uintptr_t>(array) % kArrayAlignment, 0u) << bytes;
    std::memset(array, 0x5A, bytes);
    EXPECT_EQ(static_cast<const uint8_t*>(array)[bytes - 1], 0x5A);
    FreeArray(array, bytes);
  }
  FreeArray(nullptr, 0);
}

}  // namespace
}  // namespace sightline
