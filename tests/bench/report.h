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

#include "absl/status/status.h"

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

// The row with every key that rows of all commands have (section 8 of the design), in that order,
// before its others: null where it means nothing of this row.
//   workload, scene, triangles, views, queries, threads, isa, strategy, rate_per_s, peer,
//   peer_mode, peer_rate_per_s, ratio, ratio_min, ratio_max, disagreements,
//   disagreements_beyond_rounding
extern const std::vector<std::string> kCommonKeys;
Row WithCommonKeys(const Row& row);

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

// Runs `run` for each scene, which adds rows, and finishes the report. A scene's error is told to
// `err` and does not keep the next ones from their turn; the first one is returned.
absl::Status RunScenes(const std::vector<std::string>& scenes, Report* report, std::ostream& err,
                       const std::function<absl::Status(const std::string& scene)>& run);

// "1920x1080" of a row's width and height, "-" where it has none.
Column SizeColumn(std::string heading);
// The scene, and the view where the row is of one.
Column SceneColumn(std::string heading);

// How a ratio did over the scenes: for each workload and size that has rows of two scenes or more
// (rows of single views are not counted) its geometric mean and the worst, a line or a JSON object
// each; that has the common keys, too, counts being sums. REQUIRES: values > 0.
void PrintOverScenes(const std::vector<Row>& rows, const std::string& key, bool json,
                     std::ostream& out);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_REPORT_H_
