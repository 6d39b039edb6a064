// SPDX-License-Identifier: Apache-2.0
//
// Points are brought into an order and answered in their own places.
#include "core/query/point_order.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <functional>
#include <iterator>
#include <limits>
#include <numeric>
#include <span>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/parallel.h"
#include "core/geometry/box3.h"
#include "core/query/shadows.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using namespace testing_support;  // NOLINT

struct Points {
  std::vector<Vec3f> positions;
  std::vector<uint8_t> valid;
  std::vector<uint32_t> sources;
};

// Rows of a square, every tenth point invalid.
Points MakeRows(int side) {
  Points points;
  for (int i = 0; i < side * side; ++i) {
    const int column = i % side, row = i / side;
    points.positions.push_back({static_cast<float>(column) / static_cast<float>(side) - 0.5f,
                                static_cast<float>(row) / static_cast<float>(side) - 0.5f, 1.5f});
    points.valid.push_back(i % 10 != 3);
    points.sources.push_back(kNoTriangle);
  }
  return points;
}

std::vector<size_t> Shuffled(size_t n, TestRng& rng) {
  std::vector<size_t> order(n);
  std::iota(order.begin(), order.end(), size_t{0});
  for (size_t i = n; i > 1; --i) std::swap(order[i - 1], order[rng.Below(i)]);
  return order;
}

Points Permuted(const Points& points, const std::vector<size_t>& order) {
  Points out;
  for (size_t i : order) {
    out.positions.push_back(points.positions[i]);
    out.valid.push_back(points.valid[i]);
    out.sources.push_back(points.sources[i]);
  }
  return out;
}

// The square's points by squares of `side` by `side`, row by row.
std::vector<size_t> InSquares(const std::vector<size_t>& order, size_t width, size_t side) {
  std::vector<size_t> out;
  for (size_t square = 0; square < order.size() / (side * side); ++square) {
    const size_t row = square / (width / side) * side, column = square % (width / side) * side;
    for (size_t i = 0; i < side * side; ++i) {
      out.push_back(order[(row + i / side) * width + column + i % side]);
    }
  }
  return out;
}

TEST(PointOrderTest, PaysForWideBlocksAndManySamples) {
  TestRng rng;
  const Points rows = MakeRows(64);
  const Points mixed = Permuted(rows, Shuffled(rows.positions.size(), rng));
  // Squares of 4 by 4 within squares of 16 by 16.
  std::vector<size_t> natural(64 * 64), nested;
  std::iota(natural.begin(), natural.end(), size_t{0});
  const std::vector<size_t> in_squares = InSquares(natural, 64, 16);
  for (size_t first = 0; first < in_squares.size(); first += 256) {
    const auto begin = in_squares.begin() + static_cast<ptrdiff_t>(first);
    for (const size_t i : InSquares({begin, begin + 256}, 16, 4)) nested.push_back(i);
  }
  const Points squares = Permuted(rows, nested);
  EXPECT_TRUE(OrderingPays(mixed.positions, mixed.valid, 1));
  EXPECT_FALSE(OrderingPays(mixed.positions, mixed.valid, 0));
  EXPECT_FALSE(OrderingPays(rows.positions, rows.valid, 1));
  EXPECT_TRUE(OrderingPays(rows.positions, rows.valid, 100));
  EXPECT_FALSE(OrderingPays(squares.positions, squares.valid, 1000));
  // One light pays where its rays are dear, and a hundred do not where theirs cost nothing.
  EXPECT_TRUE(OrderingPays(rows.positions, rows.valid, 1, /*ray_cost=*/1000));
  EXPECT_FALSE(OrderingPays(rows.positions, rows.valid, 100, /*ray_cost=*/0.5f));
  EXPECT_FALSE(OrderingPays(squares.positions, squares.valid, 1000, /*ray_cost=*/1000));
  // A line in order is in order.
  std::vector<Vec3f> line(5000);
  for (size_t i = 0; i < line.size(); ++i) line[i].x = static_cast<float>(i);
  EXPECT_FALSE(OrderingPays(line, std::vector<uint8_t>(5000, 1), 1000));
  const std::vector<Vec3f> same(5000, Vec3f{1, 2, 3});
  EXPECT_FALSE(OrderingPays(same, std::vector<uint8_t>(5000, 1), 1000));
  EXPECT_FALSE(OrderingPays(same, std::vector<uint8_t>(5000, 0), 1000));
  EXPECT_FALSE(
      OrderingPays(std::span(mixed.positions).first(500), std::span(mixed.valid).first(500), 1000));
}

