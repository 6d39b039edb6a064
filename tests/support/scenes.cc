// SPDX-License-Identifier: Apache-2.0
#include "tests/support/scenes.h"

#include <cstdlib>
#include <filesystem>
#include <system_error>

namespace sightline::testing_support {

std::string SceneFolder() {
  const char* const folder = std::getenv("SIGHTLINE_SCENES");
  if (folder == nullptr || *folder == '\0') {
    return (std::filesystem::path(SIGHTLINE_SOURCE_DIR).parent_path() / "shared" / "scenes")
        .string();
  }
  std::string text = folder;
  while (text.size() > 1 && text.back() == '/') text.pop_back();
  return text;
}

std::string SceneFile(std::string_view name) {
  const std::filesystem::path path = std::filesystem::path(SceneFolder()) / name;
  std::error_code error;
  return std::filesystem::is_regular_file(path, error) ? path.string() : std::string();
}

std::string MissingSceneMessage(std::string_view name) {
  return "scene file " + std::string(name) + " is not there; set SIGHTLINE_SCENES to its folder";
}

}  // namespace sightline::testing_support
