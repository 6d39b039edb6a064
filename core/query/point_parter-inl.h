// SPDX-License-Identifier: Apache-2.0
//
// point_parter.h, a vector at a time. The coordinate that parts some points is found by counting
// how many lie below a guess, which moves nothing; then each point is moved once, without a branch.
// Parts of 256 are left to key_parter-inl.h.
//
// Thread safety: a plain value.

#if defined(SIGHTLINE_CORE_QUERY_POINT_PARTER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_QUERY_POINT_PARTER_INL_H_
#undef SIGHTLINE_CORE_QUERY_POINT_PARTER_INL_H_
#else
#define SIGHTLINE_CORE_QUERY_POINT_PARTER_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <span>

#include "core/base/aligned_vector.h"
#include "core/base/cancel.h"
#include "core/base/compress-inl.h"
#include "core/base/polled_blocks.h"
#include "core/base/work_poll.h"
#include "core/geometry/vec3.h"
#include "core/query/key_parter-inl.h"
#include "core/query/point_parter.h"
#include "core/query/point_rows-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

class PointParter {
 public:
  // Parts the points into *parted.
  PointParter(std::span<const Vec3f> positions, std::span<const uint8_t> valid,
              const CancelToken* cancel, PartedPoints* parted)
      : positions_(positions),
        cancel_(cancel),
        poll_(cancel),
        room_((positions.size() + kSmallestPart + kLanes) / kLanes * kLanes),
        parted_(*parted) {
    all_.ResizeUninitialized(2 * kRows * room_);
    for (size_t side = 0; side < 2; ++side) {
      for (size_t k = 0; k < kRows; ++k) rows_[side][k] = all_.data() + (side * kRows + k) * room_;
    }
    const size_t count = Fill(valid);
    parted->numbers.ResizeUninitialized(count);
    parted->positions.ResizeUninitialized(count);
    if (filled_) Part(0, count, 0);
    if (!filled_ || poll_.stopped()) *parted = PartedPoints();
  }

 private:
  using D = hn::CappedTag<float, 16>;
  using V = hn::Vec<D>;
  using M = hn::Mask<D>;
  using Di = hn::RebindToSigned<D>;
  static constexpr size_t kLanes = hn::MaxLanes(D());
  // So many are ranked by comparing each with all.
  static constexpr size_t kFewCoordinates = 32;

  // All coordinates of some points lie in it.
  struct Range {
    float least, most;
  };
  // Where points part: those below `limit` come first, and so many of those at it.
  struct Parting {
    float limit;
    size_t at_limit;
  };

  // The bits of a float, ordered as floats are.
  static int32_t Ordered(int32_t bits) { return bits ^ ((bits >> 31) & 0x7fffffff); }
  static int32_t ToOrdered(float x) { return Ordered(std::bit_cast<int32_t>(x + 0.0f)); }
  static float FromOrdered(int32_t key) { return std::bit_cast<float>(Ordered(key)); }
  static float Above(float x) { return FromOrdered(ToOrdered(x) + 1); }
  static float Below(float x) { return -Above(-x); }

