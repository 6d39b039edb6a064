// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/answer_digest.h"

#include <set>
#include <string>
#include <utility>

#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline::bench {
namespace {

std::string RandomBytes(testing_support::TestRng& rng, size_t size) {
  std::string bytes(size, '\0');
  for (char& byte : bytes) byte = static_cast<char>(rng.Below(256));
  return bytes;
}

TEST(AnswerDigestTest, PiecesAddUpToTheWhole) {
  testing_support::TestRng rng;
  const AnswerPlace place{.item = 3, .array = 2, .row = 1};
  for (int round = 0; round < 200; ++round) {
    const size_t size = 1 + rng.Below(100);
    const std::string bytes = RandomBytes(rng, size);
    const size_t cut = rng.Below(size + 1);
    const uint64_t first = rng.Below(30);
    EXPECT_EQ(DigestOfArray(place, first, bytes),
              DigestOfArray(place, first, bytes.substr(0, cut)) +
                  DigestOfArray(place, first + cut, bytes.substr(cut)))
        << size << " bytes from " << first << ", cut at " << cut;
  }
}

TEST(AnswerDigestTest, RowsOfBitsAddUpToThoseOfTheWhole) {
  testing_support::TestRng rng;
  constexpr size_t kRows = 5, kPoints = 1000, kBytes = kPoints / 8;
  const std::string whole = RandomBytes(rng, kRows * kBytes);
  uint64_t digest = 0;
  for (const auto& [offset, count] : {std::pair<size_t, size_t>{600, 400}, {0, 344}, {344, 256}}) {
    std::string part;
    for (size_t row = 0; row < kRows; ++row) {
      part += whole.substr(row * kBytes + offset / 8, count / 8);
    }
    digest += DigestOfBitRows({.item = 9}, offset, count, part);
  }
  EXPECT_EQ(digest, DigestOfBitRows({.item = 9}, 0, kPoints, whole));
}

// All that a sum of bits or of words would not see.
TEST(AnswerDigestTest, EveryPlaceCountsDifferently) {
  testing_support::TestRng rng;
  constexpr size_t kPoints = 256, kBytes = kPoints / 8;
  const std::string bits = RandomBytes(rng, 2 * kBytes);
  std::set<uint64_t> digests;
  const auto differs = [&](const AnswerPlace& place, uint64_t offset, const std::string& bytes) {
    return digests.insert(DigestOfBitRows(place, offset, kPoints, bytes)).second;
  };
  EXPECT_TRUE(differs({}, 0, bits));
  EXPECT_TRUE(differs({.item = 1}, 0, bits));
  EXPECT_TRUE(differs({.array = 1}, 0, bits));
  EXPECT_TRUE(differs({.row = 1}, 0, bits));
  EXPECT_TRUE(differs({}, 8, bits)) << "begun a byte later";
  EXPECT_TRUE(differs({}, 64, bits)) << "begun a word later";
  EXPECT_TRUE(differs({}, 0, bits.substr(kBytes) + bits.substr(0, kBytes))) << "rows changed over";
  for (size_t i = 1; i < bits.size(); ++i) {
    std::string changed = bits;
    std::swap(changed[0], changed[i]);
    EXPECT_EQ(differs({}, 0, changed), bits[0] != bits[i]) << "byte " << i;
  }
  for (size_t bit = 0; bit < 8 * bits.size(); ++bit) {
    std::string changed = bits;
    changed[bit / 8] = static_cast<char>(changed[bit / 8] ^ 1 << bit % 8);
    EXPECT_TRUE(differs({}, 0, changed)) << "bit " << bit;
    char& later = changed[(bit / 8 + 8) % bits.size()];
    later = static_cast<char>(later ^ 1 << bit % 8);
    EXPECT_TRUE(differs({}, 0, changed)) << "bit " << bit << ", and that a word later";
  }
}

}  // namespace
}  // namespace sightline::bench
