// SPDX-License-Identifier: Apache-2.0
//
// A fresh folder for one test, removed with everything in it when the object goes.
//
// Thread safety: constant after construction.
//
//   TempDir dir;
//   WriteFile(dir.File("mesh.ply"), bytes);
#ifndef SIGHTLINE_TESTS_SUPPORT_TEMP_DIR_H_
#define SIGHTLINE_TESTS_SUPPORT_TEMP_DIR_H_

#include <string>
#include <string_view>

namespace sightline::testing_support {

class TempDir {
 public:
  // Ends the process where no folder can be made: no test could go on.
  TempDir();
  ~TempDir();
  TempDir(const TempDir&) = delete;
  TempDir& operator=(const TempDir&) = delete;

  const std::string& path() const { return path_; }
  std::string File(std::string_view name) const { return path_ + "/" + std::string(name); }

 private:
  std::string path_;
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_SUPPORT_TEMP_DIR_H_
