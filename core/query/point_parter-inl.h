// SPDX-License-Identifier: Apache-2.0
//
// point_parter.h, a vector at a time. The key that parts some points is found by counting how many
// lie below a guess, which moves nothing; then each point is moved once, without a branch.
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
#include "core/base/compress-inl.h"
#include "core/geometry/vec3.h"
#include "core/intersect/predicate-inl.h"
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
              PartedPoints* parted)
      : room_((positions.size() + kSmallestPart + kLanes) / kLanes * kLanes), parted_(*parted) {
    keys_.ResizeUninitialized(2 * kRows * room_);
    for (size_t side = 0; side < 2; ++side) {
      for (size_t k = 0; k < kRows; ++k) rows_[side][k] = keys_.data() + (side * kRows + k) * room_;
    }
    const size_t count = Fill(positions, valid);
    parted->numbers.ResizeUninitialized(count + kSmallestPart);
    parted->positions.ResizeUninitialized(count + kSmallestPart);
    Part(0, count, 0);
    parted->numbers.ResizeUninitialized(count);
    parted->positions.ResizeUninitialized(count);
  }

 private:
  using D = hn::CappedTag<int32_t, 16>;
  using V = hn::Vec<D>;
  using M = hn::Mask<D>;
  static constexpr size_t kLanes = hn::MaxLanes(D());
  static constexpr size_t kNumber = 3, kRows = 4;  // Keys by axis, and numbers.
  // So many keys are ranked by comparing each with all.
  static constexpr size_t kFewKeys = 32;

  // The bits of a float, ordered as floats are: keys are whole numbers, of which there is a next.
  static int32_t Ordered(int32_t bits) { return bits ^ ((bits >> 31) & 0x7fffffff); }
  static int32_t ToKey(float x) { return Ordered(std::bit_cast<int32_t>(x)); }
  static float FromKey(int32_t key) { return std::bit_cast<float>(Ordered(key)); }
  static HWY_INLINE V Ordered(V bits) {
    const D d;
    return hn::Xor(bits, hn::And(hn::BroadcastSignBit(bits), hn::Set(d, 0x7fffffff)));
  }

  // All keys of some points lie in it.
  struct Range {
    int32_t least, most;
  };
  // Where points part: those below `key` come first, and so many of those at it.
  struct Parting {
    int32_t key;
    size_t at_key;
    bool all_at_key;  // There are no more.
  };

  // Returns how many are valid.
  size_t Fill(std::span<const Vec3f> positions, std::span<const uint8_t> valid) {
    const D d;
    int32_t* const* rows = rows_[0];
    size_t count = 0;
    if (!valid.empty() && std::memchr(valid.data(), 0, valid.size()) == nullptr) {
      count = positions.size();
      const auto row = [&](size_t k) { return reinterpret_cast<float*>(rows[k]); };
      SplitPoints(positions, row(0), row(1), row(2));
      for (size_t i = 0; i < count; i += kLanes) {
        hn::Store(hn::Iota(d, static_cast<int32_t>(i)), d, rows[kNumber] + i);
      }
    } else {
      for (size_t i = 0; i < positions.size(); ++i) {
        for (int k = 0; k < 3; ++k) rows[k][count] = std::bit_cast<int32_t>(positions[i][k]);
        rows[kNumber][count] = static_cast<int32_t>(i);
        count += valid[i] != 0;
      }
    }
    for (size_t k = 0; k < 3; ++k) {
      for (size_t i = 0; i < count; i += kLanes) {
        hn::Store(Ordered(hn::Load(d, rows[k] + i)), d, rows[k] + i);
      }
    }
    return count;
  }

  // Points begin .. end - 1 of rows_[side], whose place on the other side is free.
  void Part(size_t begin, size_t end, size_t side) {
    while (end - begin > kSmallestPart) {
      size_t first = kSmallestPart;
      while (2 * first < end - begin) first *= 2;
      Range range;
      const int32_t* const keys = rows_[side][WidestAxis(begin, end, side, &range)] + begin;
      const Parting parting = Select(keys, end - begin, first, range);
      if (parting.all_at_key) {
        Move(begin, end, begin + first, side, keys,
             [&](V key) HWY_ATTR { return hn::Not(hn::Gt(key, At(parting))); });
      } else {
        MoveSome(begin, end, begin + first, side, keys, parting);
      }
      // What is stored past its end lies in the place of points that are done with.
      Part(begin + first, end, 1 - side);
      end = begin + first;
    }
    Emit(begin, side);
  }

  // The last place of a smallest part.
  HWY_INLINE void Emit(size_t begin, size_t side) {
    const D d;
    const hn::RebindToFloat<D> df;
    for (size_t i = begin; i < begin + kSmallestPart; i += kLanes) {
      const auto at = [&](size_t k) HWY_ATTR {
        return hn::BitCast(df, Ordered(hn::LoadU(d, rows_[side][k] + i)));
      };
      const auto x = at(0), y = at(1), z = at(2);
      hn::StoreInterleaved3(x, y, z, df, &parted_.positions[i].x);
      hn::StoreU(hn::LoadU(d, rows_[side][kNumber] + i), d,
                 reinterpret_cast<int32_t*>(&parted_.numbers[i]));
    }
  }

  static HWY_INLINE V At(const Parting& parting) { return hn::Set(D(), parting.key); }

  // The widest axis of some points, more than one vector of them, and their keys along it.
  size_t WidestAxis(size_t begin, size_t end, size_t side, Range* range) const {
    const D d;
    int32_t least[3], most[3];
    for (size_t k = 0; k < 3; ++k) {
      const int32_t* const from = rows_[side][k];
      V lo = hn::LoadU(d, from + end - kLanes), hi = lo;
      for (size_t i = begin; i + kLanes < end; i += kLanes) {
        const V v = hn::LoadU(d, from + i);
        lo = hn::Min(lo, v);
        hi = hn::Max(hi, v);
      }
      least[k] = hn::GetLane(hn::MinOfLanes(d, lo));
      most[k] = hn::GetLane(hn::MaxOfLanes(d, hi));
    }
    const auto extent = [&](size_t k) { return FromKey(most[k]) - FromKey(least[k]); };
    size_t axis = extent(1) > extent(0) ? 1 : 0;
    if (extent(2) > extent(axis)) axis = 2;
    *range = {least[axis], most[axis]};
    return axis;
  }

  // Where `first` of the keys lie before the others.
  static Parting Select(const int32_t* keys, size_t count, size_t first, Range range) {
    // Where points are spread evenly the first guess is nearly right. After some more, halving what
    // keys there are in the range ends it.
    constexpr int kGuesses = 8;
    size_t below = 0, within = count;  // The range, and within it.
    for (int pass = 0; within > kFewKeys && range.least < range.most; ++pass) {
      int32_t pivot = static_cast<int32_t>((int64_t{range.least} + range.most + 1) >> 1);
      if (pass < kGuesses) {
        const double share = static_cast<double>(first - below) / static_cast<double>(within);
        const double least = FromKey(range.least), most = FromKey(range.most);
        pivot = std::clamp(ToKey(static_cast<float>(least + (most - least) * share)),
                           range.least + 1, range.most);
      }
      Range next = range;  // Its ends become those of keys that there are.
      const size_t less = CountBelow(keys, count, pivot, &next);
      if (less == first) return {next.most, 0, true};
      if (less > first) {
        within = less - below;
        range.most = next.most;
      } else {
        within -= less - below;
        below = less;
        range.least = next.least;
      }
    }
    if (range.least == range.most) {
      return {range.least, first - below, below + within == first};
    }
    alignas(64) int32_t few[kFewKeys + kLanes];
    Few(keys, count, range, few);
    return Rank(few, within, below, first);
  }

  // How many are below the pivot. *next gets the largest of these, and the least of the others.
  static HWY_INLINE size_t CountBelow(const int32_t* keys, size_t count, int32_t pivot,
                                      Range* next) {
    const D d;
    const V at = hn::Set(d, pivot), one = hn::Set(d, 1);
    V less = hn::Zero(d);
    V most = hn::Set(d, std::numeric_limits<int32_t>::min());
    V least = hn::Set(d, std::numeric_limits<int32_t>::max());
    const auto look = [&](V v, M below, M others) HWY_ATTR {
      less = hn::IfThenElse(below, hn::Add(less, one), less);
      most = hn::IfThenElse(below, hn::Max(most, v), most);
      least = hn::IfThenElse(others, hn::Min(least, v), least);
    };
    size_t i = 0;
    for (; i + kLanes <= count; i += kLanes) {
      const V v = hn::LoadU(d, keys + i);
      const M below = hn::Lt(v, at);
      look(v, below, hn::Not(below));
    }
    if (i < count) {
      const V v = hn::LoadU(d, keys + i);  // Rows have a vector more than keys.
      const M there = hn::FirstN(d, count - i), below = hn::And(there, hn::Lt(v, at));
      look(v, below, hn::AndNot(below, there));
    }
    *next = {hn::GetLane(hn::MinOfLanes(d, least)), hn::GetLane(hn::MaxOfLanes(d, most))};
    return static_cast<size_t>(hn::GetLane(hn::SumOfLanes(d, less)));
  }

  // The keys in the range.
  static HWY_INLINE void Few(const int32_t* keys, size_t count, Range range, int32_t* few) {
    const D d;
    const V least = hn::Set(d, range.least), most = hn::Set(d, range.most);
    for (size_t i = 0; i < count; i += kLanes) {
      const V v = hn::LoadU(d, keys + i);
      const M in = hn::AndNot(hn::Or(hn::Lt(v, least), hn::Gt(v, most)), hn::FirstN(d, count - i));
      hn::StoreU(CompressLanes(d, v, in), d, few);
      few += hn::CountTrue(d, in);
    }
  }

  // As Select, of few keys, with `below` others before them.
  static HWY_INLINE Parting Rank(int32_t* few, size_t count, size_t below, size_t first) {
    const D d;
    constexpr size_t kVectors = kFewKeys / kLanes;
    // Behind all others, and no key: finite floats end below it.
    const V none = hn::Set(d, std::numeric_limits<int32_t>::max());
    for (size_t i = count; i < kFewKeys; i += kLanes) hn::StoreU(none, d, few + i);
    V keys[kVectors], ranks[kVectors];
    for (size_t k = 0; k < kVectors; ++k) {
      keys[k] = hn::Load(d, few + k * kLanes);
      ranks[k] = hn::Zero(d);
    }
    const V one = hn::Set(d, 1);
    for (size_t i = 0; i < kFewKeys; ++i) {
      const V own = hn::Set(d, few[i]);
      for (size_t k = 0; k < kVectors; ++k) {
        ranks[k] = hn::IfThenElse(hn::Lt(own, keys[k]), hn::Add(ranks[k], one), ranks[k]);
      }
    }
    // The largest key that fewer than `first` are less than.
    const V most = hn::Set(d, static_cast<int32_t>(first - below));
    V at = hn::Set(d, std::numeric_limits<int32_t>::min());
    for (size_t k = 0; k < kVectors; ++k) {
      at = hn::IfThenElse(hn::Lt(ranks[k], most), hn::Max(at, keys[k]), at);
    }
    at = hn::MaxOfLanes(d, at);
    size_t less = below, equal = 0;
    for (size_t k = 0; k < kVectors; ++k) {
      less += hn::CountTrue(d, hn::Lt(keys[k], at));
      equal += hn::CountTrue(d, hn::Eq(keys[k], at));
    }
    return {hn::GetLane(at), first - less, less + equal == first};
  }

  // Moves points that stay(key) to the front, of which there are as many as before `middle`, and
  // the others to the other side. Vectors are stored whole, next to the ones before: what else they
  // hold is overwritten by what follows, and was read already.
  template <class Stay>
  HWY_INLINE void Move(size_t begin, size_t end, size_t middle, size_t side, const int32_t* keys,
                       const Stay& stay) {
    const D d;
    int32_t *front[kRows], *behind[kRows];
    for (size_t k = 0; k < kRows; ++k) {
      front[k] = rows_[side][k];
      behind[k] = rows_[1 - side][k];
    }
    size_t stayed = begin, gone = middle;
    for (size_t i = begin; i < end; i += kLanes) {
      M stays = stay(hn::LoadU(d, keys + (i - begin)));
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

  // The same where some of the points at the key stay, and some do not.
  HWY_NOINLINE void MoveSome(size_t begin, size_t end, size_t middle, size_t side,
                             const int32_t* keys, const Parting& parting) {
    const D d;
    size_t left = parting.at_key;
    Move(begin, end, middle, side, keys, [&](V key) HWY_ATTR {
      const M less = hn::Lt(key, At(parting));
      uint32_t equal = MaskBits(d, hn::Eq(key, At(parting)));
      uint32_t chosen = 0;
      for (; equal != 0 && left > 0; equal &= equal - 1, --left) chosen |= equal & (0u - equal);
      const uint8_t bits[8] = {static_cast<uint8_t>(chosen), static_cast<uint8_t>(chosen >> 8)};
      return hn::Or(less, hn::LoadMaskBits(d, bits));
    });
  }

  const size_t room_;  // Of each row: a smallest part is read whole, wherever it begins.
  AlignedVector<int32_t> keys_;
  int32_t* rows_[2][kRows];  // On two sides: points stay on theirs, or go to the other.
  PartedPoints& parted_;
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
