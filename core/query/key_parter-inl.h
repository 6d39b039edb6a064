// SPDX-License-Identifier: Apache-2.0
//
// Parts up to 256 points as point_parter.h says, which is where most parting is done: by keys of a
// byte for each axis, which share a lane with the point's number. So points are moved by one
// vector, not four, and their extents along all axes are found at once.
//
// Thread safety: a plain value.

#if defined(SIGHTLINE_CORE_QUERY_KEY_PARTER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_QUERY_KEY_PARTER_INL_H_
#undef SIGHTLINE_CORE_QUERY_KEY_PARTER_INL_H_
#else
#define SIGHTLINE_CORE_QUERY_KEY_PARTER_INL_H_
#endif

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/base/compress-inl.h"
#include "core/intersect/predicate-inl.h"
#include "core/query/point_parter.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Of some lanes the first *left, which become as many fewer.
template <class D, class M>
HWY_INLINE M FirstOf(D d, M lanes, size_t* left) {
  uint32_t bits = MaskBits(d, lanes), first = 0;
  for (; bits != 0 && *left > 0; bits &= bits - 1, --*left) first |= bits & (0u - bits);
  const uint8_t bytes[8] = {static_cast<uint8_t>(first), static_cast<uint8_t>(first >> 8)};
  return hn::LoadMaskBits(d, bytes);
}

// Keys are whole numbers of a 255th of the points' widest extent, far less than a block of sixteen
// of them is wide.
class KeyParter {
 public:
  static constexpr size_t kMaxPoints = 256;  // Numbered by a byte.

  // Points as rows of coordinates by axis, none of them below `least`. put(at, i): point i has
  // place `at`.
  template <class Put>
  HWY_INLINE KeyParter(const float* const* rows, size_t count, const float* least, float widest,
                       const Put& put) {
    const D d;
    const hn::RebindToFloat<D> df;
    constexpr float kMostKey = 255;
    const bool wide = widest > kMostKey * std::numeric_limits<float>::min();
    const auto scale = hn::Set(df, wide ? kMostKey / widest : 0);
    // What is added to it stands as a whole number in the lowest bits.
    const auto whole = hn::Set(df, 0x1p23f);
    auto number = hn::ShiftLeft<kNumberShift>(hn::Iota(d, 0));
    for (size_t i = 0; i < count; i += kLanes) {
      const auto key = [&](size_t k) HWY_ATTR {
        const auto x = hn::Sub(hn::LoadU(df, rows[k] + i), hn::Set(df, least[k]));
        return hn::And(hn::BitCast(d, hn::MulAdd(x, scale, whole)), hn::Set(d, kByte));
      };
      const V low = hn::Or(key(0), hn::ShiftLeft<kYShift>(key(1)));
      const V high = hn::Or(hn::ShiftLeft<kZShift>(key(2)), number);
      hn::Store(hn::Or(low, high), d, keys_[0] + i);
      number = hn::Add(number, hn::Set(d, uint32_t{kLanes} << kNumberShift));
    }
    Part(0, count, 0, put);
  }

 private:
  using D = hn::CappedTag<uint32_t, 16>;
  using V = hn::Vec<D>;
  using M = hn::Mask<D>;
  static constexpr size_t kLanes = hn::MaxLanes(D());
  static constexpr uint32_t kByte = 255;
  // Where a lane has the keys along y and z, and the point's number.
  static constexpr int kYShift = 8, kZShift = 16, kNumberShift = 24;

  struct Range {
    uint32_t least, most;
  };
  struct Parting {  // As PointParter's.
    uint32_t limit;
    size_t at_limit;
  };

  // Keys begin .. end - 1 of keys_[side], whose place on the other side is free.
  template <class Put>
  void Part(size_t begin, size_t end, size_t side, const Put& put) {
    while (end - begin > kSmallestPart) {
      const size_t first = FirstPart(end - begin);
      Range range;
      const int shift = WidestAxis(keys_[side] + begin, end - begin, &range);
      if (end - begin == kTwoParts) {
        PartTwo(keys_[side] + begin, shift);
        for (size_t i = 0; i < kTwoParts; ++i) put(begin + i, keys_[side][begin + i] & kByte);
        return;
      }
      Move(begin, end, begin + first, side, shift,
           Select(keys_[side] + begin, end - begin, first, shift, range));
      Part(begin + first, end, 1 - side, put);
      end = begin + first;
    }
    for (size_t i = begin; i < end; ++i) put(i, keys_[side][i] >> kNumberShift);
  }

