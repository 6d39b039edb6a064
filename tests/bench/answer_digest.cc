// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/answer_digest.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "core/base/check.h"
#include "core/base/mix_bits.h"

namespace sightline::bench {
namespace {

constexpr uint64_t kWord = sizeof(uint64_t);

// Every bit of the result depends on every bit of x, 0 among them.
uint64_t Mix(uint64_t x) { return MixBits(x + kGoldenStep); }

// Of a word of the row, or of some of its bytes, the others being zero. Three multiplications, no
// more: this is part of what is timed.
uint64_t DigestOfWord(uint64_t row, uint64_t place, uint64_t word) {
  uint64_t x = (row + place) * kGoldenStep;
  x ^= x >> 32;
  return (word & 0xFFFFFFFFu) * x + (word >> 32) * std::rotl(x, 21);
}

}  // namespace

uint64_t DigestOfArray(const AnswerPlace& place, uint64_t first, std::string_view bytes) {
  const uint64_t row = Mix(Mix(Mix(place.item) + place.array) + place.row);
  uint64_t digest = 0;
  const auto add = [&](uint64_t at, const char* from, size_t count) {
    uint64_t word = 0;
    std::memcpy(reinterpret_cast<char*>(&word) + at % kWord, from, count);
    digest += DigestOfWord(row, at / kWord, word);
  };
  // Up to a word's border, whole words, and what is left.
  const size_t head = std::min<size_t>(bytes.size(), (kWord - first % kWord) % kWord);
  if (head > 0) add(first, bytes.data(), head);
  size_t at = head;
  for (; at + kWord <= bytes.size(); at += kWord) add(first + at, bytes.data() + at, kWord);
  if (at < bytes.size()) add(first + at, bytes.data() + at, bytes.size() - at);
  return digest;
}

uint64_t DigestOfBitRows(const AnswerPlace& place, uint64_t offset, uint64_t count,
                         std::string_view bytes) {
  SIGHTLINE_CHECK_EQ(offset % 8, 0u);
  const size_t row_bytes = (count + 7) / 8;
  if (bytes.empty()) return 0;
  SIGHTLINE_CHECK(row_bytes > 0 && bytes.size() % row_bytes == 0);
  AnswerPlace row = place;
  uint64_t digest = 0;
  for (size_t at = 0; at < bytes.size(); at += row_bytes, ++row.row) {
    digest += DigestOfArray(row, offset / 8, bytes.substr(at, row_bytes));
  }
  return digest;
}

}  // namespace sightline::bench
