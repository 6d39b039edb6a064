// SPDX-License-Identifier: Apache-2.0
#include "client/import/object_assembly.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using testing::ElementsAre;

TEST(CleanNameTest, KeepsUtf8AndReplacesTheRest) {
  EXPECT_EQ(CleanName("  Fenêtre 窗 🏠 "), "Fenêtre 窗 🏠");
  EXPECT_EQ(CleanName("a\tb\x01"),
            "a\uFFFD"
            "b\uFFFD");
  EXPECT_EQ(CleanName("caf\xE9!"), "caf\uFFFD!");              // Latin-1.
  EXPECT_EQ(CleanName("\xC0\xAF"), "\uFFFD\uFFFD");            // Overlong.
  EXPECT_EQ(CleanName("\xED\xA0\x80"), "\uFFFD\uFFFD\uFFFD");  // A surrogate.
  EXPECT_EQ(CleanName("\xE7\xAA"), "\uFFFD\uFFFD");            // Cut short.
  EXPECT_EQ(CleanName("\xF4\x90\x80\x80").size(), 12u);        // Above U+10FFFF.
}

TEST(CleanNameTest, CutsLongNamesBetweenCharacters) {
  std::string long_name = "x";
  for (int i = 0; i < 1000; ++i) long_name += "é";
  EXPECT_EQ(CleanName(long_name).size(), kMaxNameBytes - 1);
}

TEST(FinishNamesTest, MakesNamesUniqueWithoutTakingAnothers) {
  std::vector<ObjectInput> objects(6);
  const char* raw[] = {"leg", "leg", "leg (2)", "", "leg", " "};
  for (int i = 0; i < 6; ++i) objects[i].name = raw[i];
  FinishNames("chair", &objects);
  std::vector<std::string> names;
  names.reserve(objects.size());
  for (const ObjectInput& object : objects) names.push_back(object.name);
  EXPECT_THAT(names, ElementsAre("leg", "leg (3)", "leg (2)", "chair", "leg (4)", "chair (2)"));
}

TEST(FinishNamesTest, HasANameWhereNothingHas) {
  std::vector<ObjectInput> objects(1);
  FinishNames("", &objects);
  EXPECT_EQ(objects[0].name, "mesh");
}

TEST(VertexCompactorTest, GivesEachObjectItsOwnVertices) {
  const std::vector<Vec3d> pool = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}};
  VertexCompactor compactor(&pool);
  const std::vector<uint32_t> first = {3, 1, 3}, second = {0, 3, 1};
  const ObjectInput a = compactor.MakeObject("a", first);
  const ObjectInput b = compactor.MakeObject("b", second);
  EXPECT_THAT(a.indices, ElementsAre(0, 1, 0));
  EXPECT_THAT(a.vertices, ElementsAre(pool[3], pool[1]));
  EXPECT_THAT(b.indices, ElementsAre(0, 1, 2));
  EXPECT_THAT(b.vertices, ElementsAre(pool[0], pool[3], pool[1]));
}

}  // namespace
}  // namespace sightline
