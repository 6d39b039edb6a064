// SPDX-License-Identifier: Apache-2.0
#include "core/base/cpu_check.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;

constexpr CpuFeatures kAll = {true, true, true, true, true, true, true, true};

std::string Describe(const CpuFeatures& features) {
  char text[512];
  const size_t length = DescribeMissingCpuFeatures(features, text, sizeof(text));
  EXPECT_EQ(length, std::string(text).size());
  return text;
}

TEST(CpuCheckTest, NothingIsSaidOfACompleteCpu) { EXPECT_EQ(Describe(kAll), ""); }

TEST(CpuCheckTest, NamesExactlyWhatIsMissing) {
  CpuFeatures features = kAll;
  features.avx2 = false;
  features.movbe = false;
  const std::string text = Describe(features);
  EXPECT_THAT(text, HasSubstr("missing: AVX2 MOVBE."));
  EXPECT_THAT(text, HasSubstr("x86-64-v3"));
  EXPECT_EQ(text.back(), '\n');
}

TEST(CpuCheckTest, EachFeatureAloneIsReported) {
  bool CpuFeatures::*const kMembers[] = {
      &CpuFeatures::avx2, &CpuFeatures::fma,   &CpuFeatures::bmi1,  &CpuFeatures::bmi2,
      &CpuFeatures::f16c, &CpuFeatures::lzcnt, &CpuFeatures::movbe, &CpuFeatures::os_saves_ymm};
  const char* const kNames[] = {"AVX2", "FMA",   "BMI1",  "BMI2",
                                "F16C", "LZCNT", "MOVBE", "OS-support-for-YMM-registers"};
  for (int i = 0; i < 8; ++i) {
    CpuFeatures features = kAll;
    features.*kMembers[i] = false;
    EXPECT_THAT(Describe(features), HasSubstr(std::string("missing: ") + kNames[i] + "."));
  }
}

TEST(CpuCheckTest, ALongMessageIsCutToItsBuffer) {
  for (size_t size = 1; size < 40; ++size) {
    char text[48];
    for (char& c : text) c = '#';
    EXPECT_EQ(DescribeMissingCpuFeatures(CpuFeatures{}, text, size), size - 1);
    EXPECT_EQ(text[size - 1], '\0');
    EXPECT_EQ(text[size], '#');
  }
}

TEST(CpuCheckTest, DetectionAgreesWithTheCompilersRuntime) {
  const CpuFeatures found = DetectCpuFeatures();
  EXPECT_EQ(found.avx2 && found.os_saves_ymm, __builtin_cpu_supports("avx2") != 0);
  EXPECT_EQ(found.fma && found.os_saves_ymm, __builtin_cpu_supports("fma") != 0);
  EXPECT_EQ(found.bmi1, __builtin_cpu_supports("bmi") != 0);
  EXPECT_EQ(found.bmi2, __builtin_cpu_supports("bmi2") != 0);
}

TEST(CpuCheckTest, RanBeforeMain) { EXPECT_TRUE(sightline_cpu_check_ran); }

}  // namespace
}  // namespace sightline
