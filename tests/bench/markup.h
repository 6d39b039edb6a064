// SPDX-License-Identifier: Apache-2.0
//
// Reads the markup that reports are written in, to tell what tests find in it from what breaks it:
// XML's elements, as SVG has them, by Expat, and Markdown's tables. Of these no more than reports
// write: tables that begin and end each line with a bar.
//
// Invariants: what is returned without an error is well-formed.
// Thread safety: functions only.
//
//   SL_ASSIGN_OR_RETURN(const std::vector<XmlElement> svg, ParseXml("<svg><rect x=\"1\"/></svg>"));
//   svg[1].Number("x");  // 1
#ifndef SIGHTLINE_TESTS_BENCH_MARKUP_H_
#define SIGHTLINE_TESTS_BENCH_MARKUP_H_

#include <string>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace sightline::bench {

struct XmlElement {
  std::string name;
  std::string text;  // What stands directly within it.
  absl::flat_hash_map<std::string, std::string> attributes;

  // Of the attribute; NaN where there is none, or it is no number.
  double Number(absl::string_view attribute) const;
};

// In the order in which they begin. InvalidArgument names what is wrong, and where.
absl::StatusOr<std::vector<XmlElement>> ParseXml(absl::string_view text);

// The cells of one table's lines, without the rule between the first and the others; all lines have
// as many.
using MarkdownTable = std::vector<std::vector<std::string>>;

// All there are. InvalidArgument names the line that breaks its table.
absl::StatusOr<std::vector<MarkdownTable>> ParseMarkdownTables(absl::string_view text);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_MARKUP_H_
