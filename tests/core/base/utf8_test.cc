// SPDX-License-Identifier: Apache-2.0
#include "core/base/utf8.h"

#include <cstdint>
#include <string>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

// The code point by the bit pattern of its size, whether that form is allowed or not.
std::string Encoded(uint32_t code, int size) {
  if (size == 1) return std::string(1, static_cast<char>(code));
  std::string text;
  for (int i = 0; i < size - 1; ++i, code >>= 6) {
    text.insert(text.begin(), static_cast<char>(0x80 | (code & 0x3F)));
  }
  text.insert(text.begin(), static_cast<char>((0xF00u >> size) | code));
  return text;
}

TEST(Utf8Test, EveryCodePointHasOneForm) {
  for (uint32_t code = 0; code < 1u << 21; ++code) {
    const int shortest = code < 0x80 ? 1 : code < 0x800 ? 2 : code < 0x10000 ? 3 : 4;
    const bool there = code <= 0x10FFFF && !(code >= 0xD800 && code <= 0xDFFF);
    for (int size = shortest; size <= 4; ++size) {
      ASSERT_EQ(IsUtf8(Encoded(code, size)), there && size == shortest) << code << " in " << size;
    }
  }
}

TEST(Utf8Test, CharactersAreWholeWhereverTheyStand) {
  EXPECT_TRUE(IsUtf8(""));
  EXPECT_TRUE(IsUtf8(std::string("a\0\x7F", 3)));
  const std::string four = "\xF0\x9F\xAA\x91", three = "\xE2\x82\xAC", two = "\xC3\xBC";
  EXPECT_TRUE(IsUtf8(four + three + two + "a" + two + four));
  for (const std::string& whole : {four, three, two}) {
    for (size_t size = 1; size < whole.size(); ++size) {
      EXPECT_FALSE(IsUtf8(whole.substr(0, size)));
      EXPECT_FALSE(IsUtf8(whole.substr(0, size) + "a"));
      EXPECT_FALSE(IsUtf8(absl::StrCat("a", whole.substr(size))));
    }
  }
  for (int byte = 0xF8; byte <= 0xFF; ++byte) {
    EXPECT_FALSE(IsUtf8(std::string(1, static_cast<char>(byte)) + "\x80\x80\x80\x80\x80"));
  }
}

}  // namespace
}  // namespace sightline
