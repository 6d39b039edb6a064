// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/markup.h"

#include <algorithm>
#include <cctype>
#include <limits>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "core/base/status_macros.h"

namespace sightline::bench {
namespace {

bool IsNamePart(char c) { return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '-'; }

// One reading of a text, from its begin to its end.
class XmlReader {
 public:
  explicit XmlReader(absl::string_view text) : text_(text) {}

  absl::StatusOr<std::vector<XmlElement>> Read() {
    while (at_ < text_.size()) {
      if (Skip("</")) {
        SL_RETURN_IF_ERROR(ReadEnd());
      } else if (Skip("<")) {
        SL_RETURN_IF_ERROR(ReadBegin());
      } else {
        SL_RETURN_IF_ERROR(ReadText());
      }
    }
    if (!open_.empty()) return Wrong(absl::StrCat("no end of ", elements_[open_.back()].name));
    if (elements_.empty()) return Wrong("no element");
    return std::move(elements_);
  }

 private:
  absl::Status Wrong(absl::string_view what) const {
    return absl::InvalidArgumentError(absl::StrCat(what, " at '", text_.substr(at_, 40), "'"));
  }

  bool Skip(absl::string_view word) {
    if (!absl::StartsWith(text_.substr(at_), word)) return false;
    at_ += word.size();
    return true;
  }

  void SkipSpace() {
    while (at_ < text_.size() && absl::ascii_isspace(static_cast<unsigned char>(text_[at_]))) ++at_;
  }

  std::string ReadName() {
    const size_t from = at_;
    while (at_ < text_.size() && IsNamePart(text_[at_])) ++at_;
    return std::string(text_.substr(from, at_ - from));
  }

  // Up to the first of `ends`, of which one must come.
  absl::StatusOr<std::string> ReadUntil(absl::string_view ends) {
    const size_t from = at_;
    at_ = std::min(text_.find_first_of(ends, from), text_.size());
    const absl::string_view read = text_.substr(from, at_ - from);
    for (size_t i = read.find('&'); i != absl::string_view::npos; i = read.find('&', i + 1)) {
      bool known = false;
      for (const absl::string_view entity : {"&amp;", "&lt;", "&gt;", "&quot;", "&apos;"}) {
        known = known || absl::StartsWith(read.substr(i), entity);
      }
      if (!known) return Wrong(absl::StrCat("a bare & in '", read, "',"));
    }
    return std::string(read);
  }

  absl::Status ReadText() {
    SL_ASSIGN_OR_RETURN(const std::string text, ReadUntil("<"));
    if (!open_.empty()) {
      elements_[open_.back()].text += text;
    } else if (!absl::StripAsciiWhitespace(text).empty()) {
      return Wrong(absl::StrCat("text outside all elements, '", text, "',"));
    }
    return absl::OkStatus();
  }

  absl::Status ReadBegin() {
    if (open_.empty() && !elements_.empty()) return Wrong("a second root");
    XmlElement element;
    element.name = ReadName();
    if (element.name.empty()) return Wrong("no name");
    for (SkipSpace(); at_ < text_.size() && IsNamePart(text_[at_]); SkipSpace()) {
      const std::string attribute = ReadName();
      if (!Skip("=\"")) return Wrong(absl::StrCat("no quoted value of ", attribute));
      SL_ASSIGN_OR_RETURN(std::string value, ReadUntil("\"<"));
      if (!Skip("\"")) return Wrong(absl::StrCat("no end of the value of ", attribute));
      if (!element.attributes.emplace(attribute, std::move(value)).second) {
        return Wrong(absl::StrCat("a second ", attribute));
      }
    }
    const bool ends = Skip("/");
    if (!Skip(">")) return Wrong(absl::StrCat("no end of the tag of ", element.name));
    if (!ends) open_.push_back(elements_.size());
    elements_.push_back(std::move(element));
    return absl::OkStatus();
  }

  absl::Status ReadEnd() {
    const std::string name = ReadName();
    if (open_.empty() || elements_[open_.back()].name != name) {
      return Wrong(absl::StrCat("an end of ", name, ", which is not the one that is open,"));
    }
    open_.pop_back();
    return Skip(">") ? absl::OkStatus() : Wrong(absl::StrCat("no end of the end of ", name));
  }

  const absl::string_view text_;
  size_t at_ = 0;
  std::vector<XmlElement> elements_;
  std::vector<size_t> open_;  // Of elements_, from the root down.
};

std::vector<std::string> CellsOf(absl::string_view line) {
  std::vector<std::string> cells;
  std::string cell;
  for (size_t i = 1; i < line.size(); ++i) {
    if (line[i] == '|') {
      cells.emplace_back(absl::StripAsciiWhitespace(std::exchange(cell, std::string())));
    } else {
      // A bar that is marked is the cell's own.
      if (line[i] == '\\' && i + 1 < line.size() && line[i + 1] == '|') ++i;
      cell += line[i];
    }
  }
  return cells;
}

bool IsRule(const std::string& cell) {
  return cell.size() >= 3 &&
         cell.find_first_not_of('-', cell[0] == ':') >= cell.size() - (cell.back() == ':' ? 1 : 0);
}

}  // namespace

double XmlElement::Number(absl::string_view attribute) const {
  const auto found = attributes.find(attribute);
  double value = 0;
  return found != attributes.end() && absl::SimpleAtod(found->second, &value)
             ? value
             : std::numeric_limits<double>::quiet_NaN();
}

absl::StatusOr<std::vector<XmlElement>> ParseXml(absl::string_view text) {
  return XmlReader(text).Read();
}

absl::StatusOr<std::vector<MarkdownTable>> ParseMarkdownTables(absl::string_view text) {
  std::vector<MarkdownTable> tables;
  size_t lines = 0;  // Of the table that is open, its rule among them.
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    const auto wrong = [&](absl::string_view what) {
      return absl::InvalidArgumentError(absl::StrCat(what, " in '", line, "'"));
    };
    if (!absl::StartsWith(line, "|")) {
      if (lines == 1) return wrong("no rule below a table's heads, but what stands");
      lines = 0;
      continue;
    }
    if (line.size() < 2 || line.back() != '|') return wrong("no bar at the end");
    std::vector<std::string> cells = CellsOf(line);
    ++lines;
    if (lines == 1) {
      tables.emplace_back();
    } else if (cells.size() != tables.back()[0].size()) {
      return wrong(absl::StrCat(cells.size(), " cells below ", tables.back()[0].size(), " heads"));
    }
    if (lines == 2) {
      if (!std::all_of(cells.begin(), cells.end(), IsRule)) return wrong("no rule");
      continue;
    }
    tables.back().push_back(std::move(cells));
  }
  if (lines == 1) return absl::InvalidArgumentError("no rule below the last table's heads");
  return tables;
}

}  // namespace sightline::bench
