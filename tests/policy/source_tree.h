// SPDX-License-Identifier: Apache-2.0
//
// The files of this repository as text, for the tests that check rules over all of them.
//
// Thread safety: plain values.
//
//   for (const SourceFile& file : ReadSourceTree()) Check(file);
#ifndef SIGHTLINE_TESTS_POLICY_SOURCE_TREE_H_
#define SIGHTLINE_TESTS_POLICY_SOURCE_TREE_H_

#include <string>
#include <string_view>
#include <vector>

namespace sightline::policy {

struct SourceFile {
  std::string path;                // From the top of the tree: "core/base/check.h".
  std::vector<std::string> lines;  // Without their line ends.

  bool HasExtension(std::string_view extension) const { return path.ends_with(extension); }
  bool IsUnder(std::string_view folder) const { return path.starts_with(folder); }
  bool IsCpp() const { return HasExtension(".h") || HasExtension(".cc"); }
};

// One finding: "core/x.cc:12: what is wrong". Lines count from 1; 0 means the file as a whole.
std::string Finding(const SourceFile& file, size_t line, std::string_view what);

// For planted examples.
SourceFile MakeFile(std::string path, std::string_view text);

// Every text file of the rooms and of the top folder, by path. Binary files and build folders are
// left out.
std::vector<SourceFile> ReadSourceTree();

}  // namespace sightline::policy

#endif  // SIGHTLINE_TESTS_POLICY_SOURCE_TREE_H_
