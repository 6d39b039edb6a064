// SPDX-License-Identifier: Apache-2.0
#include "core/base/float_environment.h"

#include <pmmintrin.h>

#include <limits>

#include "gtest/gtest.h"

namespace sightline {
namespace {

// Divides at run time, where it stands: the operands come from and the quotient goes to memory that
// the compiler must not reason about.
float Divide(float a, float b) {
  volatile float numerator = a, denominator = b;
  volatile float quotient = numerator / denominator;
  return quotient;
}

// Puts the thread's state back whatever the test did.
class FloatEnvironmentTest : public testing::Test {
 protected:
  ~FloatEnvironmentTest() override { _mm_setcsr(saved_); }
  const unsigned saved_ = _mm_getcsr();
};

TEST_F(FloatEnvironmentTest, RestoresGradualUnderflowAndPutsFlushingBack) {
  const float tiny = std::numeric_limits<float>::min();
  _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
  _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
  const unsigned before = _mm_getcsr();
  EXPECT_EQ(Divide(tiny, 2), 0);
  {
    ScopedFloatEnvironment environment;
    EXPECT_EQ(Divide(tiny, 2), std::numeric_limits<float>::denorm_min() * 0x1p22f);
  }
  EXPECT_EQ(Divide(tiny, 2), 0);
  EXPECT_EQ(_mm_getcsr() & ~_MM_EXCEPT_MASK, before & ~_MM_EXCEPT_MASK);
}

TEST_F(FloatEnvironmentTest, RoundsToNearest) {
  _MM_SET_ROUNDING_MODE(_MM_ROUND_UP);
  const float up = Divide(1, 3);
  float nearest;
  {
    ScopedFloatEnvironment environment;
    nearest = Divide(2, 3);
    _MM_SET_ROUNDING_MODE(
        _MM_ROUND_UP);  // The scope may be disturbed; its end restores all the same.
  }
  EXPECT_EQ(up, 0x1.555556p-2f);
  EXPECT_EQ(nearest, 0x1.555556p-1f);
  EXPECT_EQ(_MM_GET_ROUNDING_MODE(), static_cast<unsigned>(_MM_ROUND_UP));
  _MM_SET_ROUNDING_MODE(_MM_ROUND_DOWN);
  EXPECT_EQ(Divide(1, 3), 0x1.555554p-2f);
  ScopedFloatEnvironment environment;
  EXPECT_EQ(Divide(1, 3), 0x1.555556p-2f);
}

TEST_F(FloatEnvironmentTest, MasksExceptionsAndDropsTheFlagsItRaised) {
  _mm_setcsr((_mm_getcsr() & ~_MM_EXCEPT_MASK) &
             ~_MM_MASK_DIV_ZERO);  // Division by zero would trap.
  {
    ScopedFloatEnvironment environment;
    EXPECT_EQ(Divide(1, 0), std::numeric_limits<float>::infinity());
  }
  EXPECT_EQ(_mm_getcsr() & _MM_EXCEPT_MASK, 0u);
  EXPECT_EQ(_mm_getcsr() & _MM_MASK_DIV_ZERO, 0u);
}

TEST_F(FloatEnvironmentTest, Nests) {
  ScopedFloatEnvironment outer;
  { ScopedFloatEnvironment inner; }
  EXPECT_EQ(_mm_getcsr() & ~_MM_EXCEPT_MASK, ScopedFloatEnvironment::kEngineMxcsr);
}

}  // namespace
}  // namespace sightline
