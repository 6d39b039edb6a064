// SPDX-License-Identifier: Apache-2.0
#include "core/accel/cell_grid.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <set>
#include <vector>

#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline::bvh_build {
namespace {

using testing_support::TestRng;

// Of no extent, so that its doubled centroid is twice the point.
Primitive PrimitiveAt(Vec3f p) {
  return Primitive(Float8{p.x, p.y, p.z, 0, -p.x, -p.y, -p.z, std::bit_cast<float>(7u)});
}

Vec3f RandomPoint(TestRng& rng, const Vec3f& lo, const Vec3f& hi) {
  return {static_cast<float>(rng.Uniform(lo.x, hi.x)), static_cast<float>(rng.Uniform(lo.y, hi.y)),
          static_cast<float>(rng.Uniform(lo.z, hi.z))};
}

CellGrid GridBetween(const Vec3f& lo, const Vec3f& hi, int bits) {
  return {Float4{2 * lo.x, 2 * lo.y, 2 * lo.z, 0}, Float4{2 * hi.x, 2 * hi.y, 2 * hi.z, 0}, bits};
}

TEST(CellGridTest, PlacesAreMonotoneAndCellsAreCubic) {
  TestRng rng;
  const Vec3f lo = {-1, 2, 5}, hi = {3, 4, 6};
  for (const int bits : {0, 1, 3, 7, kMaxCellBits}) {
    const CellGrid grid = GridBetween(lo, hi, bits);
    EXPECT_EQ(grid.cells(), size_t{1} << bits);
    const auto place = [&](const Vec3f& p) { return grid.Place(grid.CellOf(PrimitiveAt(p))); };
    const std::array<uint8_t, 3> first = place(lo), last = place(hi);
    EXPECT_EQ(first, (std::array<uint8_t, 3>{}));
    // Sides of 4, 2 and 1: never fewer lines along a longer one.
    EXPECT_TRUE(last[0] >= last[1] && last[1] >= last[2]);
    EXPECT_EQ((last[0] + 1) * (last[1] + 1) * (last[2] + 1), 1 << bits);
    for (int i = 0; i < 200; ++i) {
      const Vec3f p = RandomPoint(rng, lo, hi), q = RandomPoint(rng, lo, hi);
      for (int axis = 0; axis < 3; ++axis) {
        const auto k = static_cast<size_t>(axis);
        if (p[axis] <= q[axis]) {
          EXPECT_LE(place(p)[k], place(q)[k]);
        }
        EXPECT_LE(place(p)[k], last[k]);
      }
    }
    EXPECT_EQ(place({-100, -100, -100}), first);
    EXPECT_EQ(place({100, 100, 100}), last);
  }
}

TEST(CellGridTest, NothingIsDividedAlongAnAxisWithoutExtent) {
  // The longest of them is divided nevertheless, as far as the bits go, but not looked at.
  for (const float extent :
       {0.0f, std::numeric_limits<float>::denorm_min(), 0x1p-124f, 0x1p-121f}) {
    const CellGrid grid = GridBetween({0, 0, 0}, {0, 0, extent}, 5);
    EXPECT_EQ(grid.CellOf(PrimitiveAt({0, 0, extent})), 0u) << extent;
  }
  const CellGrid wide = GridBetween({0, 0, 0}, {0, 0, 0x1p-110f}, 5);
  EXPECT_GT(wide.CellOf(PrimitiveAt({0, 0, 0x1p-110f})), 0u);
}

std::vector<Cell> RandomCells(TestRng& rng, int side, size_t n) {
  std::set<std::array<uint8_t, 3>> places;
  while (places.size() < n) {
    std::array<uint8_t, 3> place;
    for (uint8_t& p : place) p = static_cast<uint8_t>(rng.Below(static_cast<uint64_t>(side)));
    places.insert(place);
  }
  std::vector<Cell> cells;
  for (const auto& place : places) {
    Cell cell;
    cell.index = static_cast<uint16_t>(cells.size());
    cell.place = place;
    for (uint64_t k = 1 + rng.Below(30); k > 0; --k) {
      const Vec3f corner = {static_cast<float>(place[0]), static_cast<float>(place[1]),
                            static_cast<float>(place[2])};
      cell.Extend(
          PrimitiveAt(RandomPoint(rng, corner, {corner.x + 2, corner.y + 1, corner.z + 1})));
    }
    cells.push_back(cell);
  }
  return cells;
}

float CostOf(const std::vector<Cell>& cells, CellLine line, const SahCost& cost) {
  CellSum sides[2];
  for (const Cell& cell : cells) {
    sides[cell.place[static_cast<size_t>(line.axis)] < line.line ? 0 : 1].Extend(cell);
  }
  if (sides[0].count == 0 || sides[1].count == 0) return std::numeric_limits<float>::infinity();
  return sides[0].bounds.HalfArea(cost.area_scale) * cost.Subtree(sides[0].count) +
         sides[1].bounds.HalfArea(cost.area_scale) * cost.Subtree(sides[1].count);
}

TEST(CellLineTest, IsTheCheapestOfAll) {
  TestRng rng;
  const SahCost cost;
  for (int i = 0; i < 200; ++i) {
    const int side = static_cast<int>(2 + rng.Below(7));
    std::vector<Cell> cells =
        RandomCells(rng, side, 2 + rng.Below(static_cast<uint64_t>(side) * side));
    float least = std::numeric_limits<float>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      for (int line = 1; line < side; ++line) {
        least = std::min(least, CostOf(cells, {axis, line}, cost));
      }
    }
    const CellLine line = CheapestLine(cells, cost);
    ASSERT_GE(line.axis, 0);
    EXPECT_EQ(CostOf(cells, line, cost), least);
    const size_t left = PartitionCells(cells, line);
    EXPECT_TRUE(left > 0 && left < cells.size());
    for (size_t c = 0; c < cells.size(); ++c) {
      EXPECT_EQ(cells[c].place[static_cast<size_t>(line.axis)] < line.line, c < left);
    }
  }
}

// So many levels that way, whatever the cells hold, leave one cell each.
TEST(CellLineTest, HalvingEndsAfterTheGridsBits) {
  TestRng rng;
  const auto levels = [](auto self, std::span<Cell> cells) -> int {
    if (cells.size() == 1) return 0;
    const size_t left = PartitionCells(cells, MiddleLine(cells));
    EXPECT_TRUE(left > 0 && left < cells.size());
    return 1 + std::max(self(self, cells.first(left)), self(self, cells.subspan(left)));
  };
  for (int i = 0; i < 50; ++i) {
    std::vector<Cell> cells = RandomCells(rng, 8, 2 + rng.Below(200));
    EXPECT_LE(levels(levels, cells), 9);
  }
}

}  // namespace
}  // namespace sightline::bvh_build
