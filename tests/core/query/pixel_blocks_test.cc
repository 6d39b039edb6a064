// SPDX-License-Identifier: Apache-2.0
//
// A block's rays are those of its pixels, and its results land on them.
#include "core/query/pixel_blocks.h"

#include <bit>
#include <cstdint>
#include <cstring>
#include <vector>

#include "core/base/aligned_vector.h"
#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "hwy/cache_control.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using namespace testing_support;  // NOLINT

constexpr uint32_t kSide = PixelBlockKernels::kSide;

// Any bits, those of NaNs among them, as ids and as numbers.
struct Lanes {
  explicit Lanes(TestRng& rng) {
    for (uint32_t i = 0; i < kSide * kSide; ++i) {
      ids[i] = static_cast<uint32_t>(rng.Below(uint64_t{1} << 32));
      values[i] = std::bit_cast<float>(ids[i]);
    }
  }
  alignas(64) uint32_t ids[kSide * kSide];
  alignas(64) float values[kSide * kSide];
};

TEST(PixelBlocksTest, LanesRunThroughSquares) {
  std::vector<int> seen(kSide * kSide);
  for (uint32_t y = 0; y < kSide; ++y) {
    for (uint32_t x = 0; x < kSide; ++x) ++seen[PixelBlockKernels::LaneOf(x, y)];
  }
  EXPECT_EQ(seen, std::vector<int>(kSide * kSide, 1));
  EXPECT_EQ(PixelBlockKernels::LaneOf(3, 0), 3u);
  EXPECT_EQ(PixelBlockKernels::LaneOf(0, 1), 4u);
  EXPECT_EQ(PixelBlockKernels::LaneOf(4, 0), 16u);
  EXPECT_EQ(PixelBlockKernels::LaneOf(0, 4), 64u);
}

TEST(PixelBlocksTest, DirectionsAreSumsRoundedOnce) {
  TestRng rng;
  for (const SimdTarget simd : AvailableTargets()) {
    double columns[kSide], rows[kSide];
    for (uint32_t i = 0; i < kSide; ++i) {
      columns[i] = rng.Uniform(-1, 1);
      rows[i] = rng.Uniform(-1, 1) * 0x1p-12;
    }
    alignas(64) float lanes[kSide * kSide];
    PixelBlockKernelsFor(simd).lay_out(columns, rows, lanes);
    for (uint32_t y = 0; y < kSide; ++y) {
      for (uint32_t x = 0; x < kSide; ++x) {
        EXPECT_EQ(std::bit_cast<uint32_t>(lanes[PixelBlockKernels::LaneOf(x, y)]),
                  std::bit_cast<uint32_t>(static_cast<float>(columns[x] + rows[y])));
      }
    }
  }
}

// Bits as they are, and nothing beside the block.
TEST(PixelBlocksTest, ResultsLandOnTheirPixels) {
  TestRng rng;
  constexpr size_t kStride = 37, kFirst = 11;
  for (const SimdTarget simd : AvailableTargets()) {
    const Lanes lanes(rng);
    std::vector<uint32_t> id_image(kStride * (kSide + 2), 7);
    std::vector<float> value_image(id_image.size(), 7.0f);
    PixelBlockKernelsFor(simd).write_ids(lanes.ids, id_image.data() + kFirst, kStride);
    PixelBlockKernelsFor(simd).write(lanes.values, value_image.data() + kFirst, kStride);
    for (size_t i = 0; i < id_image.size(); ++i) {
      const size_t x = (i + kStride - kFirst) % kStride, y = (i + kStride - kFirst) / kStride;
      const bool inside = y >= 1 && y <= kSide && x < kSide;
      const uint32_t id = inside ? lanes.ids[PixelBlockKernels::LaneOf(
                                       static_cast<uint32_t>(x), static_cast<uint32_t>(y - 1))]
                                 : 7;
      EXPECT_EQ(id_image[i], id) << i;
      EXPECT_EQ(std::bit_cast<uint32_t>(value_image[i]),
                inside ? id : std::bit_cast<uint32_t>(7.0f))
          << i;
    }
  }
}

// The same past the caches.
TEST(PixelBlocksTest, StreamedResultsLandOnTheirPixels) {
  TestRng rng;
  constexpr size_t kStride = 48, kFirst = 16;
  for (const SimdTarget simd : AvailableTargets()) {
    const Lanes lanes(rng);
    const PixelBlockKernels& kernels = PixelBlockKernelsFor(simd);
    AlignedVector<uint32_t> id_image(kStride * kSide, 7), streamed_ids = id_image;
    AlignedVector<float> value_image(id_image.size(), 7.0f), streamed_values = value_image;
    kernels.write_ids(lanes.ids, id_image.data() + kFirst, kStride);
    kernels.write(lanes.values, value_image.data() + kFirst, kStride);
    kernels.stream_ids(lanes.ids, streamed_ids.data() + kFirst, kStride);
    kernels.stream(lanes.values, streamed_values.data() + kFirst, kStride);
    hwy::FlushStream();
    EXPECT_EQ(streamed_ids, id_image);
    EXPECT_EQ(std::memcmp(streamed_values.data(), value_image.data(), 4 * value_image.size()), 0);
  }
}

}  // namespace
}  // namespace sightline
