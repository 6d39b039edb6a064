// SPDX-License-Identifier: Apache-2.0
//
// ExactSum against GMP's integers: every double here is a multiple of 2^-1074, so a shifted sum is
// a whole number.
#include "core/geometry/exact_sum.h"

#include <gmpxx.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "gtest/gtest.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::ScaledCount;
using testing_support::TestRng;

// x · 2^1074, exactly.
mpz_class Shifted(double x) {
  int exponent;
  const double mantissa = std::frexp(x, &exponent);  // x = mantissa · 2^exponent
  mpz_class integer(std::ldexp(mantissa, 53));
  const int shift = exponent - 53 + 1074;
  return shift >= 0 ? mpz_class(integer << shift) : mpz_class(integer >> -shift);
}

template <int kTerms>
int SignOfSum(const std::vector<double>& terms) {
  ExactSum<kTerms> sum;
  for (const double x : terms) sum.Add(x);
  return sum.sign();
}

TEST(ExactSumTest, SmallCases) {
  EXPECT_EQ(ExactSum<1>().sign(), 0);
  EXPECT_EQ(SignOfSum<3>({1e30, 1.0, -1e30}), 1);
  EXPECT_EQ(SignOfSum<3>({1e30, -1.0, -1e30}), -1);
  EXPECT_EQ(SignOfSum<2>({0.1, -0.1}), 0);
  EXPECT_EQ(SignOfSum<2>({-0.0, 0.0}), 0);
  EXPECT_EQ(SignOfSum<4>({0.1, 0.2, -0.3, 0.0}), 1) << "0.1 + 0.2 > 0.3 as doubles";
  EXPECT_EQ(SignOfSum<3>({0x1p1000, 0x1p-1074, -0x1p1000}), 1);
}

TEST(ExactSumTest, SignsAgreeWithIntegersThroughCancellation) {
  TestRng rng;
  constexpr int kTerms = 48;
  for (int64_t i = ScaledCount(30'000); i > 0; --i) {
    const int n = 1 + static_cast<int>(rng.Below(kTerms / 2));
    std::vector<double> terms;
    terms.reserve(kTerms);
    const int spread = 1 + static_cast<int>(rng.Below(1000));
    for (int k = 0; k < n; ++k) {
      terms.push_back(
          std::ldexp(rng.Uniform(-1, 1), static_cast<int>(rng.Below(spread)) - spread / 2));
    }
    // Most of them once more with the other sign, some moved by an ulp.
    for (int k = 0; k < n; ++k) {
      if (rng.Chance(0.1)) continue;
      const double x = -terms[k];
      terms.push_back(rng.Chance(0.1) ? std::nextafter(x, 0.0) : x);
    }
    for (size_t k = terms.size(); k > 1; --k) std::swap(terms[k - 1], terms[rng.Below(k)]);
    mpz_class exact = 0;
    for (const double x : terms) exact += Shifted(x);
    ASSERT_EQ(SignOfSum<kTerms>(terms), sgn(exact));
  }
}

// Products as the predicate makes them: two floats in one double, times a third.
TEST(ExactSumTest, ProductsAreExact) {
  TestRng rng;
  for (int64_t i = ScaledCount(30'000); i > 0; --i) {
    ExactSum<48> sum;
    mpq_class exact = 0;
    const int range = 1 + static_cast<int>(rng.Below(189));
    const auto number = [&] {
      const double x =
          std::ldexp(rng.Uniform(-1, 1), static_cast<int>(rng.Below(range)) - range + 40);
      return static_cast<float>(x);
    };
    std::vector<std::pair<double, double>> products;
    const int n = 1 + static_cast<int>(rng.Below(12));
    for (int k = 0; k < n; ++k) {
      const double ab = double{number()} * number();
      const double c = number();
      products.emplace_back(ab, c);
      if (rng.Chance(0.9)) products.emplace_back(-ab, c);
    }
    for (size_t k = products.size(); k > 1; --k) std::swap(products[k - 1], products[rng.Below(k)]);
    for (const auto& [x, y] : products) {
      sum.AddProduct(x, y);
      exact += mpq_class(x) * mpq_class(y);
    }
    ASSERT_EQ(sum.sign(), sgn(exact));
  }
}

TEST(ExactSumTest, TheLeastAndTheLargestProductsOfThreeFloatsKeepTheirSign) {
  const double least = 0x1p-149, largest = double{std::numeric_limits<float>::max()};
  ExactSum<6> sum;
  sum.AddProduct(largest * largest, largest);
  sum.AddProduct(least * least, least);
  sum.AddProduct(-largest * largest, largest);
  EXPECT_EQ(sum.sign(), 1);
}

}  // namespace
}  // namespace sightline
