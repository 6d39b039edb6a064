// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/markup.h"

#include <expat.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "core/base/check.h"

namespace sightline::bench {
namespace {

// One reading of a text, by Expat.
class XmlReader {
 public:
  XmlReader() : parser_(XML_ParserCreate(nullptr)) {
    SIGHTLINE_CHECK(parser_ != nullptr) << "no memory";
    XML_SetUserData(parser_, this);
    XML_SetElementHandler(parser_, &XmlReader::Begin, &XmlReader::End);
    XML_SetCharacterDataHandler(parser_, &XmlReader::Text);
  }
  ~XmlReader() { XML_ParserFree(parser_); }
  XmlReader(const XmlReader&) = delete;
  XmlReader& operator=(const XmlReader&) = delete;

  absl::StatusOr<std::vector<XmlElement>> Read(absl::string_view text) {
    if (XML_Parse(parser_, text.data(), static_cast<int>(text.size()), /*isFinal=*/1) ==
        XML_STATUS_OK) {
      return std::move(elements_);
    }
    return absl::InvalidArgumentError(absl::StrCat(
        XML_ErrorString(XML_GetErrorCode(parser_)), " at '",
        text.substr(std::min(text.size(), static_cast<size_t>(XML_GetCurrentByteIndex(parser_))),
                    40),
        "'"));
  }

 private:
  static void Begin(void* self, const char* name, const char** attributes) {
    XmlReader& reader = *static_cast<XmlReader*>(self);
    XmlElement element{.name = name, .text = {}, .attributes = {}};
    for (; *attributes != nullptr; attributes += 2) {
      element.attributes.emplace(attributes[0], attributes[1]);
    }
    reader.open_.push_back(reader.elements_.size());
    reader.elements_.push_back(std::move(element));
  }
  static void End(void* self, const char*) { static_cast<XmlReader*>(self)->open_.pop_back(); }
  static void Text(void* self, const char* text, int length) {
    XmlReader& reader = *static_cast<XmlReader*>(self);
    reader.elements_[reader.open_.back()].text.append(text, static_cast<size_t>(length));
  }

  const XML_Parser parser_;
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
  return XmlReader().Read(text);
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
