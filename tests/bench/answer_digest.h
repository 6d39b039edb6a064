// SPDX-License-Identifier: Apache-2.0
//
// Digests of answers that come in pieces and in any order: each word counts by where it stands
// (item, array, row, place in the row), and pieces are added up. So the sum over an item's replies
// is that of the item in one piece, however it was cut, and what stands in another place, in
// another item's answer or twice has another one.
//
// A word's share is its halves times two numbers that its place gives, modulo 2^64: linear, so that
// a word may be cut anywhere between its bytes. What two answers differ by in a half is below 2^32
// and not zero, so that no more than 32 bits of a share are zeros by themselves: different answers
// have the same digest by chance alone, once in some 2^32 times.
//
// Thread safety: functions only.
//
//   digest += DigestOfArray({.item = id, .array = kDepths}, 4 * offset, depths);
//   digest += DigestOfBitRows({.item = id, .array = kLit}, offset, count, lit_bits);
#ifndef SIGHTLINE_TESTS_BENCH_ANSWER_DIGEST_H_
#define SIGHTLINE_TESTS_BENCH_ANSWER_DIGEST_H_

#include <cstdint>
#include <string_view>

namespace sightline::bench {

// Which row of what.
struct AnswerPlace {
  uint64_t item = 0, array = 0, row = 0;
};

// Of bytes that stand from byte `first` of a row on.
uint64_t DigestOfArray(const AnswerPlace& place, uint64_t first, std::string_view bytes);

// Of rows of `count` bits each, padded to bytes, that begin with element `offset` of whole ones;
// the first of them is `place`'s. REQUIRES: offset is a multiple of 8, and the rows are whole.
uint64_t DigestOfBitRows(const AnswerPlace& place, uint64_t offset, uint64_t count,
                         std::string_view bytes);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_ANSWER_DIGEST_H_
