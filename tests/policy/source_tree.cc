// SPDX-License-Identifier: Apache-2.0
#include "tests/policy/source_tree.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <utility>

namespace sightline::policy {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kFolders[] = {".ci",   "client", "core", "deploy",
                                         "proto", "server", "tests"};
// Seeds of the fuzz targets and files that tests read are data, not sources.
constexpr std::string_view kDataFolders[] = {"corpus", "testdata"};

void ReadFile(const fs::path& root, const fs::path& path, std::vector<SourceFile>& files) {
  std::ifstream in(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  if (text.find('\0') != std::string::npos) return;
  files.push_back(MakeFile(fs::relative(path, root).generic_string(), text));
}

}  // namespace

std::string Finding(const SourceFile& file, size_t line, std::string_view what) {
  std::string text = file.path;
  if (line > 0) text += ":" + std::to_string(line);
  text += ": ";
  text += what;
  return text;
}

SourceFile MakeFile(std::string path, std::string_view text) {
  SourceFile file{std::move(path), {}};
  while (!text.empty()) {
    const size_t end = std::min(text.find('\n'), text.size());
    file.lines.emplace_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return file;
}

std::vector<SourceFile> ReadSourceTree() {
  const fs::path root = SIGHTLINE_SOURCE_DIR;
  std::vector<SourceFile> files;
  for (const auto& entry : fs::directory_iterator(root)) {
    if (entry.is_regular_file()) ReadFile(root, entry.path(), files);
  }
  for (const std::string_view folder : kFolders) {
    if (!fs::exists(root / folder)) continue;
    for (auto it = fs::recursive_directory_iterator(root / folder); it != fs::end(it); ++it) {
      const std::string name = it->path().filename().string();
      if (it->is_directory() && std::ranges::count(kDataFolders, name) > 0) {
        it.disable_recursion_pending();
      } else if (it->is_regular_file()) {
        ReadFile(root, it->path(), files);
      }
    }
  }
  std::ranges::sort(files, {}, &SourceFile::path);
  return files;
}

}  // namespace sightline::policy