  // Returns how many are valid.
  size_t Fill(std::span<const uint8_t> valid) {
    size_t count = 0;
    const bool all = !valid.empty() && std::memchr(valid.data(), 0, valid.size()) == nullptr;
    static_assert(kPolledBlock % kLanes == 0);
    filled_ = InPolledBlocks(positions_.size(), cancel_, [&](size_t begin, size_t end) {
      if (all) {
        FillAll(begin, end);
        count = end;
      } else {
        count = FillValid(valid, begin, end, count);
      }
    });
    return count;
  }
  // Points begin .. end - 1 to their own places.
  HWY_NOINLINE void FillAll(size_t begin, size_t end) {
    float* const* rows = rows_[0];
    const Di d;
    Box3f box;  // Nobody asks for it.
    SplitPoints(positions_.subspan(begin, end - begin), rows[0] + begin, rows[1] + begin,
                rows[2] + begin, &box);
    auto number = hn::Iota(d, static_cast<int32_t>(begin));
    for (size_t i = begin; i < end; i += kLanes) {
      hn::Store(number, d, reinterpret_cast<int32_t*>(rows[kNumber]) + i);
      number = hn::Add(number, hn::Set(d, static_cast<int32_t>(kLanes)));
    }
  }
  // The valid ones of them, behind `count` others. Returns how many there are then.
  size_t FillValid(std::span<const uint8_t> valid, size_t begin, size_t end, size_t count) {
    float* const* rows = rows_[0];
    for (size_t i = begin; i < end; ++i) {
      for (int k = 0; k < 3; ++k) rows[k][count] = positions_[i][k];
      rows[kNumber][count] = std::bit_cast<float>(static_cast<uint32_t>(i));
      count += valid[i] != 0;
    }
    return count;
  }

  // Points begin .. end - 1 of rows_[side], whose place on the other side is free.
  void Part(size_t begin, size_t end, size_t side) {
    while (end - begin > KeyParter::kMaxPoints) {
      if (poll_.Stops(end - begin)) return;
      const size_t first = FirstPart(end - begin);
      Range range;
      const float* const row = rows_[side][WidestAxis(begin, end, side, &range)] + begin;
      const Parting parting = Select(row, end - begin, first, range);
      if (poll_.stopped()) return;
      const V limit = hn::Set(D(), parting.limit);
      if (parting.at_limit == 0) {
        Move(begin, end, begin + first, side, row,
             [limit](V v) HWY_ATTR { return hn::Lt(v, limit); });
      } else {
        MoveSome(begin, end, begin + first, side, row, parting);
      }
      // What is stored past its end lies in the place of points that are done with.
      Part(begin + first, end, 1 - side);
      end = begin + first;
    }
    if (end > begin) PartFew(begin, end, side);
  }

  HWY_NOINLINE void PartFew(size_t begin, size_t end, size_t side) {
    const float* rows[3];
    float least[3];
    float widest = 0;
    for (size_t k = 0; k < 3; ++k) {
      rows[k] = rows_[side][k] + begin;
      const Range range = Extent(rows[k], end - begin);
      least[k] = range.least;
      widest = std::max(widest, range.most - range.least);
    }
    KeyParter(rows, end - begin, least, widest, [&](size_t at, size_t i) {
      const auto number = std::bit_cast<uint32_t>(rows_[side][kNumber][begin + i]);
      parted_.numbers[begin + at] = number;
      parted_.positions[begin + at] = positions_[number];
    });
  }

  static HWY_INLINE Range Extent(const float* row, size_t count) {
    const D d;
    V lo = hn::Set(d, row[0]), hi = lo;
    size_t i = 0;
    for (; i + kLanes <= count; i += kLanes) {
      const V v = hn::LoadU(d, row + i);
      lo = hn::Min(lo, v);
      hi = hn::Max(hi, v);
    }
    if (i < count) {
      const V v = hn::IfThenElse(hn::FirstN(d, count - i), hn::LoadU(d, row + i), lo);
      lo = hn::Min(lo, v);
      hi = hn::Max(hi, v);
    }
    return {hn::GetLane(hn::MinOfLanes(d, lo)), hn::GetLane(hn::MaxOfLanes(d, hi))};
  }

  size_t WidestAxis(size_t begin, size_t end, size_t side, Range* range) const {
    size_t axis = 0;
    for (size_t k = 0; k < 3; ++k) {
      const Range own = Extent(rows_[side][k] + begin, end - begin);
      if (k > 0 && !(own.most - own.least > range->most - range->least)) continue;
      axis = k;
      *range = own;
    }
    return axis;
  }

