// SPDX-License-Identifier: Apache-2.0
#include "tests/policy/hygiene_rules.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <string_view>

namespace sightline::policy {
namespace {

constexpr size_t kMaxLines = 600;
constexpr size_t kMaxColumns = 100;

// Files that may be longer than kMaxLines, each with its reason. None so far.
struct LongFile {
  std::string_view path;
  std::string_view reason;
};
constexpr std::array<LongFile, 0> kLongFiles = {};

bool HasAnyExtension(const SourceFile& file, std::initializer_list<std::string_view> extensions) {
  return std::ranges::any_of(extensions, [&](std::string_view e) { return file.HasExtension(e); });
}

// The rules below would find their own examples.
bool IsPolicy(const SourceFile& file) { return file.IsUnder("tests/policy/"); }

bool IsWordCharacter(char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_'; }

// Whether `word` stands in `line` with no letter, digit or underscore on either side. A literal
// that is the word and nothing else names it, as another test's list of such words does.
bool HasWord(std::string_view line, std::string_view word) {
  for (size_t at = line.find(word); at != std::string_view::npos; at = line.find(word, at + 1)) {
    const size_t end = at + word.size();
    if ((at == 0 || !IsWordCharacter(line[at - 1])) &&
        (end == line.size() || !IsWordCharacter(line[end])) &&
        !(at > 0 && line[at - 1] == '"' && end < line.size() && line[end] == '"')) {
      return true;
    }
  }
  return false;
}

size_t CodePoints(std::string_view line) {
  return static_cast<size_t>(std::ranges::count_if(
      line, [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

std::string GuardOf(std::string_view path) {
  std::string guard = "SIGHTLINE_";
  for (const char c : path) {
    guard +=
        IsWordCharacter(c) ? static_cast<char>(std::toupper(static_cast<unsigned char>(c))) : '_';
  }
  return guard + "_";
}

}  // namespace

std::vector<std::string> CheckLicenceLine(const SourceFile& file) {
  if (!HasAnyExtension(file, {".h", ".cc", ".proto", ".sh", ".awk", ".py"})) return {};
  const size_t at = !file.lines.empty() && file.lines[0].starts_with("#!") ? 1 : 0;
  if (file.lines.size() > at && (file.lines[at] == "// SPDX-License-Identifier: Apache-2.0" ||
                                 file.lines[at] == "# SPDX-License-Identifier: Apache-2.0")) {
    return {};
  }
  return {Finding(file, at + 1, "the SPDX line is missing")};
}

std::vector<std::string> CheckNoMachinePaths(const SourceFile& file) {
  std::vector<std::string> found;
  if (IsPolicy(file)) return found;
  for (size_t i = 0; i < file.lines.size(); ++i) {
    const std::string_view line = file.lines[i];
    for (const std::string_view name : {"work", "home", "root", "Users", "tmp"}) {
      const std::string folder = "/" + std::string(name) + "/";
      for (size_t at = line.find(folder); at != std::string_view::npos;
           at = line.find(folder, at + 1)) {
        // After a word, a dot, a dash or a closing brace the path goes on: it is relative. After
        // anything else, "~" and "=" included, it begins here.
        if (at > 0 && (IsWordCharacter(line[at - 1]) || line[at - 1] == '.' ||
                       line[at - 1] == '-' || line[at - 1] == '}')) {
          continue;
        }
        found.push_back(Finding(file, i + 1, "a path of one machine: " + folder));
      }
    }
  }
  return found;
}

std::vector<std::string> CheckNoLeftovers(const SourceFile& file) {
  std::vector<std::string> found;
  if (IsPolicy(file)) return found;
  for (size_t i = 0; i < file.lines.size(); ++i) {
    for (const std::string_view word : {"TODO", "FIXME", "XXX", "HACK"}) {
      if (HasWord(file.lines[i], word)) {
        found.push_back(Finding(file, i + 1, std::string(word) + " is left over"));
      }
    }
  }
  return found;
}

std::vector<std::string> CheckLength(const SourceFile& file) {
  const auto is_blank = [](const std::string& line) { return line.empty(); };
  if (file.HasExtension(".md") && std::ranges::all_of(file.lines, is_blank)) {
    return {Finding(file, 0, "holds nothing")};
  }
  if (file.lines.size() <= kMaxLines || file.HasExtension("LICENSE")) return {};
  const auto is_listed = [&](const LongFile& entry) { return entry.path == file.path; };
  if (std::ranges::any_of(kLongFiles, is_listed)) return {};
  return {Finding(
      file, 0, std::to_string(file.lines.size()) + " lines; split it, or list it with a reason")};
}

std::vector<std::string> CheckLineForm(const SourceFile& file) {
  std::vector<std::string> found;
  if (!HasAnyExtension(file, {".h", ".cc", ".proto"})) return found;
  for (size_t i = 0; i < file.lines.size(); ++i) {
    const std::string& line = file.lines[i];
    if (CodePoints(line) > kMaxColumns) {
      found.push_back(Finding(file, i + 1, std::to_string(CodePoints(line)) + " columns"));
    }
    if (line.find('\t') != std::string::npos) found.push_back(Finding(file, i + 1, "a tab"));
    if (!line.empty() && std::isspace(static_cast<unsigned char>(line.back()))) {
      found.push_back(Finding(file, i + 1, "a blank at the end"));
    }
  }
  return found;
}

std::vector<std::string> CheckHeaderForm(const SourceFile& file) {
  std::vector<std::string> found;
  if (!file.HasExtension(".h")) return found;
  // Highway's per-target headers are read once per target behind a toggle.
  const bool per_target = file.HasExtension("-inl.h");
  bool thread_safety = false;
  bool guard = false;
  const std::string expected = GuardOf(file.path);
  for (const std::string& line : file.lines) {
    if (line == "#ifndef " + expected) guard = true;
    if (per_target && line.find(expected) != std::string::npos) guard = true;
    if (line.starts_with("#include")) break;
    if (line.starts_with("//") && line.find("hread safety") != std::string::npos) {
      thread_safety = true;
    }
  }
  if (!guard) found.push_back(Finding(file, 0, "no include guard " + expected));
  if (!thread_safety) {
    found.push_back(Finding(file, 0, "the comment at the top says nothing of \"Thread safety\""));
  }
  return found;
}

std::vector<std::string> CheckOwnHeaderFirst(const SourceFile& file,
                                             const std::vector<std::string>& headers) {
  if (!file.HasExtension(".cc")) return {};
  std::string own = file.path.substr(0, file.path.size() - 3);
  if (file.IsUnder("tests/") && own.ends_with("_test")) {
    own = own.substr(6, own.size() - 6 - 5);
  }
  own += ".h";
  if (!std::ranges::binary_search(headers, own)) return {};
  for (size_t i = 0; i < file.lines.size(); ++i) {
    const std::string& line = file.lines[i];
    if (line.starts_with("#define HWY_TARGET_INCLUDE")) return {};  // Highway wants its own order.
    if (!line.starts_with("#include")) continue;
    if (line.find("\"" + own + "\"") != std::string::npos) return {};
    return {Finding(file, i + 1, "the first #include should be \"" + own + "\"")};
  }
  return {Finding(file, 0, "does not include \"" + own + "\"")};
}

std::vector<std::string> CheckNoSleepInTests(const SourceFile& file) {
  std::vector<std::string> found;
  if (!file.IsUnder("tests/") || !file.IsCpp() || IsPolicy(file)) return found;
  for (size_t i = 0; i < file.lines.size(); ++i) {
    for (const std::string_view call :
         {"sleep_for", "sleep_until", "SleepFor", "usleep", "nanosleep", "sleep"}) {
      if (HasWord(file.lines[i], call) &&
          file.lines[i].find(std::string(call) + "(") != std::string::npos) {
        found.push_back(Finding(file, i + 1, "sleeps; wait for an event instead"));
        break;
      }
    }
  }
  return found;
}

}  // namespace sightline::policy
