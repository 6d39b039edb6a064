// SPDX-License-Identifier: Apache-2.0
#include "server/stream/shadow_chunk.h"

#include <algorithm>
#include <bit>
#include <exception>
#include <limits>
#include <numeric>
#include <span>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "server/codec/result_codec.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

constexpr size_t kSamples = 3;
constexpr ShadowOutputs kAll = {
    .bits = true, .counts = true, .weighted_sums = true, .blockers = true};

// Points whose shadows are their own number: bit s of it says whether sample s reaches the point.
struct Numbered {
  Numbered(size_t count, testing_support::TestRng* rng) {
    positions.resize(count);
    sources.resize(count);
    valid.resize(count);
    for (size_t i = 0; i < count; ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        positions[i][axis] = static_cast<float>(rng->Uniform(-1, 1));
      }
      sources[i] = static_cast<uint32_t>(i);
      valid[i] = rng->Chance(0.9) ? 1 : 0;
    }
  }
  PointRange range() const { return {positions, sources, valid}; }

  absl::Status Compute(std::span<const uint32_t> places, ShadowResult* result) const {
    const size_t n = places.size();
    *result = NothingLit(n, kSamples, kAll);
    for (size_t i = 0; i < n; ++i) {
      const uint32_t number = places[i];
      EXPECT_EQ(valid[number], 1);
      for (size_t s = 0; s < kSamples; ++s) {
        if (((number >> s) & 1) != 0) {
          result->lit_bits[s * ((n + 7) / 8) + i / 8] |= static_cast<uint8_t>(1u << (i % 8));
        }
        result->blocker[s * n + i] = number + static_cast<uint32_t>(s);
        result->blocker_t[s * n + i] = static_cast<float>(number);
      }
      result->lit_counts[i] = number;
      result->weighted_sums[i] = number;
    }
    result->stats.rays = n;
    return absl::OkStatus();
  }

  std::vector<Vec3f> positions;
  std::vector<uint32_t> sources;
  std::vector<uint8_t> valid;
};

// Whatever the sizes, whoever comes last: every valid point gets its own answers, the others none.
TEST(ShadowChunkTest, EveryPointGetsItsOwnAnswers) {
  testing_support::TestRng rng;
  for (const size_t count : {1u, 9u, 1000u, 4099u}) {
    const Numbered points(count, &rng);
    const size_t valid = std::accumulate(points.valid.begin(), points.valid.end(), size_t{0});
    for (const size_t part_points : {8u, 64u, 1024u, 8192u}) {
      ShadowChunk chunk(count, part_points);
      EXPECT_EQ(chunk.parts(), (count + part_points - 1) / part_points);
      std::vector<size_t> order(chunk.parts());
      std::iota(order.begin(), order.end(), 0);
      std::shuffle(order.begin(), order.end(), rng);
      ShadowResult result;
      QueryStats stats;
      for (size_t k = 0; k < order.size(); ++k) {
        const absl::StatusOr<bool> last = chunk.RunPart(
            order[k], points.range(), kSamples, kAll,
            [&](std::span<const uint32_t> some, ShadowHints*, ShadowResult* out) {
              return points.Compute(some, out);
            },
            &result, &stats);
        ASSERT_TRUE(last.ok()) << last.status();
        EXPECT_EQ(*last, k + 1 == order.size());
      }
      EXPECT_EQ(stats.rays, valid);
      for (size_t i = 0; i < count; ++i) {
        const bool good = points.valid[i] != 0;
        EXPECT_EQ(result.lit_counts[i], good ? i : 0);
        EXPECT_EQ(result.weighted_sums[i], static_cast<double>(good ? i : 0));
        for (size_t s = 0; s < kSamples; ++s) {
          const uint8_t byte = result.lit_bits[s * ((count + 7) / 8) + i / 8];
          EXPECT_EQ((byte >> (i % 8)) & 1, good ? (i >> s) & 1 : 0);
          EXPECT_EQ(result.blocker[s * count + i], good ? i + s : kNoTriangle);
        }
      }
    }
  }
}

