// SPDX-License-Identifier: Apache-2.0
#include "core/query/point_parter.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "core/base/compress-inl.h"
#include "hwy/highway.h"

namespace sightline {
namespace {

// AVX2, the floor: eight floats.
namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, 8>;
using DU = hn::RebindToUnsigned<D>;
constexpr size_t kLanes = hn::MaxLanes(D());
static_assert(kLanes == 8, "x86-64-v3 holds eight floats in a vector");

// The bits of a float, ordered as floats are.
int32_t Ordered(int32_t bits) { return bits ^ ((bits >> 31) & 0x7fffffff); }
int32_t ToOrdered(float x) { return Ordered(std::bit_cast<int32_t>(x)); }
float FromOrdered(int32_t x) { return std::bit_cast<float>(Ordered(x)); }

}  // namespace

PointParter::PointParter(std::span<const Vec3f> positions, std::span<const uint8_t> valid)
    : room_(positions.size() + kLanes),
      coordinates_(std::make_unique_for_overwrite<float[]>(6 * room_)),
      numbers_(std::make_unique_for_overwrite<uint32_t[]>(2 * room_)) {
  for (size_t k = 0; k < 3; ++k) {
    rows_.at[k] = coordinates_.get() + k * room_;
    aside_.at[k] = coordinates_.get() + (3 + k) * room_;
  }
  rows_.number = numbers_.get();
  aside_.number = numbers_.get() + room_;
  for (size_t i = 0; i < positions.size(); ++i) {
    if (!valid[i]) continue;
    for (int k = 0; k < 3; ++k) rows_.at[k][count_] = positions[i][k];
    rows_.number[count_++] = static_cast<uint32_t>(i);
  }
}

void PointParter::Part(size_t begin, size_t end) {
  while (end - begin > kSmallestBlock) {
    Range range;
    const int axis = WidestAxis(begin, end, &range);
    size_t first = kSmallestBlock;
    while (2 * first < end - begin) first *= 2;
    Select(begin, begin + first, end, axis, range);
    Part(begin + first, end);
    end = begin + first;
  }
}

int PointParter::WidestAxis(size_t begin, size_t end, Range* range) const {
  const D d;
  float least[3], most[3];
  for (int k = 0; k < 3; ++k) {
    const float* from = rows_.at[k];
    auto lo = hn::LoadU(d, from + end - kLanes), hi = lo;
    for (size_t i = begin; i + kLanes < end; i += kLanes) {
      const auto v = hn::LoadU(d, from + i);
      lo = hn::Min(lo, v);
      hi = hn::Max(hi, v);
    }
    least[k] = hn::GetLane(hn::MinOfLanes(d, lo));
    most[k] = hn::GetLane(hn::MaxOfLanes(d, hi));
  }
  const auto extent = [&](int k) { return most[k] - least[k]; };
  int axis = extent(1) > extent(0) ? 1 : 0;
  if (extent(2) > extent(axis)) axis = 2;
  *range = {ToOrdered(least[axis]), ToOrdered(most[axis])};
  return axis;
}

void PointParter::Select(size_t begin, size_t middle, size_t end, int axis, Range range) {
  // Where points are spread evenly the first guess is nearly right. After some more, halving what
  // floats there are in the range ends it.
  constexpr int kByExtent = 3, kByMedian = 8;
  for (int pass = 0; begin < middle && middle < end && range.least < range.most; ++pass) {
    const float least = FromOrdered(range.least), most = FromOrdered(range.most);
    float pivot;
    if (pass < kByExtent) {
      const double share = static_cast<double>(middle - begin) / static_cast<double>(end - begin);
      pivot = static_cast<float>(least + (static_cast<double>(most) - least) * share);
    } else if (pass < kByMedian) {
      const float* keys = rows_.at[axis] + begin;
      const size_t count = end - begin;
      const float a = keys[count / 4], b = keys[count / 2], c = keys[count / 4 * 3];
      pivot = std::max(std::min(a, b), std::min(std::max(a, b), c));
    } else {
      pivot = FromOrdered(static_cast<int32_t>((int64_t{range.least} + range.most + 1) >> 1));
    }
    // None is below the least.
    const bool equal = !(pivot > least);
    const size_t split = Split(begin, end, axis, equal ? least : pivot, equal);
    if (equal) {
      if (split >= middle) return;
      begin = split;
      ++range.least;
    } else if (split > middle) {
      end = split;
      range.most = ToOrdered(pivot) - 1;
    } else {
      begin = split;
      range.least = ToOrdered(pivot);
    }
  }
}

size_t PointParter::Split(size_t begin, size_t end, int axis, float pivot, bool equal) {
  const D d;
  const DU du;
  const float* keys = rows_.at[axis];
  // Vectors are stored whole on either side, those that belong there next to the ones before; what
  // else they hold is overwritten by what follows, and was read already. Those aside grow downward.
  size_t front = begin, aside = room_;
  const auto move = [&](const auto& of, auto* row, auto* other, size_t i, auto order) {
    const auto v = hn::TableLookupLanes(hn::LoadU(of, row + i), hn::IndicesFromVec(of, order));
    hn::StoreU(v, of, row + front);
    hn::StoreU(v, of, other + aside - kLanes);
  };
  const auto at = hn::Set(d, pivot);
  size_t i = begin;
  for (; i + kLanes <= end; i += kLanes) {
    const auto key = hn::LoadU(d, keys + i);
    uint8_t stays;
    const auto order =
        HWY_NAMESPACE::ChosenFirst(d, equal ? hn::Le(key, at) : hn::Lt(key, at), &stays);
    for (int k = 0; k < 3; ++k) move(d, rows_.at[k], aside_.at[k], i, order);
    move(du, rows_.number, aside_.number, i, order);
    const auto count = static_cast<size_t>(std::popcount(stays));
    front += count;
    aside -= kLanes - count;
  }
  for (; i < end; ++i) {
    const bool stays = equal ? keys[i] <= pivot : keys[i] < pivot;
    const Rows& to = stays ? rows_ : aside_;
    const size_t place = stays ? front++ : --aside;
    for (int k = 0; k < 3; ++k) to.at[k][place] = rows_.at[k][i];
    to.number[place] = rows_.number[i];
  }
  const size_t bytes_aside = (room_ - aside) * sizeof(float);
  for (int k = 0; k < 3; ++k) {
    std::memcpy(rows_.at[k] + front, aside_.at[k] + aside, bytes_aside);
  }
  std::memcpy(rows_.number + front, aside_.number + aside, bytes_aside);
  return front;
}

}  // namespace sightline
