// SPDX-License-Identifier: Apache-2.0
#include "core/query/point_bits.h"

#include <cstring>

#include "core/base/check.h"
#include "core/base/polled_blocks.h"
#include "hwy/highway.h"

namespace sightline {
namespace {

// AVX2, the floor, is enough: what costs is fetching.
namespace hn = hwy::HWY_NAMESPACE;
using Eight = hn::CappedTag<uint32_t, 8>;
constexpr size_t kLanes = 8;  // A byte of bits.
static_assert(hn::MaxLanes(Eight()) == kLanes, "x86-64-v3 holds eight numbers in a vector");

// Rows put back together, so that ranks are read once for them. Those of a million points, as they
// were given, take half of a second-level cache.
constexpr size_t kRowsAtOnce = 4;

// A row as words, with a zero bit behind the last point's.
size_t WordsOf(size_t points) { return points / 32 + 1; }

}  // namespace

PointBits::PointBits(std::span<const uint32_t> order, size_t points, const CancelToken* cancel)
    : points_(points) {
  SIGHTLINE_CHECK_LE(order.size(), points);
  // Where no point is, the bit behind the last one's.
  own_ranks_.assign((points + kLanes - 1) / kLanes * kLanes, static_cast<uint32_t>(points));
  InPolledBlocks(order.size(), cancel, [&](size_t begin, size_t end) {
    for (size_t k = begin; k < end; ++k) own_ranks_[order[k]] = static_cast<uint32_t>(k);
  });
  ranks_ = own_ranks_;
}

PointBits PointBits::ByRanks(std::span<const uint32_t> ranks, size_t points) {
  SIGHTLINE_CHECK_EQ(ranks.size(), (points + kLanes - 1) / kLanes * kLanes);
  PointBits bits(points);
  bits.ranks_ = ranks;
  return bits;
}

bool PointBits::PutBack(std::span<uint8_t> rows, const CancelToken* cancel) const {
  const size_t row_bytes = (points_ + 7) / 8;
  if (row_bytes == 0) return true;
  SIGHTLINE_CHECK_EQ(rows.size() % row_bytes, size_t{0});
  std::vector<uint32_t> given(kRowsAtOnce * WordsOf(points_));
  size_t left = rows.size() / row_bytes;
  uint8_t* at = rows.data();
  for (; left >= kRowsAtOnce; left -= kRowsAtOnce, at += kRowsAtOnce * row_bytes) {
    if (!PutBackSome<kRowsAtOnce>(at, cancel, &given)) return false;
  }
  for (; left > 0; --left, at += row_bytes) {
    if (!PutBackSome<1>(at, cancel, &given)) return false;
  }
  return true;
}

template <size_t kRows>
bool PointBits::PutBackSome(uint8_t* rows, const CancelToken* cancel,
                            std::vector<uint32_t>* given) const {
  const Eight d;
  const hn::RebindToSigned<Eight> di;
  const size_t row_bytes = (points_ + 7) / 8, words = WordsOf(points_);
  for (size_t k = 0; k < kRows; ++k) {
    std::memcpy(given->data() + k * words, rows + k * row_bytes, row_bytes);
  }
  const auto one = hn::Set(d, 1), in_word = hn::Set(d, 31);
  return InPolledBlocks(row_bytes, kPolledBlock / kLanes, cancel, [&](size_t begin, size_t end) {
    for (size_t byte = begin; byte < end; ++byte) {
      const auto rank = hn::LoadU(d, ranks_.data() + kLanes * byte);
      const auto word = hn::BitCast(di, hn::ShiftRight<5>(rank));
      const auto bit = hn::Shl(one, hn::And(rank, in_word));
      for (size_t k = 0; k < kRows; ++k) {
        uint8_t bits[8];  // StoreMaskBits may write as many.
        const auto found = hn::GatherIndex(d, given->data() + k * words, word);
        hn::StoreMaskBits(d, hn::TestBit(found, bit), bits);
        rows[k * row_bytes + byte] = bits[0];
      }
    }
  });
}

}  // namespace sightline
