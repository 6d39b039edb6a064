// SPDX-License-Identifier: Apache-2.0
//
// The floating-point state the engine computes in: rounding to nearest, gradual underflow (no FTZ,
// no DAZ), all exceptions masked. The error bounds of the predicate hold in no other. A host
// program may run its threads otherwise (Embree asks for flush-to-zero), so the state is set on
// entry and put back on exit.
//
// Compilers do not order arithmetic against a change of MXCSR: the computation has to sit behind a
// call that is not inlined. ThreadPool and ParallelFor do this for every body; call sites rarely
// need it.
//
// Thread safety: acts on the calling thread alone. Scopes nest.
//
//   ScopedFloatEnvironment environment;
//   body();  // Not inlined.
#ifndef SIGHTLINE_CORE_BASE_FLOAT_ENVIRONMENT_H_
#define SIGHTLINE_CORE_BASE_FLOAT_ENVIRONMENT_H_

#include <xmmintrin.h>

namespace sightline {

class ScopedFloatEnvironment {
 public:
  // Power-on value (Intel SDM volume 1, 10.2.3): exceptions masked, nearest, no FTZ, no DAZ, no
  // flag.
  static constexpr unsigned kEngineMxcsr = 0x1F80;

  ScopedFloatEnvironment() : saved_(_mm_getcsr()) {
    if (saved_ != kEngineMxcsr) _mm_setcsr(kEngineMxcsr);
  }
  // Also drops the exception flags that the scope has raised.
  ~ScopedFloatEnvironment() { _mm_setcsr(saved_); }
  ScopedFloatEnvironment(const ScopedFloatEnvironment&) = delete;
  ScopedFloatEnvironment& operator=(const ScopedFloatEnvironment&) = delete;

 private:
  const unsigned saved_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_FLOAT_ENVIRONMENT_H_
