// SPDX-License-Identifier: Apache-2.0
//
// Exact sums of doubles: Shewchuk's grow-expansion with zero elimination (Adaptive Precision
// Floating-Point Arithmetic and Fast Robust Geometric Predicates, 1997, sections 2.3 and 2.4). The
// sum is held as a nonoverlapping expansion of increasing magnitude, so its sign is that of its
// last component.
//
// Exact as long as no addition overflows and no product passed to AddProduct underflows. Products
// of three stored floats are safe: their bits lie between 2^-447 and 2^124, and doubles reach from
// 2^-1074 to 2^1023. REQUIRES: round to nearest (engine threads run so; see
// core/base/float_environment.h).
//
// Thread safety: plain values.
//
//   ExactSum<8> sum;
//   sum.Add(1e30); sum.Add(1.0); sum.Add(-1e30);
//   sum.sign();  // +1
#ifndef SIGHTLINE_CORE_GEOMETRY_EXACT_SUM_H_
#define SIGHTLINE_CORE_GEOMETRY_EXACT_SUM_H_

#include <cmath>
#include <span>

#include "core/base/check.h"

namespace sightline {

// Holds sums of up to `kCapacity` added doubles (AddProduct counts as two).
template <int kCapacity>
class ExactSum {
 public:
  void Add(double x) {
    double carry = x;
    int kept = 0;
    for (int i = 0; i < size_; ++i) {
      // TwoSum (Knuth): high + low == carry + component, exactly.
      const double c = component_[i];
      const double high = carry + c;
      const double c_virtual = high - carry;
      const double low = (carry - (high - c_virtual)) + (c - c_virtual);
      if (low != 0) component_[kept++] = low;
      carry = high;
    }
    if (carry != 0) {
      SIGHTLINE_DCHECK(kept < kCapacity);
      component_[kept++] = carry;
    }
    size_ = kept;
  }

  // Adds a·b. Exact: the product's rounding error is a double (TwoProduct by fused multiply-add).
  void AddProduct(double a, double b) {
    const double high = a * b;
    const double low = std::fma(a, b, -high);
    if (low != 0) Add(low);
    if (high != 0) Add(high);
  }

  // -1, 0 or +1.
  int sign() const {
    if (size_ == 0) return 0;
    return component_[size_ - 1] > 0 ? 1 : -1;
  }

 private:
  double component_[kCapacity];
  int size_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_GEOMETRY_EXACT_SUM_H_
