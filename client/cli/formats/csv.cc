// SPDX-License-Identifier: Apache-2.0
#include "client/cli/formats/csv.h"

#include <charconv>
#include <system_error>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "client/cli/formats/file.h"

namespace sightline::cli {
namespace {

// So often one looks whether the rest is still wanted.
constexpr size_t kLinesPerLook = 4096;

bool ParseNumber(absl::string_view text, double* value) {
  if (!text.empty() && text.front() == '+') {
    text.remove_prefix(1);
    if (!text.empty() && (text.front() == '-' || text.front() == '+')) return false;
  }
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), *value);
  if (error == std::errc::result_out_of_range && end == text.data() + text.size()) {
    // Beyond the largest double or below the smallest: infinity or zero, as strtod has it.
    return absl::SimpleAtod(text, value);
  }
  return error == std::errc() && end == text.data() + text.size() && !text.empty();
}

// The fields of a line, without blanks around them and without double quotes about them.
void Split(absl::string_view line, char separator, std::vector<absl::string_view>* fields) {
  fields->clear();
  const auto add = [fields](absl::string_view field) {
    field = absl::StripAsciiWhitespace(field);
    if (field.size() >= 2 && field.front() == '"' && field.back() == '"') {
      field = absl::StripAsciiWhitespace(field.substr(1, field.size() - 2));
    }
    fields->push_back(field);
  };
  if (separator != ' ') {
    while (true) {
      const size_t at = line.find(separator);
      add(line.substr(0, at));
      if (at == absl::string_view::npos) return;
      line.remove_prefix(at + 1);
    }
  }
  while (true) {
    line = absl::StripLeadingAsciiWhitespace(line);
    if (line.empty()) return;
    const size_t end = line.find_first_of(" \t");
    add(line.substr(0, end));
    if (end == absl::string_view::npos) return;
    line.remove_prefix(end);
  }
}

char SeparatorOf(absl::string_view line) {
  if (line.find(';') != absl::string_view::npos) return ';';
  if (line.find(',') != absl::string_view::npos) return ',';
  return ' ';  // Runs of blanks and tabs.
}

std::string Quote(absl::string_view field) {
  constexpr size_t kShown = 40;
  return absl::StrCat("'", absl::CHexEscape(field.substr(0, kShown)),
                      field.size() > kShown ? "..." : "", "'");
}

absl::Status BadLine(const std::string& name, size_t line, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat("'", name, "', line ", line, ": ", what));
}

}  // namespace

absl::StatusOr<CsvTable> ParseCsv(absl::string_view text, const std::string& name,
                                  const CancelToken* cancel) {
  if (text.substr(0, 3) == "\xEF\xBB\xBF") text.remove_prefix(3);  // A byte order mark.
  CsvTable table;
  std::vector<absl::string_view> fields;
  char separator = '\0';
  bool seen_header = false;
  for (size_t line_number = 1; !text.empty(); ++line_number) {
    if (line_number % kLinesPerLook == 0 && cancel != nullptr && cancel->cancelled()) {
      return cancel->ToStatus();
    }
    const size_t end = text.find('\n');
    const absl::string_view line = absl::StripAsciiWhitespace(text.substr(0, end));
    text.remove_prefix(end == absl::string_view::npos ? text.size() : end + 1);
    if (line.empty() || line.front() == '#') continue;
    if (line.find('\0') != absl::string_view::npos) {
      return BadLine(name, line_number, "holds a zero byte; this is no text file");
    }
    const bool first = separator == '\0';
    if (first) separator = SeparatorOf(line);
    Split(line, separator, &fields);

    size_t bad = fields.size();
    for (size_t i = 0; i < fields.size(); ++i) {
      double value = 0;
      if (ParseNumber(fields[i], &value)) {
        table.values.push_back(value);
      } else if (bad == fields.size()) {
        bad = i;
      }
    }
    if (first && !seen_header && table.values.empty()) {
      seen_header = true;
      if (fields.size() > 1) {
        table.header = std::vector<std::string>(fields.begin(), fields.end());
        table.columns = fields.size();
      } else {
        separator = '\0';  // One word says nothing of the separator: the first row does.
      }
      continue;
    }
    if (bad != fields.size()) {
      const bool decimal_comma =
          separator == ';' && fields[bad].find(',') != absl::string_view::npos;
      return BadLine(name, line_number,
                     absl::StrCat("column ", bad + 1, " is ", Quote(fields[bad]), ", not a number",
                                  decimal_comma ? "; write decimals with a point" : ""));
    }
    if (table.columns == 0) table.columns = fields.size();
    if (fields.size() != table.columns) {
      return BadLine(name, line_number,
                     absl::StrCat(fields.size(), " columns; the lines above have ", table.columns));
    }
    ++table.rows;
  }
  if (table.rows == 0) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", name, "': the file holds no row of numbers"));
  }
  return table;
}

absl::StatusOr<CsvTable> ReadCsv(const std::string& path, const CancelToken* cancel) {
  absl::StatusOr<std::string> text = ReadFile(path, cancel);
  if (!text.ok()) return text.status();
  return ParseCsv(*text, path, cancel);
}

}  // namespace sightline::cli
