// SPDX-License-Identifier: Apache-2.0
#include "server/config_file.h"

#include <yaml-cpp/yaml.h>

#include <cstdint>
#include <exception>
#include <map>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/base/regular_file.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// A configuration is written by people; beyond this it is some other file.
constexpr uint64_t kMaxFileBytes = 1 << 20;

absl::Status At(absl::string_view name, int line, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(name, ":", line, ": ", what));
}

int LineOf(const YAML::Mark& mark) { return mark.line + 1; }

absl::StatusOr<std::vector<std::string>> Values(absl::string_view name, const ConfigEntry& entry,
                                                const YAML::Node& node) {
  std::vector<std::string> values;
  if (node.IsScalar()) return values = {node.Scalar()};
  const std::string wants = absl::StrCat("\"", entry.key, "\" wants one value or a list of values");
  // The key's line: a value that is missing has the mark of whatever comes next.
  if (!node.IsSequence()) return At(name, entry.line, wants);
  for (const YAML::Node& element : node) {
    if (!element.IsScalar()) return At(name, LineOf(element.Mark()), wants);
    values.push_back(element.Scalar());
  }
  if (values.empty()) return At(name, entry.line, wants);
  return values;
}

absl::StatusOr<std::vector<ConfigEntry>> Entries(absl::string_view name, const YAML::Node& root) {
  std::vector<ConfigEntry> entries;
  if (root.IsNull()) return entries;  // Comments alone.
  if (!root.IsMap()) return At(name, LineOf(root.Mark()), "must be lines of OPTION: VALUE");
  std::map<std::string, int> lines;
  for (const auto& pair : root) {
    const YAML::Node& key = pair.first;
    const int line = LineOf(key.Mark());
    if (!key.IsScalar()) return At(name, line, "an option's name must be a word");
    ConfigEntry entry{.key = key.Scalar(), .line = line};
    const auto [first, inserted] = lines.emplace(entry.key, line);
    if (!inserted) {
      return At(name, line,
                absl::StrCat("\"", entry.key, "\" stands in line ", first->second,
                             " already; an option with several values takes a list"));
    }
    SL_ASSIGN_OR_RETURN(entry.values, Values(name, entry, pair.second));
    entries.push_back(std::move(entry));
  }
  return entries;
}

}  // namespace

absl::StatusOr<std::vector<ConfigEntry>> ParseConfig(absl::string_view name,
                                                     absl::string_view text) {
  // The only way in which yaml-cpp says that something is wrong.
  try {
    const std::vector<YAML::Node> documents = YAML::LoadAll(std::string(text));
    for (size_t i = 1; i < documents.size(); ++i) {
      if (documents[i].IsNull()) continue;
      return At(name, LineOf(documents[i].Mark()),
                "is another document, after a line \"---\": a configuration is one");
    }
    return documents.empty() ? std::vector<ConfigEntry>() : Entries(name, documents[0]);
  } catch (const YAML::Exception& error) {
    return At(name, LineOf(error.mark), error.msg);
  } catch (const std::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": ", error.what()));
  }
}

absl::StatusOr<std::vector<ConfigEntry>> ReadConfigFile(const std::string& path) {
  const auto failed = [&path](const absl::Status& status) {
    return OfFile(absl::StrCat("the configuration file ", path), status);
  };
  const absl::StatusOr<RegularFile> file = RegularFile::Open(path);
  if (!file.ok()) return failed(file.status());
  const absl::StatusOr<std::string> text = file->Read(kMaxFileBytes);
  if (!text.ok()) return failed(text.status());
  return ParseConfig(path, *text);
}

}  // namespace sightline
