// SPDX-License-Identifier: Apache-2.0
//
// Refuses to start on a CPU below x86-64-v3. Everything else in this project is compiled for that
// level, so without this check an older machine would die of SIGILL somewhere without a word.
//
// A constructor of the earliest priority in cpu_check.cc runs before any other code of ours, prints
// one line and exits with 78 (EX_CONFIG). Linking sightline_core_base is enough to have it.
//
// Invariant: cpu_check.cc is compiled without -march and uses no inline function of any library
// header, since the linker could pick a copy of it that was compiled for x86-64-v3.
//
// Thread safety: pure functions, and one flag that is constant once main() has begun.
#ifndef SIGHTLINE_CORE_BASE_CPU_CHECK_H_
#define SIGHTLINE_CORE_BASE_CPU_CHECK_H_

#include <cstddef>

// Set by the constructor once the check has passed.
extern "C" bool sightline_cpu_check_ran;

namespace sightline {

// What x86-64-v3 adds to the baseline and our compilers make use of.
struct CpuFeatures {
  bool avx2;
  bool fma;
  bool bmi1;
  bool bmi2;
  bool f16c;
  bool lzcnt;
  bool movbe;
  bool os_saves_ymm;  // The operating system saves the 256-bit registers (OSXSAVE and XCR0).
};

// What this machine has.
CpuFeatures DetectCpuFeatures();

// Writes the line to print into `out`, cut to `size` bytes with its terminating zero, and returns
// its length; 0 (and an empty string) if nothing is missing. REQUIRES: size > 0.
size_t DescribeMissingCpuFeatures(const CpuFeatures& features, char* out, size_t size);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_CPU_CHECK_H_
