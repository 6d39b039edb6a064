// SPDX-License-Identifier: Apache-2.0
#include "server/option_sources.h"

#include <yaml-cpp/yaml.h>

#include <map>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "core/base/edit_distance.h"
#include "core/base/status_macros.h"
#include "server/client_part.h"
#include "server/config_file.h"

namespace sightline {
namespace {

constexpr absl::string_view kPrefix = "SIGHTLINE_";

std::string Canonical(absl::string_view name) { return absl::StrReplaceAll(name, {{"_", "-"}}); }

const Option* Find(absl::string_view name) {
  for (const Option& option : OptionTable()) {
    if (option.name == name) return &option;
  }
  return nullptr;
}

// "; did you mean --threads?", or nothing.
std::string Suggestion(absl::string_view name, absl::string_view before,
                       const std::function<std::string(const std::string&)>& spell) {
  std::vector<std::string> names;
  for (const Option& option : OptionTable()) names.push_back(option.name);
  const std::string nearest = NearestWord(name, names);
  return nearest.empty() ? "" : absl::StrCat(before, spell(nearest), "?");
}

std::string VariableOf(const std::string& name) {
  return absl::StrCat(kPrefix, absl::AsciiStrToUpper(absl::StrReplaceAll(name, {{"-", "_"}})));
}

// What one source says, by option; `origin` stands before errors and in --print-config.
struct Setting {
  std::vector<std::string> values;
  std::string origin;
};
using Settings = std::map<const Option*, Setting>;

absl::StatusOr<Settings> FromFlags(int argc, const char* const* argv) {
  Settings settings;
  for (int i = 1; i < argc; ++i) {
    absl::string_view argument = argv[i];
    if (!absl::ConsumePrefix(&argument, "--")) {
      return absl::InvalidArgumentError(
          absl::StrCat("\"", argv[i], "\" is no flag; --help lists them"));
    }
    const size_t equals = argument.find('=');
    const std::string name = Canonical(argument.substr(0, equals));
    const Option* option = Find(name);
    if (option == nullptr) {
      return absl::InvalidArgumentError(absl::StrCat(
          "there is no flag --", name,
          Suggestion(name, "; did you mean --", [](const std::string& known) { return known; }),
          "; --help lists them"));
    }
    std::string value;
    if (equals != absl::string_view::npos) {
      value = std::string(argument.substr(equals + 1));
    } else if (!option->takes.empty()) {
      if (++i == argc) {
        return absl::InvalidArgumentError(absl::StrCat("--", name, " needs ", option->takes));
      }
      value = argv[i];
    }
    if (option->takes.empty() && equals != absl::string_view::npos) {
      return absl::InvalidArgumentError(absl::StrCat("--", name, " takes no value"));
    }
    Setting& setting = settings[option];
    setting.origin = absl::StrCat("--", name);
    // A script adds to a command what it wants changed: the last one counts.
    if (!option->repeated) setting.values.clear();
    setting.values.push_back(std::move(value));
  }
  return settings;
}

Settings FromEnvironment(const char* const* environment, std::vector<std::string>* warnings) {
  Settings settings;
  for (; environment != nullptr && *environment != nullptr; ++environment) {
    const absl::string_view line = *environment;
    const size_t equals = line.find('=');
    absl::string_view name = line.substr(0, equals);
    if (equals == absl::string_view::npos || !absl::ConsumePrefix(&name, kPrefix)) continue;
    const std::string known = absl::AsciiStrToLower(Canonical(name));
    const Option* option = Find(known);
    if (option == nullptr || option->takes.empty()) {
      // Not an error: Kubernetes puts SIGHTLINE_SERVICE_HOST and the like into every container
      // beside a service of that name.
      warnings->push_back(
          absl::StrCat("the variable ", kPrefix, name, " is no option and is ignored",
                       Suggestion(known, "; did you mean ",
                                  [](const std::string& n) { return VariableOf(n); })));
      continue;
    }
    const std::string value(line.substr(equals + 1));
    Setting setting{.values = {value}, .origin = absl::StrCat(kPrefix, name)};
    if (option->repeated) setting.values = absl::StrSplit(value, ' ', absl::SkipEmpty());
    if (value.empty() || setting.values.empty()) {
      // Deployments write VARIABLE=${OTHER} for what is not set: that should not put the access
      // rules of a file out of force.
      warnings->push_back(
          absl::StrCat("the variable ", setting.origin, " is empty and is ignored"));
      continue;
    }
    settings[option] = std::move(setting);
  }
  return settings;
}

absl::StatusOr<Settings> FromFile(const std::string& path) {
  SL_ASSIGN_OR_RETURN(const std::vector<ConfigEntry> entries, ReadConfigFile(path));
  Settings settings;
  for (const ConfigEntry& entry : entries) {
    const std::string name = Canonical(entry.key);
    const Option* option = Find(name);
    const std::string origin = absl::StrCat(path, ":", entry.line);
    if (option == nullptr) {
      return absl::InvalidArgumentError(absl::StrCat(
          origin, ": there is no option \"", entry.key, "\"",
          Suggestion(name, "; did you mean ", [](const std::string& known) { return known; })));
    }
    if (option->takes.empty() || option->name == "config") {
      return absl::InvalidArgumentError(
          absl::StrCat(origin, ": --", name, " is for the command line alone"));
    }
    if (!option->repeated && entry.values.size() != 1) {
      return absl::InvalidArgumentError(
          absl::StrCat(origin, ": \"", entry.key, "\" wants one value, not a list"));
    }
    const Setting setting{.values = entry.values, .origin = absl::StrCat(origin, ": ", name)};
    const auto [first, inserted] = settings.emplace(option, setting);
    if (inserted) continue;
    // By another spelling: the file itself has no key twice.
    return absl::InvalidArgumentError(
        absl::StrCat(origin, ": \"", entry.key, "\" is given already, at ", first->second.origin));
  }
  return settings;
}

std::string ConfigPath(const Settings& flags, const Settings& environment) {
  const Option* const config = Find("config");
  for (const Settings* settings : {&flags, &environment}) {
    if (const auto found = settings->find(config); found != settings->end()) {
      return found->second.values.back();
    }
  }
  return "";
}

}  // namespace

absl::StatusOr<ParsedOptions> ReadOptions(int argc, const char* const* argv,
                                          const char* const* environment) {
  ParsedOptions parsed;
  parsed.options.limits = DefaultLimits();
  SL_ASSIGN_OR_RETURN(const Settings flags, FromFlags(argc, argv));
  const Settings variables = FromEnvironment(environment, &parsed.warnings);
  Settings file;
  if (const std::string path = ConfigPath(flags, variables); !path.empty()) {
    SL_ASSIGN_OR_RETURN(file, FromFile(path));
  }
  for (const Option& option : OptionTable()) {
    for (const Settings* settings : {&flags, &variables, &std::as_const(file)}) {
      const auto found = settings->find(&option);
      if (found == settings->end()) continue;
      for (const std::string& value : found->second.values) {
        if (absl::Status status = option.set(value, &parsed); !status.ok()) {
          return absl::InvalidArgumentError(
              absl::StrCat(found->second.origin, " = ", status.message()));
        }
      }
      parsed.given[option.name] = {found->second.values, found->second.origin};
      break;
    }
  }
  for (const LimitEntry& entry : LimitTable()) {
    const ClientPart* const part = TotalOf(entry.name);
    if (part == nullptr || parsed.given.contains(Canonical(entry.name))) continue;
    HalveTotal(*part, &parsed.options.limits);
  }
  for (std::string& warning : WithoutEffect(parsed)) {
    parsed.warnings.push_back(std::move(warning));
  }
  return parsed;
}

std::string ConfigText(const ParsedOptions& parsed) {
  std::string text;
  for (const Option& option : OptionTable()) {
    if (option.takes.empty()) continue;
    const auto given = parsed.given.find(option.name);
    if (given == parsed.given.end()) {
      // A default need not stand in a file, and "none" is no value.
      const ClientPart* const part = TotalOf(absl::StrReplaceAll(option.name, {{"-", "_"}}));
      const std::string value =
          part == nullptr ? option.default_text : absl::StrCat(parsed.options.limits.*part->value);
      absl::StrAppend(&text, "# ", option.name, ": ", value, "  # default",
                      option.default_origin.empty() ? "" : ": ", option.default_origin, "\n");
      continue;
    }
    YAML::Emitter out;
    out << YAML::BeginMap << YAML::Key << option.name << YAML::Value;
    if (option.repeated) {
      out << YAML::Flow << given->second.values;
    } else {
      out << given->second.values.back();
    }
    out << YAML::EndMap;
    // A file does not name another.
    absl::StrAppend(&text, option.name == "config" ? "# " : "", out.c_str(), "  # ",
                    given->second.origin, "\n");
  }
  return text;
}

}  // namespace sightline
