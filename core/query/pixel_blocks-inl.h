// SPDX-License-Identifier: Apache-2.0
//
// pixel_blocks.h, a vector at a time.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_QUERY_PIXEL_BLOCKS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_QUERY_PIXEL_BLOCKS_INL_H_
#undef SIGHTLINE_CORE_QUERY_PIXEL_BLOCKS_INL_H_
#else
#define SIGHTLINE_CORE_QUERY_PIXEL_BLOCKS_INL_H_
#endif

#include <cstddef>
#include <cstdint>

#include "core/query/pixel_blocks.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr uint32_t kPixelRun = PixelBlockKernels::kRun;
constexpr uint32_t kPixelSide = PixelBlockKernels::kSide;

// A vector of D holds one run, or two runs below each other.
template <class D>
HWY_INLINE void LayOutBy(D d, const double* columns, const double* rows, float* lanes) {
  const hn::CappedTag<double, kPixelRun> run;
  const hn::Rebind<float, decltype(d)> floats;
  constexpr uint32_t kRuns = hn::MaxLanes(d) / kPixelRun;
  constexpr uint32_t kSquare = kPixelRun * kPixelRun;
  hn::Vec<decltype(d)> row[kPixelSide / kRuns];
  for (uint32_t y = 0; y < kPixelSide; y += kRuns) {
    if constexpr (kRuns == 1) {
      row[y] = hn::Set(d, rows[y]);
    } else {
      row[y / kRuns] = hn::Combine(d, hn::Set(run, rows[y + 1]), hn::Set(run, rows[y]));
    }
  }
  for (uint32_t x = 0; x < kPixelSide; x += kPixelRun) {
    hn::Vec<decltype(d)> column;
    if constexpr (kRuns == 1) {
      column = hn::LoadU(d, columns + x);
    } else {
      const auto part = hn::LoadU(run, columns + x);
      column = hn::Combine(d, part, part);
    }
    float* square = lanes + x / kPixelRun * kSquare;
#pragma GCC unroll 16
    for (uint32_t y = 0; y < kPixelSide; y += kRuns) {
      hn::Store(hn::DemoteTo(floats, hn::Add(column, row[y / kRuns])), floats,
                square + y / kPixelRun * (kPixelSide * kPixelRun) + y % kPixelRun * kPixelRun);
    }
  }
}

inline void LayOutPixels(const double* columns, const double* rows, float* lanes) {
  LayOutBy(hn::CappedTag<double, 2 * kPixelRun>(), columns, rows, lanes);
}

template <bool kPastCaches, class T>
HWY_INLINE void WritePixels(const T* lanes, T* to, size_t stride) {
  const hn::CappedTag<T, kPixelRun> run;
  const hn::CappedTag<T, 2 * kPixelRun> half;
  constexpr uint32_t kSquare = kPixelRun * kPixelRun;
  const auto store = [](const auto& v, const auto& d, T* at) HWY_ATTR {
    if constexpr (kPastCaches) {
      hn::Stream(v, d, at);
    } else {
      hn::StoreU(v, d, at);
    }
  };
  for (uint32_t y = 0; y < kPixelSide; ++y, to += stride) {
    const T* from = lanes + y / kPixelRun * (kPixelSide * kPixelRun) + y % kPixelRun * kPixelRun;
    const auto left = hn::Combine(half, hn::Load(run, from + kSquare), hn::Load(run, from));
    const auto right =
        hn::Combine(half, hn::Load(run, from + 3 * kSquare), hn::Load(run, from + 2 * kSquare));
    const hn::CappedTag<T, kPixelSide> whole;
    if constexpr (hn::MaxLanes(whole) == kPixelSide) {
      store(hn::Combine(whole, right, left), whole, to);
    } else {
      store(left, half, to);
      store(right, half, to + 2 * kPixelRun);
    }
  }
}

inline void WriteFloats(const float* lanes, float* to, size_t stride) {
  WritePixels<false>(lanes, to, stride);
}
inline void WriteIds(const uint32_t* lanes, uint32_t* to, size_t stride) {
  WritePixels<false>(lanes, to, stride);
}
inline void StreamFloats(const float* lanes, float* to, size_t stride) {
  WritePixels<true>(lanes, to, stride);
}
inline void StreamIds(const uint32_t* lanes, uint32_t* to, size_t stride) {
  WritePixels<true>(lanes, to, stride);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
