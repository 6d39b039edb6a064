// SPDX-License-Identifier: Apache-2.0
#include "server/stream/item_work.h"

#include <vector>

#include "gtest/gtest.h"

namespace sightline {
namespace {

constexpr uint64_t kPartRays = 64 << 10;

// Whatever the shape: parts cover every element once, in order, at multiples of 8 and of whole
// units, and their replies stay within the message limit.
TEST(CutIntoPartsTest, CoversEverythingOnceAtLegalOffsets) {
  const Limits limits;
  for (const uint64_t unit : {1u, 3u, 8u, 63u, 64u, 1920u, 65536u}) {
    for (const uint64_t units : {1u, 2u, 7u, 1080u, 2000u}) {
      for (const uint64_t rays : {1u, 4u, 1000u, 100000u}) {
        const uint64_t elements = unit * units;
        const auto bytes = [](uint64_t n) { return n / 8 + 1; };
        const auto parts = CutIntoParts(elements, unit, rays, kPartRays, limits, bytes);
        ASSERT_TRUE(parts.ok()) << parts.status();
        uint64_t next = 0;
        for (const PartRange& part : *parts) {
          EXPECT_EQ(part.offset, next);
          EXPECT_EQ(part.offset % 8, 0u);
          EXPECT_EQ(part.offset % unit, 0u);
          EXPECT_EQ(part.count % unit, 0u);
          EXPECT_GT(part.count, 0u);
          EXPECT_LT(bytes(part.count), limits.max_message_bytes);
          next += part.count;
        }
        EXPECT_EQ(next, elements);
      }
    }
  }
}

TEST(CutIntoPartsTest, LargeRepliesAreCutAndTooLargeOnesRefused) {
  Limits limits;
  limits.max_message_bytes = 1 << 20;
  limits.target_reply_bytes = 1 << 16;
  const auto parts =
      CutIntoParts(100000, 1, 1, kPartRays, limits, [](uint64_t n) { return 20 * n; });
  ASSERT_TRUE(parts.ok());
  for (const PartRange& part : *parts) EXPECT_LE(20 * part.count, limits.target_reply_bytes);
  const absl::Status refused =
      CutIntoParts(100000, 1, 1, kPartRays, limits, [](uint64_t n) { return n << 20; }).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(ReasonOf(refused), v1::ERROR_REASON_LIMIT_EXCEEDED);
}

// What every reply holds, however few its elements, is counted once a reply, not once an element.
TEST(CutIntoPartsTest, BytesThatAreEveryReplysMakeNoMoreReplies) {
  Limits limits;
  limits.target_reply_bytes = 1 << 17;
  const auto bytes = [](uint64_t n) { return 1000 + 8 * n; };
  const auto parts = CutIntoParts(100000, 1, 1, 1 << 20, limits, bytes);
  ASSERT_TRUE(parts.ok());
  const uint64_t most = (limits.target_reply_bytes - 1000) / 8 / 8 * 8;
  ASSERT_EQ(parts->size(), (100000 + most - 1) / most);
  EXPECT_EQ(parts->front().count, most);
}

}  // namespace
}  // namespace sightline
