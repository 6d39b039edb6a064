// SPDX-License-Identifier: Apache-2.0
//
// How figures are printed: a table for people, or one JSON object per line.
//
// A Report is a list of rows; a row is an ordered JSON object. The table shows the columns that it
// is told to, with headings and formats of its own; JSON shows everything.
//
// Thread safety: none.
//
//   Report report(columns, /*json=*/false, std::cout);
//   report.Add({{"scene", "bunny.ply"}, {"ratio", 3.2}});
//   report.Finish();
#ifndef SIGHTLINE_TESTS_BENCH_REPORT_H_
#define SIGHTLINE_TESTS_BENCH_REPORT_H_

#include <functional>
#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <vector>

namespace sightline::bench {

using Row = nlohmann::ordered_json;

struct Column {
  std::string heading;
  std::function<std::string(const Row&)> text;
  bool left = false;  // Words are set left, numbers right.
};

// Formats of a key's value.
Column TextColumn(std::string heading, std::string key);
Column CountColumn(std::string heading, std::string key);                 // 1 443 509
Column NumberColumn(std::string heading, std::string key, int decimals);  // 3.21
Column MegaColumn(std::string heading, std::string key);                  // 12.3 of 12300000
// "3.21 (3.05..3.30)" of key, key_min and key_max.
Column SpreadColumn(std::string heading, std::string key);

class Report {
 public:
  Report(std::vector<Column> columns, bool json, std::ostream& out)
      : columns_(std::move(columns)), json_(json), out_(out) {}

  // JSON goes out at once.
  void Add(Row row);
  // The table, if it is one; nothing if there is no row.
  void Finish();
  const std::vector<Row>& rows() const { return rows_; }

 private:
  const std::vector<Column> columns_;
  const bool json_;
  std::ostream& out_;
  std::vector<Row> rows_;
};

// The geometric mean of a key over rows. REQUIRES: there are rows, all values > 0.
double GeometricMean(const std::vector<Row>& rows, const std::string& key);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_REPORT_H_
