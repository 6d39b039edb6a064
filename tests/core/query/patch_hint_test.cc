// SPDX-License-Identifier: Apache-2.0
#include "core/query/patch_hint.h"

#include <array>
#include <cstdint>

#include "gtest/gtest.h"

namespace sightline {
namespace {

constexpr uint32_t kNone = RayPacket::kNoLeaf;

TEST(PatchHintTest, TheLastLeavesComeFirst) {
  PatchHint hint;
  EXPECT_EQ(hint.leaves(), (std::array{kNone, kNone, kNone, kNone}));
  for (const uint32_t leaf : {1u, 2u, 3u}) hint.PutFirst(leaf);
  EXPECT_EQ(hint.leaves(), (std::array{3u, 2u, 1u, kNone}));
  hint.PutFirst(2);
  EXPECT_EQ(hint.leaves(), (std::array{2u, 3u, 1u, kNone}));
  for (const uint32_t leaf : {2u, 4u, 5u}) hint.PutFirst(leaf);
  EXPECT_EQ(hint.leaves(), (std::array{5u, 4u, 2u, 3u}));
  hint.PutFirst(3);
  EXPECT_EQ(hint.leaves(), (std::array{3u, 5u, 4u, 2u}));
}

TEST(PatchHintTest, WaitsTheLongerTheMoreOftenInVain) {
  PatchHint hint;
  EXPECT_TRUE(hint.IsDue());
  for (const int wait : {0, 1, 2, 3, 4, 5, 6, 7, 7, 7}) {
    hint.Note(false);
    for (int i = 0; i < wait; ++i) EXPECT_FALSE(hint.IsDue()) << i << " of " << wait;
    EXPECT_TRUE(hint.IsDue()) << "after " << wait;
  }
  hint.Note(true);
  EXPECT_TRUE(hint.IsDue());
  hint.Note(false);
  EXPECT_TRUE(hint.IsDue());
}

}  // namespace
}  // namespace sightline