  // Where `first` of the coordinates lie before the others; anywhere once the token has fired.
  Parting Select(const float* row, size_t count, size_t first, Range range) {
    // Where points are spread evenly the first guess is nearly right. After some more, halving what
    // coordinates there are in the range ends it.
    constexpr int kGuesses = 8;
    size_t below = 0, within = count;  // The range, and within it.
    for (int pass = 0; within > kFewCoordinates && range.least < range.most; ++pass) {
      const bool guess = pass < kGuesses;
      float pivot;
      if (guess) {
        const double share = static_cast<double>(first - below) / static_cast<double>(within);
        const double least = range.least, most = range.most;
        pivot = static_cast<float>(least + (most - least) * share);
      } else {
        pivot = FromOrdered(static_cast<int32_t>(
            (int64_t{ToOrdered(range.least)} + ToOrdered(range.most) + 1) >> 1));
      }
      pivot = std::clamp(pivot, Above(range.least), range.most);
      if (poll_.Stops(count)) return {pivot, 0};
      const size_t less = CountBelow(row, count, pivot);
      if (less == first) return {pivot, 0};
      const Range ends = guess ? Range{pivot, Below(pivot)} : EndsAt(row, count, pivot);
      if (less > first) {
        within = less - below;
        range.most = ends.most;
      } else {
        within -= less - below;
        below = less;
        range.least = ends.least;
      }
    }
    if (range.least == range.most) {
      return below + within == first ? Parting{Above(range.least), 0}
                                     : Parting{range.least, first - below};
    }
    alignas(64) float few[kFewCoordinates + kLanes];
    Few(row, count, range, few);
    return Rank(few, within, below, first);
  }

  static HWY_INLINE size_t CountBelow(const float* row, size_t count, float pivot) {
    const D d;
    const V at = hn::Set(d, pivot);
    size_t less = 0, i = 0;
    for (; i + kLanes <= count; i += kLanes) {
      less += hn::CountTrue(d, hn::Lt(hn::LoadU(d, row + i), at));
    }
    if (i < count) {  // Rows have a vector more than points.
      const M below = hn::Lt(hn::LoadU(d, row + i), at);
      less += hn::CountTrue(d, hn::And(hn::FirstN(d, count - i), below));
    }
    return less;
  }

  // The greatest coordinate below the pivot, and the least of the others.
  static HWY_NOINLINE Range EndsAt(const float* row, size_t count, float pivot) {
    const D d;
    const V at = hn::Set(d, pivot);
    V most = hn::Set(d, -std::numeric_limits<float>::infinity()), least = hn::Neg(most);
    for (size_t i = 0; i < count; i += kLanes) {
      const V v = hn::LoadU(d, row + i);
      const M there = hn::FirstN(d, count - i), below = hn::And(there, hn::Lt(v, at));
      most = hn::IfThenElse(below, hn::Max(most, v), most);
      least = hn::IfThenElse(hn::AndNot(below, there), hn::Min(least, v), least);
    }
    return {hn::GetLane(hn::MinOfLanes(d, least)), hn::GetLane(hn::MaxOfLanes(d, most))};
  }

  // The coordinates in the range.
  static HWY_INLINE void Few(const float* row, size_t count, Range range, float* few) {
    const D d;
    const V least = hn::Set(d, range.least), most = hn::Set(d, range.most);
    for (size_t i = 0; i < count; i += kLanes) {
      const V v = hn::LoadU(d, row + i);
      const M in = hn::AndNot(hn::Or(hn::Lt(v, least), hn::Gt(v, most)), hn::FirstN(d, count - i));
      hn::StoreU(CompressLanes(d, v, in), d, few);
      few += hn::CountTrue(d, in);
    }
  }