// A part that memory ran out for ends its item; others of it may still be under way.
TEST(ShadowChunkTest, RunningOutOfMemoryLeavesTheRestWhole) {
  testing_support::TestRng rng;
  const Numbered points(100, &rng);
  ShadowChunk chunk(100, 64);
  ShadowResult result;
  QueryStats stats;
  const auto run = [&](size_t part, size_t samples) {
    return chunk.RunPart(
        part, points.range(), samples, kAll,
        [&](std::span<const uint32_t> some, ShadowHints*, ShadowResult* out) {
          return points.Compute(some, out);
        },
        &result, &stats);
  };
  // More than any vector may hold.
  EXPECT_THROW(run(0, std::numeric_limits<size_t>::max() / 16).IgnoreError(), std::exception);
  const absl::StatusOr<bool> last = run(1, kSamples);
  ASSERT_TRUE(last.ok()) << last.status();
  EXPECT_FALSE(*last);
}

// A part is a cell of space: together the parts are far smaller than what they were parted from.
TEST(ShadowChunkTest, PartsAreNeighbours) {
  testing_support::TestRng rng;
  Numbered points(4096, &rng);
  std::fill(points.valid.begin(), points.valid.end(), 1);
  ShadowChunk chunk(4096, 512);
  ShadowResult result;
  QueryStats stats;
  for (size_t part = 0; part < chunk.parts(); ++part) {
    const auto compute = [&](std::span<const uint32_t> some, ShadowHints*, ShadowResult* out) {
      float volume = 1;
      for (int axis = 0; axis < 3; ++axis) {
        const auto less = [&](uint32_t a, uint32_t b) {
          return points.positions[a][axis] < points.positions[b][axis];
        };
        const auto [low, high] = std::minmax_element(some.begin(), some.end(), less);
        volume *= points.positions[*high][axis] - points.positions[*low][axis];
      }
      EXPECT_LT(volume, 8.0 / 4);  // Of the whole's 8; an eighth of it would be a perfect cell.
      return points.Compute(some, out);
    };
    ASSERT_TRUE(chunk.RunPart(part, points.range(), kSamples, kAll, compute, &result, &stats).ok());
  }
}

TEST(ShadowChunkTest, HintsArePassedOn) {
  testing_support::TestRng rng;
  const Numbered points(64, &rng);
  ShadowChunk chunk(64, 32);
  ShadowResult result;
  QueryStats stats;
  for (size_t part = 0; part < 2; ++part) {
    const auto compute = [&](std::span<const uint32_t> some, ShadowHints* hints,
                             ShadowResult* out) {
      EXPECT_EQ(hints->first_leaves.size(), part);
      hints->first_leaves.push_back(7);
      return points.Compute(some, out);
    };
    ASSERT_TRUE(chunk.RunPart(part, points.range(), kSamples, kAll, compute, &result, &stats).ok());
  }
}

TEST(ShadowChunkTest, PartsRunSideBySide) {
  testing_support::TestRng rng;
  const Numbered points(10'000, &rng);
  ShadowChunk chunk(10'000, 64);
  std::atomic<size_t> next = 0, lasts = 0;
  ShadowResult result;
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      QueryStats stats;
      for (size_t part = next++; part < chunk.parts(); part = next++) {
        const absl::StatusOr<bool> last = chunk.RunPart(
            part, points.range(), kSamples, kAll,
            [&](std::span<const uint32_t> some, ShadowHints*, ShadowResult* out) {
              return points.Compute(some, out);
            },
            &result, &stats);
        lasts += *last ? 1 : 0;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(lasts, 1u);
  for (size_t i = 0; i < points.valid.size(); ++i) {
    EXPECT_EQ(result.lit_counts[i], points.valid[i] != 0 ? i : 0);
  }
}

// Powers of two near what is asked for, and never none.
TEST(ShadowChunkTest, PartsArePowersOfTwo) {
  for (const uint64_t samples : {1u, 6u, 145u, 65'536u}) {
    for (const uint64_t rays : {8u << 10, 64u << 10, 256u << 10}) {
      const size_t points = ShadowChunk::PartPoints(rays, samples);
      EXPECT_TRUE(std::has_single_bit(points));
      EXPECT_GE(points, 8u);
      if (points > 8) {
        EXPECT_LE(points * samples, rays * 3 / 2);
        EXPECT_GE(points * samples, rays * 3 / 4 - samples);
      }
    }
  }
}

}  // namespace
}  // namespace sightline