// A picture's rows, cut anywhere: however long they are, small blocks are narrow and large ones are
// not, and many lights are worth an order.
TEST(PointOrderTest, PaysForRowsOfAnyLengthAndManySamples) {
  for (const size_t width : {300u, 512u, 720u, 1024u, 1920u}) {
    for (const size_t count : {5768u, 10616u, 16384u}) {
      std::vector<Vec3f> rows(count);
      for (size_t i = 0; i < count; ++i) {
        const size_t column = i % width, row = i / width;
        rows[i] = {static_cast<float>(column), static_cast<float>(row), 7};
      }
      const std::vector<uint8_t> valid(count, 1);
      EXPECT_TRUE(OrderingPays(rows, valid, 145)) << count << " in rows of " << width;
    }
  }
}

TEST(PointOrderTest, TheOrderHoldsEachValidPointOnce) {
  TestRng rng;
  const Points rows = MakeRows(64);
  const Points mixed = Permuted(rows, Shuffled(rows.positions.size(), rng));
  const std::vector<uint32_t> order = SpatialOrder(mixed.positions, mixed.valid);
  std::vector<int> seen(mixed.positions.size());
  for (uint32_t i : order) ++seen[i];
  for (size_t i = 0; i < seen.size(); ++i) EXPECT_EQ(seen[i], mixed.valid[i] ? 1 : 0) << i;
}

float Widest(const Box3f& box) {
  const Vec3f extent = box.hi - box.lo;
  return std::max(extent.x, std::max(extent.y, extent.z));
}

// How far parts of these may reach over each other.
float Overlap(const std::vector<Vec3f>& points, std::span<const uint32_t> few) {
  Box3f box;
  for (const uint32_t i : few) box.Extend(points[i]);
  return std::max(Widest(box) / 254, 256 * std::numeric_limits<float>::min());
}

// Blocks of 2^k are parted from each other: of any two that share a parent, the widest axis has all
// of one before all of the other; up to the overlap of 256 within these. Each point is there once.
void ExpectParted(const std::vector<Vec3f>& points, const std::vector<uint32_t>& order) {
  ASSERT_EQ(order.size(), points.size());
  std::vector<int> seen(points.size());
  for (uint32_t i : order) ++seen[i];
  EXPECT_EQ(std::count(seen.begin(), seen.end(), 1), static_cast<ptrdiff_t>(seen.size()));
  int pairs = 0;
  for (size_t size = 16; size < points.size(); size *= 2) {
    for (size_t first = 0; first + size < points.size(); first += 2 * size, ++pairs) {
      Box3f box[2];
      for (size_t i = first; i < std::min(first + 2 * size, points.size()); ++i) {
        box[i >= first + size].Extend(points[order[i]]);
      }
      const size_t large = first / 256 * 256;
      const float overlap =
          size >= 256 ? 0
                      : Overlap(points, std::span(order).subspan(
                                            large, std::min<size_t>(256, order.size() - large)));
      Box3f both = box[0];
      both.Extend(box[1]);
      bool parted = false;
      for (int k = 0; k < 3; ++k) {
        const bool widest = both.hi[k] - both.lo[k] + 2 * overlap >= Widest(both);
        parted |= widest && box[0].hi[k] <= box[1].lo[k] + overlap;
      }
      EXPECT_TRUE(parted) << "blocks of " << size << " from " << first;
    }
  }
  EXPECT_GE(pairs + 1, static_cast<int>(points.size() / 16));
}

