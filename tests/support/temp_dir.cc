// SPDX-License-Identifier: Apache-2.0
#include "tests/support/temp_dir.h"

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <system_error>

namespace sightline::testing_support {

TempDir::TempDir()
    : path_((std::filesystem::temp_directory_path() / "sightline-test-XXXXXX").string()) {
  if (mkdtemp(path_.data()) == nullptr) {
    std::perror(("cannot make a folder like " + path_).c_str());
    std::abort();
  }
}

TempDir::~TempDir() {
  std::error_code error;  // A folder that cannot be removed fails no test.
  std::filesystem::remove_all(path_, error);
}

}  // namespace sightline::testing_support
