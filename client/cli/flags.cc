// SPDX-License-Identifier: Apache-2.0
#include "client/cli/flags.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/cli/exit_code.h"
#include "core/base/edit_distance.h"

namespace sightline::cli {

absl::StatusOr<Vec3d> ParsePoint(absl::string_view text) {
  const std::vector<std::string> parts = absl::StrSplit(text, ',');
  Vec3d point;
  for (int i = 0; i < 3; ++i) {
    if (parts.size() != 3 || !absl::SimpleAtod(parts[static_cast<size_t>(i)], &point[i]) ||
        !std::isfinite(point[i])) {
      return absl::InvalidArgumentError("wants three finite numbers X,Y,Z");
    }
  }
  return point;
}

void FlagSet::Switch(std::string name, std::string help, bool* target) {
  Add({.name = std::move(name),
       .help = std::move(help),
       .default_text = *target ? "on" : "off",
       .is_switch = true,
       .parse = [target](const std::string& text) -> absl::Status {
         if (!absl::SimpleAtob(text, target)) {
           return absl::InvalidArgumentError("wants true or false, or no value at all");
         }
         return absl::OkStatus();
       }});
}

void FlagSet::Text(std::string name, std::string value, std::string help, std::string* target) {
  Custom(std::move(name), std::move(value), std::move(help), target->empty() ? "none" : *target,
         [target](const std::string& text) -> absl::Status {
           if (text.empty()) return absl::InvalidArgumentError("wants a value that is not empty");
           *target = text;
           return absl::OkStatus();
         });
}

void FlagSet::Texts(std::string name, std::string value, std::string help,
                    std::vector<std::string>* target) {
  Custom(std::move(name), std::move(value), std::move(help) + "; may be repeated", "none",
         [target](const std::string& text) -> absl::Status {
           if (text.empty()) return absl::InvalidArgumentError("wants a value that is not empty");
           target->push_back(text);
           return absl::OkStatus();
         });
}

void FlagSet::Number(std::string name, std::string value, std::string help, double* target) {
  Custom(std::move(name), std::move(value), std::move(help), absl::StrCat(*target),
         [target](const std::string& text) -> absl::Status {
           double number = 0;
           if (!absl::SimpleAtod(text, &number) || !std::isfinite(number)) {
             return absl::InvalidArgumentError("wants a finite number");
           }
           *target = number;
           return absl::OkStatus();
         });
}

void FlagSet::Count(std::string name, std::string value, std::string help, uint64_t* target,
                    uint64_t smallest, uint64_t largest) {
  Custom(std::move(name), std::move(value), std::move(help), absl::StrCat(*target),
         [=](const std::string& text) -> absl::Status {
           uint64_t number = 0;
           if (!absl::SimpleAtoi(text, &number) || number < smallest || number > largest) {
             return absl::InvalidArgumentError(
                 absl::StrCat("wants a whole number from ", smallest, " to ", largest));
           }
           *target = number;
           return absl::OkStatus();
         });
}

void FlagSet::Point(std::string name, std::string help, std::optional<Vec3d>* target) {
  Custom(std::move(name), "X,Y,Z", std::move(help), "",
         [target](const std::string& text) -> absl::Status {
           absl::StatusOr<Vec3d> point = ParsePoint(text);
           if (!point.ok()) return point.status();
           *target = *point;
           return absl::OkStatus();
         });
}

void FlagSet::Points(std::string name, std::string help, std::vector<Vec3d>* target) {
  Custom(std::move(name), "X,Y,Z", std::move(help) + "; may be repeated", "",
         [target](const std::string& text) -> absl::Status {
           absl::StatusOr<Vec3d> point = ParsePoint(text);
           if (!point.ok()) return point.status();
           target->push_back(*point);
           return absl::OkStatus();
         });
}

void FlagSet::Choice(std::string name, std::vector<std::string> choices, std::string help,
                     std::string* target) {
  std::string value = absl::StrJoin(choices, "|");
  Custom(std::move(name), std::move(value), std::move(help), *target,
         [target, choices = std::move(choices)](const std::string& text) -> absl::Status {
           for (const std::string& choice : choices) {
             if (absl::AsciiStrToLower(choice) == absl::AsciiStrToLower(text)) {
               *target = choice;
               return absl::OkStatus();
             }
           }
           return absl::InvalidArgumentError(
               absl::StrCat("wants one of ", absl::StrJoin(choices, ", ")));
         });
}

void FlagSet::Custom(std::string name, std::string value, std::string help,
                     std::string default_text,
                     std::function<absl::Status(const std::string&)> parse) {
  Add({.name = std::move(name),
       .value = std::move(value),
       .help = std::move(help),
       .default_text = std::move(default_text),
       .parse = std::move(parse)});
}

FlagSet::Flag* FlagSet::Find(absl::string_view name) {
  const auto found =
      std::find_if(flags_.begin(), flags_.end(), [&](const Flag& f) { return f.name == name; });
  return found == flags_.end() ? nullptr : &*found;
}

bool FlagSet::given(absl::string_view name) const {
  return std::any_of(flags_.begin(), flags_.end(),
                     [&](const Flag& f) { return f.name == name && f.given; });
}

std::string FlagSet::Nearest(absl::string_view name) const {
  std::vector<std::string> names;
  for (const Flag& flag : flags_) names.push_back(flag.name);
  return NearestWord(name, names);
}

absl::StatusOr<std::vector<std::string>> FlagSet::Parse(std::span<const std::string> args) {
  // --help wins over every mistake beside it.
  for (const std::string& arg : args) {
    if (arg == "--") break;
    if (arg == "--help" || arg == "-h") {
      help_requested_ = true;
      return std::vector<std::string>();
    }
  }
  std::vector<std::string> words;
  for (size_t i = 0; i < args.size(); ++i) {
    const std::string& arg = args[i];
    if (arg == "--") {
      words.insert(words.end(), args.begin() + static_cast<ptrdiff_t>(i) + 1, args.end());
      break;
    }
    if (arg.size() < 2 || arg[0] != '-') {
      words.push_back(arg);
      continue;
    }
    const size_t dashes = arg[1] == '-' ? 2 : 1;
    const size_t equals = arg.find('=');
    std::string name = arg.substr(dashes, equals == std::string::npos ? equals : equals - dashes);
    Flag* flag = dashes == 2 ? Find(name) : nullptr;
    bool negated = false;
    if (flag == nullptr && dashes == 2 && name.substr(0, 3) == "no-") {
      flag = Find(name.substr(3));
      negated = flag != nullptr && flag->is_switch && equals == std::string::npos;
      if (!negated) flag = nullptr;
    }
    if (flag == nullptr) {
      const std::string nearest = Nearest(name);
      return UsageError(absl::StrCat("unknown flag ", absl::CHexEscape(arg.substr(0, equals)),
                                     nearest.empty() ? "" : "; did you mean --", nearest));
    }
    std::string value;
    if (equals != std::string::npos) {
      value = arg.substr(equals + 1);
    } else if (flag->is_switch) {
      value = negated ? "false" : "true";
    } else if (i + 1 < args.size()) {
      value = args[++i];
    } else {
      return UsageError(absl::StrCat("--", name, " wants a value (", flag->value, ")"));
    }
    if (absl::Status s = flag->parse(value); !s.ok()) {
      return UsageError(
          absl::StrCat("--", name, " ", s.message(), "; got '", absl::CHexEscape(value), "'"));
    }
    flag->given = true;
  }
  return words;
}

namespace {

// Words in lines of at most `width` columns, lines after the first indented.
std::string Wrap(absl::string_view text, size_t indent, size_t width) {
  std::string out;
  size_t column = indent;
  for (absl::string_view word : absl::StrSplit(text, ' ')) {
    if (column > indent && column + 1 + word.size() > width) {
      absl::StrAppend(&out, "\n", std::string(indent, ' '));
      column = indent;
    }
    if (column > indent) {
      out += ' ';
      ++column;
    }
    absl::StrAppend(&out, word);
    column += word.size();
  }
  return out;
}

}  // namespace

std::string FlagSet::Help() const {
  constexpr size_t kIndent = 8, kWidth = 96;
  std::string out = absl::StrCat("Usage: ", usage_, "\n\n", description_, "\n");
  if (headings_.empty() || headings_.front().first != 0) out += "\nFlags:\n";
  auto heading = headings_.begin();
  for (size_t i = 0; i < flags_.size(); ++i) {
    for (; heading != headings_.end() && heading->first == i; ++heading) {
      absl::StrAppend(&out, "\n", heading->second, ":\n");
    }
    const Flag& flag = flags_[i];
    absl::StrAppend(&out, "  --", flag.name, flag.value.empty() ? "" : " ", flag.value, "\n",
                    std::string(kIndent, ' '));
    const std::string text = flag.default_text.empty()
                                 ? flag.help
                                 : absl::StrCat(flag.help, " (default: ", flag.default_text, ")");
    absl::StrAppend(&out, Wrap(text, kIndent, kWidth), "\n");
  }
  return out;
}

}  // namespace sightline::cli