TEST(PointOrderTest, BlocksOfTheOrderArePartedByPlanes) {
  TestRng rng;
  std::vector<Vec3f> points(3000);
  for (Vec3f& p : points) {
    for (int k = 0; k < 3; ++k) p[k] = static_cast<float>(std::floor(rng.Uniform(0, 40)));
  }
  ExpectParted(points, SpatialOrder(points, std::vector<uint8_t>(points.size(), 1)));
}

// Of every size, and spread so that no guess at where the middle lies is any good.
TEST(PointOrderTest, PointsArePartedHoweverTheyAreSpread) {
  TestRng rng;
  const auto any_magnitude = [&] {
    return static_cast<float>(std::exp2(rng.Uniform(-149, 40)) * (rng.Below(2) == 0 ? 1 : -1));
  };
  const std::function<float(size_t)> spreads[] = {
      [](size_t) { return 7.0f; },                                  // All in one place.
      [&](size_t) { return rng.Below(2) == 0 ? 0.0f : -0.0f; },     // Equal, not the same.
      [&](size_t) { return rng.Below(9) == 0 ? 1e12f : -1e-30f; },  // Two places.
      [&](size_t) { return any_magnitude(); },                      // Near zero, most.
      [](size_t i) { return static_cast<float>(i); },               // In order.
      [](size_t i) { return static_cast<float>(i % 2 == 0 ? i : 5000 - i); },  // From both ends.
      [](size_t i) { return i == 40 ? 1e12f : static_cast<float>(i % 100); },  // One far away.
      [](size_t i) { return static_cast<float>(std::exp2(-static_cast<double>(i % 140))); },
  };
  for (size_t kind = 0; kind < std::size(spreads); ++kind) {
    for (size_t n = 1; n < 4000; n += 1 + n / 7 + rng.Below(3)) {
      SCOPED_TRACE(absl::StrCat("kind ", kind, ", ", n, " points"));
      std::vector<Vec3f> points(n);
      for (size_t i = 0; i < n; ++i) {
        points[i] = {spreads[kind](i), kind % 2 == 0 ? spreads[kind](n - i) : 3.0f,
                     any_magnitude()};
        if (kind < 3) points[i].z = -1;
      }
      // A few are not valid; what else they are does not matter.
      std::vector<Vec3f> all = points;
      std::vector<uint8_t> valid(n, 1);
      for (size_t i = 0; i < n % 3; ++i) {
        const auto at = static_cast<ptrdiff_t>(rng.Below(all.size() + 1));
        all.insert(all.begin() + at, Vec3f{std::numeric_limits<float>::quiet_NaN(), 1, 2});
        valid.insert(valid.begin() + at, 0);
      }
      std::vector<uint32_t> first;
      for (const SimdTarget simd : AvailableTargets()) {
        const PartedPoints parted = InSpatialOrder(all, valid, simd);
        std::vector<uint32_t> order;
        for (size_t i = 0; i < parted.numbers.size(); ++i) {
          const uint32_t number = parted.numbers[i];
          ASSERT_TRUE(valid[number]);
          for (int k = 0; k < 3; ++k) {
            EXPECT_EQ(std::bit_cast<uint32_t>(parted.positions[i][k]),
                      std::bit_cast<uint32_t>(all[number][k]))
                << number;
          }
          order.push_back(number - static_cast<uint32_t>(std::count(
                                       valid.begin(), valid.begin() + number, uint8_t{0})));
        }
        ExpectParted(points, order);
        // The same whatever the vectors' length.
        EXPECT_EQ(order, first.empty() ? order : first);
        first = order;
      }
    }
  }
}

