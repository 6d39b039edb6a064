// SPDX-License-Identifier: Apache-2.0
//
// One value along a row of lanes, a vector at a time. Kernels are compiled without the compiler's
// vectorizer (-ffp-contract=off does not hold there), so that std::fill_n writes them one by one.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_BASE_FILL_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_BASE_FILL_INL_H_
#undef SIGHTLINE_CORE_BASE_FILL_INL_H_
#else
#define SIGHTLINE_CORE_BASE_FILL_INL_H_
#endif

#include <cstddef>

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// The first `count` lanes of a row, and what is left of the last vector. REQUIRES: `row` is aligned
// to 64 bytes and holds whole vectors.
template <class T>
HWY_INLINE void FillRow(T* row, size_t count, T value) {
  const hn::CappedTag<T, 64 / sizeof(T)> d;
  for (size_t i = 0; i < count; i += hn::Lanes(d)) hn::Store(hn::Set(d, value), d, row + i);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
