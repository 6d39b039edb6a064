// SPDX-License-Identifier: Apache-2.0
#include "core/base/cpu_check.h"

#include <cpuid.h>
#include <unistd.h>

bool sightline_cpu_check_ran = false;  // With C linkage, from the header.

namespace sightline {
namespace {

// EX_CONFIG of sysexits.h: a supervisor can tell "wrong machine" from a crash and need not restart.
constexpr int kExitWrongMachine = 78;

// The bits of CPUID that the feature names stand for (Intel SDM volume 2A, "CPUID").
constexpr unsigned kLeaf1EcxFma = 1u << 12;
constexpr unsigned kLeaf1EcxMovbe = 1u << 22;
constexpr unsigned kLeaf1EcxOsxsave = 1u << 27;
constexpr unsigned kLeaf1EcxF16c = 1u << 29;
constexpr unsigned kLeaf7EbxBmi1 = 1u << 3;
constexpr unsigned kLeaf7EbxAvx2 = 1u << 5;
constexpr unsigned kLeaf7EbxBmi2 = 1u << 8;
constexpr unsigned kExtendedLeaf1EcxLzcnt = 1u << 5;
constexpr unsigned kXcr0SseAndAvx = 0x6;

unsigned ReadXcr0() {
  unsigned eax, edx;
  __asm__ volatile("xgetbv" : "=a"(eax), "=d"(edx) : "c"(0));
  return eax;
}

size_t Append(const char* text, char* out, size_t size, size_t length) {
  while (*text != '\0' && length + 1 < size) out[length++] = *text++;
  out[length] = '\0';
  return length;
}

__attribute__((constructor(101))) void CheckCpuAtStart() {
  char message[512];
  size_t length = DescribeMissingCpuFeatures(DetectCpuFeatures(), message, sizeof(message));
  if (length > 0) {
    // Neither stdio nor a C++ stream: nothing of theirs need be initialized yet.
    ssize_t written = write(STDERR_FILENO, message, length);
    (void)written;  // There is nothing left to try if stderr is closed.
    _exit(kExitWrongMachine);
  }
  sightline_cpu_check_ran = true;
}

}  // namespace

CpuFeatures DetectCpuFeatures() {
  CpuFeatures features = {};
  unsigned eax, ebx, ecx, edx;
  if (__get_cpuid(1, &eax, &ebx, &ecx, &edx)) {
    features.fma = (ecx & kLeaf1EcxFma) != 0;
    features.movbe = (ecx & kLeaf1EcxMovbe) != 0;
    features.f16c = (ecx & kLeaf1EcxF16c) != 0;
    // xgetbv itself faults where OSXSAVE is off.
    features.os_saves_ymm =
        (ecx & kLeaf1EcxOsxsave) != 0 && (ReadXcr0() & kXcr0SseAndAvx) == kXcr0SseAndAvx;
  }
  if (__get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx)) {
    features.avx2 = (ebx & kLeaf7EbxAvx2) != 0;
    features.bmi1 = (ebx & kLeaf7EbxBmi1) != 0;
    features.bmi2 = (ebx & kLeaf7EbxBmi2) != 0;
  }
  if (__get_cpuid(0x80000001u, &eax, &ebx, &ecx, &edx)) {
    features.lzcnt = (ecx & kExtendedLeaf1EcxLzcnt) != 0;
  }
  return features;
}

size_t DescribeMissingCpuFeatures(const CpuFeatures& features, char* out, size_t size) {
  const struct {
    bool present;
    const char* name;
  } kRows[] = {
      {features.avx2, " AVX2"},   {features.fma, " FMA"},
      {features.bmi1, " BMI1"},   {features.bmi2, " BMI2"},
      {features.f16c, " F16C"},   {features.lzcnt, " LZCNT"},
      {features.movbe, " MOVBE"}, {features.os_saves_ymm, " OS-support-for-YMM-registers"},
  };
  out[0] = '\0';
  size_t length = 0;
  for (const auto& row : kRows) {
    if (row.present) continue;
    if (length == 0) length = Append("sightline: this CPU cannot run it; missing:", out, size, 0);
    length = Append(row.name, out, size, length);
  }
  if (length == 0) return 0;
  return Append(
      ". Use a machine with x86-64-v3 (Intel Haswell, AMD Excavator or newer; in a virtual "
      "machine, "
      "pass the host's CPU model through).\n",
      out, size, length);
}

}  // namespace sightline