// Tokens that fire before, and amid: no machine orders four million points in the time of a look.
TEST(PointOrderTest, EndsWhenCancelled) {
  constexpr size_t kMany = 4'000'000;
  TestRng rng;
  std::vector<Vec3f> points(kMany);
  for (Vec3f& p : points) p = ToFloat(RandomInBox(rng, {1, 1, 1}));
  for (const bool all : {true, false}) {
    std::vector<uint8_t> valid(kMany, 1);
    if (!all) valid[7] = 0;
    for (const int microseconds : {0, 1, 1000}) {
      CancelToken late;
      late.set_deadline(CancelToken::Clock::now() + std::chrono::microseconds(microseconds));
      EXPECT_TRUE(InSpatialOrder(points, valid, SimdTarget::kBest, &late).numbers.empty());
      EXPECT_TRUE(late.cancelled());
    }
    const size_t some = 100'000;
    const CancelToken live;
    EXPECT_EQ(InSpatialOrder(std::span(points).first(some), std::span(valid).first(some),
                             SimdTarget::kBest, &live)
                  .numbers.size(),
              some - !all);
  }
}

// A run of points gets its own part of the orders that were made for all, wherever it begins.
TEST(PointOrdersTest, AnyRunFindsItsOwnOrder) {
  TestRng rng;
  ThreadPool pool(2);
  const Points rows = MakeRows(200);
  const size_t n = rows.positions.size();
  ASSERT_GT(n, 2 * PointOrders::kBlock);
  const PointOrders orders(rows.positions, rows.valid, pool);
  ASSERT_FALSE(orders.empty());
  EXPECT_GE(orders.MemoryBytes(), 4 * (n - n / 10));
  EXPECT_EQ(
      orders.Of(PointOrders::kBlock, PointOrders::kBlock),
      SpatialOrder(std::span(rows.positions).subspan(PointOrders::kBlock, PointOrders::kBlock),
                   std::span(rows.valid).subspan(PointOrders::kBlock, PointOrders::kBlock)));
  for (int round = 0; round < 50; ++round) {
    const size_t begin = round == 0 ? 0 : rng.Below(n);
    const size_t count = round == 0 ? n : 1 + rng.Below(n - begin);
    const std::vector<uint32_t> order = orders.Of(begin, count);
    std::vector<uint8_t> seen(count);
    for (const uint32_t i : order) {
      ASSERT_LT(i, count);
      ++seen[i];
    }
    const auto valid = std::span(rows.valid).subspan(begin, count);
    EXPECT_TRUE(std::equal(seen.begin(), seen.end(), valid.begin())) << begin << ", " << count;
  }
}

// Neighbours already, few, or none at all.
TEST(PointOrdersTest, ThereAreNoneWhereNoneHelps) {
  ThreadPool pool(2);
  std::vector<Vec3f> line(40'000);
  for (size_t i = 0; i < line.size(); ++i) line[i].x = static_cast<float>(i);
  EXPECT_TRUE(PointOrders(line, std::vector<uint8_t>(line.size(), 1), pool).empty());
  const Points few = MakeRows(20);
  EXPECT_TRUE(PointOrders(few.positions, few.valid, pool).empty());
  EXPECT_TRUE(PointOrders({}, {}, pool).empty());
  EXPECT_EQ(PointOrders().MemoryBytes(), 0u);
}

TEST(PointOrdersTest, ThereAreNoneOnceCancelled) {
  ThreadPool pool(2);
  const Points rows = MakeRows(200);
  CancelToken cancel;
  const PointOrders orders(rows.positions, rows.valid, pool, &cancel);
  EXPECT_FALSE(orders.empty());
  EXPECT_LE(orders.MemoryBytes(), PointOrders::BytesFor(rows.positions.size(), pool.threads()));
  cancel.Cancel();
  EXPECT_TRUE(PointOrders(rows.positions, rows.valid, pool, &cancel).empty());
}

// Points that name no triangle, one by one or as a whole, in rows and shuffled.
TEST(PointOrderTest, SourcesMayBeLeftOut) {
  TestRng rng;
  const IndexedGeometry scene = IndexObjects({MakeClosedSphere(16, 24, 0.4, {0, 0, 0.5})}, Vec3d{});
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({0.1, 0.2, -3}), 0, {}, &samples).ok());
  ASSERT_TRUE(AppendSamples(Light::Directional({0.3, 0.1, -1}), 1, {}, &samples).ok());
  const Points rows = MakeRows(64);
  for (const Points& points : {rows, Permuted(rows, Shuffled(rows.positions.size(), rng))}) {
    for (const Strategy strategy : {Strategy::kAuto, Strategy::kPacket, Strategy::kSingle}) {
      ShadowResult named, unnamed;
      const QueryOptions options = {.strategy = strategy};
      ASSERT_TRUE(ComputeShadows(scene, {points.positions, points.sources, points.valid}, samples,
                                 {}, {}, {}, options, &named)
                      .ok());
      ASSERT_TRUE(ComputeShadows(scene, {points.positions, {}, points.valid}, samples, {}, {}, {},
                                 options, &unnamed)
                      .ok());
      EXPECT_EQ(named.lit_bits, unnamed.lit_bits);
    }
  }
  ShadowResult result;
  const absl::Status status =
      ComputeShadows(scene, {rows.positions, std::span(rows.sources).first(3), rows.valid}, samples,
                     {}, {}, {}, {}, &result);
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("4096 positions, 3 sources"));
}

