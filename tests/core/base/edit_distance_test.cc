// SPDX-License-Identifier: Apache-2.0
#include "core/base/edit_distance.h"

#include "gtest/gtest.h"

namespace sightline {
namespace {

TEST(NearestWordTest, CountsEdits) {
  EXPECT_EQ(EditDistance("kitten", "sitting"), 3u);
  EXPECT_EQ(EditDistance("", "abc"), 3u);
  EXPECT_EQ(EditDistance("same", "same"), 0u);
  const std::vector<std::string> words = {"view", "shade", "segments"};
  EXPECT_EQ(EditDistance("siez", "size"), 1u);
  EXPECT_EQ(NearestWord("veiw", words), "view");
  EXPECT_EQ(NearestWord("wive", words), "");
  EXPECT_EQ(NearestWord("viev", words), "view");
  EXPECT_EQ(NearestWord("seg", words), "segments");
}

}  // namespace
}  // namespace sightline
