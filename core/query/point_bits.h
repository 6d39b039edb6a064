// SPDX-License-Identifier: Apache-2.0
//
// Bits that were found in an order of one's own (core/query/point_order.h), back in the order in
// which the points were given. Row by row at the end, by reading: to set each bit where it belongs
// as it is found would touch every row's memory again for every group of points.
//
// Thread safety: a plain value; functions.
//
//   PointBits bits(order, n);
//   bits.PutBack(result.lit_bits);
#ifndef SIGHTLINE_CORE_QUERY_POINT_BITS_H_
#define SIGHTLINE_CORE_QUERY_POINT_BITS_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/cancel.h"

namespace sightline {

class PointBits {
 public:
  // Of `points` points, of which order[k] comes k-th and those that are not in `order` do not come.
  // Once `cancel` (may be null) has fired it is of no use. REQUIRES: order names each point once at
  // most; fewer than 2^32 - 1 points.
  PointBits(std::span<const uint32_t> order, size_t points, const CancelToken* cancel = nullptr);
  // The same order, by where it has each of the points: `points` where it does not have it, and at
  // the end, up to a multiple of eight. REQUIRES: that many; they must outlive this.
  static PointBits ByRanks(std::span<const uint32_t> ranks, size_t points);

  // A copy's own ranks would be another's.
  PointBits(PointBits&&) = default;
  PointBits& operator=(PointBits&&) = default;

  // A row is (points + 7) / 8 bytes, rows follow one another. Bit k of a row, least significant
  // first, is what the k-th of the order has, and 0 beyond them; then bit p is what point p has,
  // and 0 where it does not come. False: `cancel` has fired, and rows hold nothing of use.
  // REQUIRES: rows.size() is a multiple of a row's.
  bool PutBack(std::span<uint8_t> rows, const CancelToken* cancel = nullptr) const;

 private:
  explicit PointBits(size_t points) : points_(points) {}
  template <size_t kRows>
  bool PutBackSome(uint8_t* rows, const CancelToken* cancel, std::vector<uint32_t>* given) const;

  size_t points_;
  std::vector<uint32_t> own_ranks_;  // Empty where they are another's.
  // By point, a whole vector of them at the end: where its bit is.
  std::span<const uint32_t> ranks_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_POINT_BITS_H_