  static constexpr size_t kTwoParts = 2 * kSmallestPart;

  // Of two smallest parts together: their keys along the axis, with the points' numbers, which are
  // left in the lowest bytes, are sorted. No branch depends on them.
  static HWY_INLINE void PartTwo(uint32_t* keys, int shift) {
    const D d;
    constexpr size_t kVectors = kSmallestPart / kLanes;  // Of a part.
    V part[2][kVectors];
    for (size_t i = 0; i < 2 * kVectors; ++i) {
      const V own = hn::LoadU(d, keys + i * kLanes);
      part[i / kVectors][i % kVectors] =
          hn::Or(hn::ShiftLeft<8>(Along(shift, own)), hn::ShiftRight<kNumberShift>(own));
    }
    for (auto& run : part) SortPart(run);
    for (size_t i = 0; i < kVectors; ++i) {
      const V a = part[0][i], b = hn::Reverse(d, part[1][kVectors - 1 - i]);
      hn::StoreU(hn::Min(a, b), d, keys + i * kLanes);
      hn::StoreU(hn::Max(a, b), d, keys + kSmallestPart + i * kLanes);
    }
  }

  // By a bitonic network (K. Batcher, 1968): two sorted runs, one turned around, are exchanged lane
  // by lane, and each half by itself over half its length, a quarter and so on.
  static HWY_INLINE void SortPart(V (&keys)[kSmallestPart / kLanes]) {
    const D d;
    for (V& v : keys) {
      v = Exchange<1>(v, hn::Reverse2(d, v));
      v = Exchange<2>(v, hn::Reverse4(d, v));
      v = Exchange<1>(v, hn::Reverse2(d, v));
      v = Exchange<4>(v, hn::Reverse8(d, v));
      v = Exchange<2>(v, hn::Shuffle1032(v));
      v = Exchange<1>(v, hn::Reverse2(d, v));
    }
    if constexpr (kLanes == 16) {
      keys[0] = Exchange<8>(keys[0], hn::Reverse(d, keys[0]));
    } else {
      const V a = keys[0], b = hn::Reverse(d, keys[1]);
      keys[0] = hn::Min(a, b);
      keys[1] = hn::Max(a, b);
    }
    for (V& v : keys) {
      v = Exchange<4>(v, hn::SwapAdjacentBlocks(v));
      v = Exchange<2>(v, hn::Shuffle1032(v));
      v = Exchange<1>(v, hn::Reverse2(d, v));
    }
  }
  // Lanes whose number has the bit keep the greater of the two, the others the lesser.
  template <size_t kBit>
  static HWY_INLINE V Exchange(V own, V other) {
    const D d;
    const hn::RebindToSigned<D> di;
    alignas(64) static constexpr std::array<int32_t, 16> kGreater = [] {
      std::array<int32_t, 16> lanes = {};
      for (size_t i = 0; i < lanes.size(); ++i) lanes[i] = (i & kBit) != 0 ? -1 : 0;
      return lanes;
    }();
    const auto greater = hn::MaskFromVec(hn::BitCast(d, hn::Load(di, kGreater.data())));
    return hn::IfThenElse(greater, hn::Max(own, other), hn::Min(own, other));
  }

  static HWY_INLINE V Along(int shift, V keys) {
    return hn::And(hn::ShiftRightSame(keys, shift), hn::Set(D(), kByte));
  }

