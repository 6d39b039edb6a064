// SPDX-License-Identifier: Apache-2.0
//
// Some lanes of a vector, stored.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_BASE_MASKED_STORE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_BASE_MASKED_STORE_INL_H_
#undef SIGHTLINE_CORE_BASE_MASKED_STORE_INL_H_
#else
#define SIGHTLINE_CORE_BASE_MASKED_STORE_INL_H_
#endif

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Stores the lanes of `chosen`; the others stay what they are. REQUIRES: `row` is aligned as a
// vector.
template <class D, class V = hn::Vec<D>, class M>
HWY_INLINE void StoreWhere(M chosen, V v, D d, hn::TFromD<D>* row) {
  // AVX2's masked stores are microcode on AMD's cores: a fifth of a walk.
  if constexpr (HWY_TARGET == HWY_AVX2) {
    hn::Store(hn::IfThenElse(chosen, v, hn::Load(d, row)), d, row);
  } else {
    hn::BlendedStore(v, chosen, d, row);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
