// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/report.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace sightline::bench {
namespace {

std::string Grouped(uint64_t value) {
  std::string digits = absl::StrCat(value);
  for (int64_t at = static_cast<int64_t>(digits.size()) - 3; at > 0; at -= 3) {
    digits.insert(static_cast<size_t>(at), " ");
  }
  return digits;
}

}  // namespace

Column TextColumn(std::string heading, std::string key) {
  return {std::move(heading), [key](const Row& row) { return row.at(key).get<std::string>(); },
          /*left=*/true};
}

Column CountColumn(std::string heading, std::string key) {
  return {std::move(heading), [key](const Row& row) { return Grouped(row.at(key)); }};
}

Column NumberColumn(std::string heading, std::string key, int decimals) {
  return {std::move(heading), [key, decimals](const Row& row) {
            return absl::StrFormat("%.*f", decimals, row.at(key).get<double>());
          }};
}

Column MegaColumn(std::string heading, std::string key) {
  return {std::move(heading), [key](const Row& row) {
            return absl::StrFormat("%.1f", row.at(key).get<double>() * 1e-6);
          }};
}

Column SpreadColumn(std::string heading, std::string key) {
  return {std::move(heading), [key](const Row& row) {
            return absl::StrFormat("%.2f (%.2f..%.2f)", row.at(key).get<double>(),
                                   row.at(key + "_min").get<double>(),
                                   row.at(key + "_max").get<double>());
          }};
}

void Report::Add(Row row) {
  if (json_) out_ << row.dump() << std::endl;
  rows_.push_back(std::move(row));
}

void Report::Finish() {
  if (json_ || rows_.empty()) return;
  std::vector<std::vector<std::string>> lines(1);
  for (const Column& column : columns_) lines[0].push_back(column.heading);
  for (const Row& row : rows_) {
    lines.emplace_back();
    for (const Column& column : columns_) lines.back().push_back(column.text(row));
  }
  std::vector<size_t> widths(columns_.size(), 0);
  for (const auto& line : lines) {
    for (size_t c = 0; c < line.size(); ++c) widths[c] = std::max(widths[c], line[c].size());
  }
  for (const auto& line : lines) {
    std::string text;
    for (size_t c = 0; c < line.size(); ++c) {
      const std::string blanks(widths[c] - line[c].size(), ' ');
      absl::StrAppend(&text, c == 0 ? "" : "  ",
                      columns_[c].left ? line[c] + blanks : blanks + line[c]);
    }
    text.erase(text.find_last_not_of(' ') + 1);
    out_ << text << '\n';
  }
  out_.flush();
}

double GeometricMean(const std::vector<Row>& rows, const std::string& key) {
  double sum = 0;
  for (const Row& row : rows) sum += std::log(row.at(key).get<double>());
  return std::exp(sum / static_cast<double>(rows.size()));
}

}  // namespace sightline::bench