// Where all points are valid nobody needs to say so, of few, of a group's and of many; and flags
// that are there are heeded: as many as points.
TEST(PointOrderTest, FlagsMayBeLeftOut) {
  TestRng rng;
  const IndexedGeometry scene = IndexObjects({MakeClosedSphere(16, 24, 0.4, {0, 0, 0.5})}, Vec3d{});
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({0.1, 0.2, -3}), 0, {}, &samples).ok());
  ASSERT_TRUE(AppendSamples(Light::Directional({0.3, 0.1, -1}), 1, {}, &samples).ok());
  const Points rows = MakeRows(128);
  for (const Points& points : {rows, Permuted(rows, Shuffled(rows.positions.size(), rng))}) {
    for (const size_t count : {size_t{0}, size_t{5}, size_t{4096}, points.positions.size()}) {
      const std::span<const Vec3f> positions = std::span(points.positions).first(count);
      const std::vector<uint8_t> ones(count, 1);
      ShadowResult flagged, plain;
      ASSERT_TRUE(
          ComputeShadows(scene, {positions, {}, ones}, samples, {}, {}, {}, {}, &flagged).ok());
      ASSERT_TRUE(ComputeShadows(scene, {positions, {}, {}}, samples, {},
                                 {.next = {positions, {}, {}}}, {}, {}, &plain)
                      .ok());
      EXPECT_EQ(flagged.lit_bits, plain.lit_bits);
      if (count == 0) continue;  // No flag would do.
      EXPECT_EQ(ComputeShadows(scene, {positions, {}, std::span(ones).first(count - 1)}, samples,
                               {}, {}, {}, {}, &plain)
                    .code(),
                absl::StatusCode::kInvalidArgument);
    }
  }
}