  // As Select, of few coordinates, with `below` others before them.
  static HWY_INLINE Parting Rank(float* few, size_t count, size_t below, size_t first) {
    const D d;
    constexpr size_t kVectors = kFewCoordinates / kLanes;
    // Behind all others.
    const V none = hn::Set(d, std::numeric_limits<float>::infinity());
    for (size_t i = count; i < kFewCoordinates; i += kLanes) hn::StoreU(none, d, few + i);
    V own[kVectors], ranks[kVectors];
    for (size_t k = 0; k < kVectors; ++k) {
      own[k] = hn::Load(d, few + k * kLanes);
      ranks[k] = hn::Zero(d);
    }
    const V one = hn::Set(d, 1);
    for (size_t i = 0; i < kFewCoordinates; ++i) {
      const V other = hn::Set(d, few[i]);
      for (size_t k = 0; k < kVectors; ++k) {
        ranks[k] = hn::IfThenElse(hn::Lt(other, own[k]), hn::Add(ranks[k], one), ranks[k]);
      }
    }
    // The greatest one that fewer than `first` are less than.
    const V most = hn::Set(d, static_cast<float>(first - below));
    V at = hn::Neg(none);
    for (size_t k = 0; k < kVectors; ++k) {
      at = hn::IfThenElse(hn::Lt(ranks[k], most), hn::Max(at, own[k]), at);
    }
    at = hn::MaxOfLanes(d, at);
    size_t less = below, equal = 0;
    for (const V& some : own) {
      less += hn::CountTrue(d, hn::Lt(some, at));
      equal += hn::CountTrue(d, hn::Eq(some, at));
    }
    const float limit = hn::GetLane(at);
    return less + equal == first ? Parting{Above(limit), 0} : Parting{limit, first - less};
  }

  // Moves points that stay(coordinate) to the front, of which there are as many as before `middle`,
  // and the others to the other side. Vectors are stored whole, next to the ones before: what else
  // they hold is overwritten by what follows, and was read already.
  template <class Stay>
  HWY_INLINE void Move(size_t begin, size_t end, size_t middle, size_t side, const float* row,
                       const Stay& stay) {
    const D d;
    float *front[kRows], *behind[kRows];
    for (size_t k = 0; k < kRows; ++k) {
      front[k] = rows_[side][k];
      behind[k] = rows_[1 - side][k];
    }
    size_t stayed = begin, gone = middle;
    for (size_t i = begin; i < end; i += kLanes) {
      M stays = stay(hn::LoadU(d, row + (i - begin)));
      if (i + kLanes > end) stays = hn::And(stays, hn::FirstN(d, end - i));
      const M goes = hn::Not(stays);  // Behind the end it does not matter.
      for (size_t k = 0; k < kRows; ++k) {
        const V v = hn::LoadU(d, front[k] + i);
        hn::StoreU(CompressLanes(d, v, stays), d, front[k] + stayed);
        hn::StoreU(CompressLanes(d, v, goes), d, behind[k] + gone);
      }
      const size_t count = hn::CountTrue(d, stays);
      stayed += count;
      gone += kLanes - count;
    }
  }

  // The same where some of the points at the limit stay, and some do not.
  HWY_NOINLINE void MoveSome(size_t begin, size_t end, size_t middle, size_t side, const float* row,
                             const Parting& parting) {
    const D d;
    const V limit = hn::Set(d, parting.limit);
    size_t left = parting.at_limit;
    Move(begin, end, middle, side, row, [&](V v) HWY_ATTR {
      return hn::Or(hn::Lt(v, limit), FirstOf(d, hn::Eq(v, limit), &left));
    });
  }

  static constexpr size_t kNumber = 3, kRows = 4;  // Coordinates by axis, and numbers.

  const std::span<const Vec3f> positions_;
  const CancelToken* const cancel_;
  bool filled_ = false;          // Whether all points were taken up.
  WorkPoll<kPolledBlock> poll_;  // Its work is points that are passed over.
  const size_t room_;            // Of each row: a vector is read whole, wherever it begins.
  AlignedVector<float> all_;
  float* rows_[2][kRows];  // On two sides: points stay on theirs, or go to the other.
  PartedPoints& parted_;
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