  // How far its keys are to be shifted, and their range.
  static HWY_INLINE int WidestAxis(const uint32_t* keys, size_t count, Range* range) {
    const D d;
    const hn::Repartition<uint8_t, D> bytes;
    const auto load = [&](size_t i) HWY_ATTR { return hn::BitCast(bytes, hn::LoadU(d, keys + i)); };
    auto lo = load(count - kLanes), hi = lo;
    for (size_t i = 0; i + kLanes < count; i += kLanes) {
      const auto v = load(i);
      lo = hn::Min(lo, v);
      hi = hn::Max(hi, v);
    }
    const auto fold = [&](auto all, const auto& take) HWY_ATTR {
      const auto with = [&](V other) HWY_ATTR { all = take(all, hn::BitCast(bytes, other)); };
      const auto lanes = [&]() HWY_ATTR { return hn::BitCast(d, all); };
      if constexpr (kLanes == 16) with(hn::ConcatLowerUpper(d, lanes(), lanes()));
      with(hn::SwapAdjacentBlocks(lanes()));
      with(hn::Shuffle1032(lanes()));
      with(hn::Reverse2(d, lanes()));
      return hn::GetLane(lanes());
    };
    const uint32_t least = fold(lo, [](auto a, auto b) HWY_ATTR { return hn::Min(a, b); });
    const uint32_t most = fold(hi, [](auto a, auto b) HWY_ATTR { return hn::Max(a, b); });
    int widest = 0;
    for (const int shift : {0, kYShift, kZShift}) {
      const Range own = {least >> shift & kByte, most >> shift & kByte};
      if (shift > 0 && own.most - own.least <= range->most - range->least) continue;
      widest = shift;
      *range = own;
    }
    return widest;
  }

  // As PointParter's.
  static HWY_INLINE Parting Select(const uint32_t* keys, size_t count, size_t first, int shift,
                                   Range range) {
    constexpr int kGuesses = 3;
    uint32_t below = 0, within = static_cast<uint32_t>(count);
    const auto wanted = static_cast<uint32_t>(first);
    for (int pass = 0; range.least < range.most; ++pass) {
      const uint32_t span = range.most - range.least;
      const uint32_t step = pass < kGuesses ? span * (wanted - below) / (within + 1) : span / 2;
      const uint32_t pivot = range.least + 1 + step;
      const uint32_t less = CountBelow(keys, count, shift, pivot);
      if (less == wanted) return {pivot, 0};
      // Without a branch: which way it goes cannot be foretold.
      const bool more = less > wanted;
      within = more ? less - below : within - (less - below);
      below = more ? below : less;
      range.most = more ? pivot - 1 : range.most;
      range.least = more ? range.least : pivot;
    }
    return {range.least, first - below};
  }

  static HWY_INLINE uint32_t CountBelow(const uint32_t* keys, size_t count, int shift,
                                        uint32_t pivot) {
    const D d;
    const V at = hn::Set(d, pivot);
    size_t less = 0, i = 0;
    for (; i + kLanes <= count; i += kLanes) {
      less += hn::CountTrue(d, hn::Lt(Along(shift, hn::LoadU(d, keys + i)), at));
    }
    if (i < count) {
      const M lt = hn::Lt(Along(shift, hn::LoadU(d, keys + i)), at);
      less += hn::CountTrue(d, hn::And(lt, hn::FirstN(d, count - i)));
    }
    return static_cast<uint32_t>(less);
  }

  // As PointParter's.
  HWY_INLINE void Move(size_t begin, size_t end, size_t middle, size_t side, int shift,
                       Parting parting) {
    const D d;
    uint32_t* const front = keys_[side];
    uint32_t* const behind = keys_[1 - side];
    const V limit = hn::Set(d, parting.limit);
    size_t stayed = begin, gone = middle, left = parting.at_limit;
    for (size_t i = begin; i < end; i += kLanes) {
      const V keys = hn::LoadU(d, front + i), own = Along(shift, keys);
      M stays = hn::Lt(own, limit);
      if (left > 0) stays = hn::Or(stays, FirstOf(d, hn::Eq(own, limit), &left));
      if (i + kLanes > end) stays = hn::And(stays, hn::FirstN(d, end - i));
      hn::StoreU(CompressLanes(d, keys, stays), d, front + stayed);
      hn::StoreU(CompressLanes(d, keys, hn::Not(stays)), d, behind + gone);
      const size_t count = hn::CountTrue(d, stays);
      stayed += count;
      gone += kLanes - count;
    }
  }

  // By lane the keys along x, y and z, from the lowest byte on, and the point's number; on two
  // sides. A vector is read and stored whole, wherever it begins.
  alignas(64) uint32_t keys_[2][kMaxPoints + kLanes];
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