TEST(PointOrderTest, ShuffledPointsGetTheirOwnAnswers) {
  TestRng rng;
  const IndexedGeometry scene = IndexObjects({MakeClosedSphere(16, 24, 0.4, {0, 0, 0.5})}, Vec3d{});
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({0.1, 0.2, -3}), 0, {}, &samples).ok());
  ASSERT_TRUE(AppendSamples(Light::Directional({0.3, 0.1, -1}), 1, {}, &samples).ok());
  const std::vector<double> weights = {0.25, 3.5};
  const Points rows = MakeRows(64);
  const std::vector<size_t> order = Shuffled(rows.positions.size(), rng);
  const Points mixed = Permuted(rows, order);
  ASSERT_TRUE(OrderingPays(mixed.positions, mixed.valid, samples.size()));
  ASSERT_FALSE(OrderingPays(rows.positions, rows.valid, samples.size()));
  const ShadowOutputs outputs = {
      .bits = true, .counts = true, .weighted_sums = true, .blockers = true};
  for (const bool blockers : {false, true}) {
    ShadowOutputs asked = outputs;
    asked.blockers = blockers;
    ShadowResult in_rows, in_mixed;
    ASSERT_TRUE(ComputeShadows(scene, {rows.positions, rows.sources, rows.valid}, samples, weights,
                               {}, asked, {}, &in_rows)
                    .ok());
    ASSERT_TRUE(ComputeShadows(scene, {mixed.positions, mixed.sources, mixed.valid}, samples,
                               weights, {}, asked, {}, &in_mixed)
                    .ok());
    const size_t n = order.size(), row = (n + 7) / 8;
    size_t lit = 0;
    for (size_t i = 0; i < n; ++i) {
      const size_t p = order[i];
      EXPECT_EQ(in_mixed.lit_counts[i], in_rows.lit_counts[p]);
      EXPECT_EQ(in_mixed.weighted_sums[i], in_rows.weighted_sums[p]);
      for (size_t s = 0; s < samples.size(); ++s) {
        const int bit = in_mixed.lit_bits[s * row + i / 8] >> (i % 8) & 1;
        EXPECT_EQ(bit, in_rows.lit_bits[s * row + p / 8] >> (p % 8) & 1);
        lit += static_cast<size_t>(bit);
        if (blockers) {
          EXPECT_EQ(in_mixed.blocker[s * n + i], in_rows.blocker[s * n + p]);
          EXPECT_EQ(in_mixed.blocker_t[s * n + i], in_rows.blocker_t[s * n + p]);
        }
      }
    }
    EXPECT_GT(lit, n / 10);
    EXPECT_LT(lit, 2 * n - n / 10);
  }
}

