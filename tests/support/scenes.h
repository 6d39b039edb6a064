// SPDX-License-Identifier: Apache-2.0
//
// Where the real scenes are: the folder named by SIGHTLINE_SCENES, else ../shared/scenes beside the
// tree. They are not part of this repository, so a test that wants one is skipped, with a message,
// where it is absent; every room also has tests on built-in scenes.
//
// Thread safety: reads the environment; call it from tests only.
//
//   TEST(ObjTest, ReadsTheCornellBox) {
//     SIGHTLINE_SCENE_OR_SKIP(path, "cornell_box.obj");
//     auto mesh = ReadObj(path);
//   }
#ifndef SIGHTLINE_TESTS_SUPPORT_SCENES_H_
#define SIGHTLINE_TESTS_SUPPORT_SCENES_H_

#include <string>
#include <string_view>

#include "gtest/gtest.h"

namespace sightline::testing_support {

// The folder, whether or not it exists; without a slash at its end.
std::string SceneFolder();

// The path of `name` ("awkward/soup.stl") within it, or an empty string where there is no such
// file.
std::string SceneFile(std::string_view name);

// What a skipped test says.
std::string MissingSceneMessage(std::string_view name);

}  // namespace sightline::testing_support

// Declares `path`, a const std::string, and skips the test where the file is absent.
#define SIGHTLINE_SCENE_OR_SKIP(path, name)                               \
  const std::string path = ::sightline::testing_support::SceneFile(name); \
  if (path.empty()) GTEST_SKIP() << ::sightline::testing_support::MissingSceneMessage(name)

#endif  // SIGHTLINE_TESTS_SUPPORT_SCENES_H_