// What points elsewhere left behind says where to look first, and what comes next what to fetch;
// neither says anything else.
TEST(PointOrderTest, HintsAndGivenOrdersChangeNoAnswer) {
  TestRng rng;
  const IndexedGeometry scene = IndexObjects({MakeClosedSphere(16, 24, 0.4, {0, 0, 0.5})}, Vec3d{});
  std::vector<LightSample> samples;
  for (uint32_t i = 0; i < 6; ++i) {
    const Vec3d at = {rng.Uniform(-1, 1), rng.Uniform(-1, 1), -3};
    ASSERT_TRUE(AppendSamples(Light::Point(at), i, {}, &samples).ok());
  }
  const Points rows = MakeRows(64);
  const Points mixed = Permuted(rows, Shuffled(rows.positions.size(), rng));
  ShadowResult plain, hinted;
  const PointRange points{mixed.positions, mixed.sources, mixed.valid};
  ASSERT_TRUE(ComputeShadows(scene, points, samples, {}, {}, {.bits = true}, {}, &plain).ok());
  ShadowHints hints;
  const ShadowOptions shadow{.ordered = true, .hints = &hints};
  for (int round = 0; round < 3; ++round) {
    ASSERT_TRUE(
        ComputeShadows(scene, points, samples, {}, shadow, {.bits = true}, {}, &hinted).ok());
    EXPECT_EQ(hinted.lit_bits, plain.lit_bits) << round;
    EXPECT_EQ(hints.first_leaves.size(), samples.size());
  }
  // Fewer, as many and more than are walked, with and without sources.
  for (const size_t count : {size_t{0}, size_t{1}, size_t{100}, rows.positions.size()}) {
    for (const bool sources : {false, true}) {
      ShadowOptions shadow;
      shadow.next = {
          std::span(rows.positions).first(count), {}, std::span(rows.valid).first(count)};
      if (sources) shadow.next.sources = std::span(rows.sources).first(count);
      for (const PointRange& some :
           {points, PointRange{points.positions.first(16), {}, points.valid.first(16)}}) {
        ASSERT_TRUE(ComputeShadows(scene, some, samples, {}, {}, {.bits = true}, {}, &plain).ok());
        ASSERT_TRUE(
            ComputeShadows(scene, some, samples, {}, shadow, {.bits = true}, {}, &hinted).ok());
        EXPECT_EQ(hinted.lit_bits, plain.lit_bits) << count;
      }
    }
  }
  // Rays that were dear have the next points ordered, whose own costs are told again.
  const PointRange in_rows{rows.positions, rows.sources, rows.valid};
  const std::span<const LightSample> light(samples.data(), 1);
  ASSERT_TRUE(ComputeShadows(scene, in_rows, light, {}, {}, {.bits = true}, {}, &plain).ok());
  for (const float cost : {0.0f, 1e6f}) {
    ShadowHints dear = {.ray_cost = cost};
    ASSERT_TRUE(
        ComputeShadows(scene, in_rows, light, {}, {.hints = &dear}, {.bits = true}, {}, &hinted)
            .ok());
    EXPECT_EQ(hinted.lit_bits, plain.lit_bits) << cost;
    EXPECT_GT(dear.ray_cost, cost / 2);
    EXPECT_LT(dear.ray_cost, cost / 2 + 10'000);
  }
  // No points say nothing of what rays cost.
  ShadowHints known = {.ray_cost = 300};
  ASSERT_TRUE(
      ComputeShadows(scene, {}, light, {}, {.hints = &known}, {.bits = true}, {}, &hinted).ok());
  EXPECT_EQ(known.ray_cost, 300);
  ShadowOptions unequal;
  unequal.next = {rows.positions, std::span(rows.sources).first(3), rows.valid};
  const absl::Status not_as_many =
      ComputeShadows(scene, points, samples, {}, unequal, {.bits = true}, {}, &hinted);
  EXPECT_TRUE(absl::IsInvalidArgument(not_as_many)) << not_as_many;
  hints.first_leaves.pop_back();
  const absl::Status wrong =
      ComputeShadows(scene, points, samples, {}, shadow, {.bits = true}, {}, &hinted);
  EXPECT_TRUE(absl::IsInvalidArgument(wrong)) << wrong;
}

// A light whose points come range by range, each told of all that follow: what is asked for goes on
// from call to call, ahead of what is read, but not far; and when the same points come again, from
// their beginning.
TEST(PointOrderTest, PointsToComeAreFetchedAhead) {
  const IndexedGeometry scene = IndexObjects({MakeClosedSphere(16, 24, 0.4, {0, 0, 0.5})}, Vec3d{});
  std::vector<LightSample> light;
  ASSERT_TRUE(AppendSamples(Light::Point({0.1, 0.2, -3}), 0, {}, &light).ok());
  const Points rows = MakeRows(256);
  const std::span<const Vec3f> all(rows.positions);
  ShadowHints hints;
  for (const size_t size : {size_t{1000}, size_t{4096}, size_t{9001}, size_t{9001}}) {
    uintptr_t last = 0;
    for (size_t first = 0; first < all.size(); first += size) {
      const size_t count = std::min(size, all.size() - first);
      const PointRange some{all.subspan(first, count), {}, {}};
      const PointRange rest{all.subspan(first + count), {}, {}};
      ShadowResult plain, hinted;
      ASSERT_TRUE(ComputeShadows(scene, some, light, {}, {.ordered = true}, {}, {}, &plain).ok());
      ASSERT_TRUE(ComputeShadows(scene, some, light, {},
                                 {.ordered = true, .hints = &hints, .next = rest}, {}, {}, &hinted)
                      .ok());
      EXPECT_EQ(hinted.lit_bits, plain.lit_bits) << size << " from " << first;
      if (rest.positions.empty()) continue;
      const uintptr_t end = reinterpret_cast<uintptr_t>(rest.positions.data());
      EXPECT_GT(hints.fetched, end) << size << " from " << first;
      EXPECT_LE(hints.fetched, end + 6 * 4096 * sizeof(Vec3f)) << size << " from " << first;
      EXPECT_GE(hints.fetched, last) << size << " from " << first;
      last = hints.fetched;
    }
  }
}

}  // namespace
}  // namespace sightline
