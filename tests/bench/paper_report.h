// SPDX-License-Identifier: Apache-2.0
//
// How `sightline-bench papers` prints: tables for people, one JSON object per line, and on request
// a Markdown file with the same tables and SVG plots beside it.
//
// A table's rows are ordered JSON objects with the same keys, which are its columns. Numbers are
// shown with three significant digits, counts whole, null as "-". What could not be measured is
// named in all three. Why a claim does not carry over is our explanation, and is called so: the
// figures show that it does not, and only sometimes why.
//
// Thread safety: none.
//
//   PaperReport report(/*json=*/false, std::cout, "report.md");
//   report.Begin("003", "Table I", "million tests per second");
//   report.Add({{"test", "Wald"}, {"single", 109.2}, {"paper_single", 109}});
//   report.Plot({.x = "ratio", .y = "cycles", .series = "culling"});
//   report.End();
//   absl::Status status = report.Finish();
#ifndef SIGHTLINE_TESTS_BENCH_PAPER_REPORT_H_
#define SIGHTLINE_TESTS_BENCH_PAPER_REPORT_H_

#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "tests/bench/report.h"

namespace sightline::bench {

// One line per value of `series`, over `x`. Rows without a finite number in x (of its logarithm) or
// y are left out. `bars`: x has names, and each name a bar per value of `series`.
struct PlotSpec {
  std::string x, y, series;
  bool log_x = false;
  bool bars = false;
};

// The text of a table's cell.
std::string PaperCell(const Row& value);
// An SVG picture of the rows' lines or bars. REQUIRES: every row has the keys.
std::string PlotSvg(const std::vector<Row>& rows, const PlotSpec& spec, const std::string& title);

// How a claim fares: it holds from kGainBand below the paper's figure on, or kShareBand; in part
// where there is the same effect, but less of it.
enum class Verdict : uint8_t { kHolds, kInPart, kDoesNotHold };
inline constexpr double kGainBand = 0.1;    // Of the figure: clocks, scenes and rounds differ.
inline constexpr double kShareBand = 0.02;  // Of everything that there is.
// Of how many times better something is: no effect is 1.
Verdict VerdictOfGain(double measured, double paper);
// Of a share that is left out or saved: no effect is 0.
Verdict VerdictOfShare(double measured, double paper);

// What a paper says, what was measured, and whether it carries over; if not, why, as we think.
struct PaperClaim {
  std::string what, paper, measured;
  Verdict verdict = Verdict::kDoesNotHold;
  std::string explanation;  // Shown where it does not hold, or in part.
};

class PaperReport {
 public:
  // `markdown_path` empty: no Markdown.
  PaperReport(bool json, std::ostream& out, std::string markdown_path)
      : json_(json), out_(out), markdown_path_(std::move(markdown_path)) {}

  void Begin(std::string paper, std::string title, std::string remark);
  // JSON goes out at once, with "paper", "table" and "remark" in front.
  void Add(Row row);
  void Plot(PlotSpec spec) { plots_.push_back(std::move(spec)); }
  // A sentence below the table that is open: how the paper's claim fared.
  void Conclude(std::string sentence) { conclusions_.push_back(std::move(sentence)); }
  // One of the table that is open; all of them are a table of their own at the end.
  void Claim(PaperClaim claim);
  void End();
  // That something is missing, and why: a scene's file, mostly. REQUIRES: no table is open.
  void NotMeasured(const std::string& paper, const std::string& what, const std::string& why);
  // The table of claims. REQUIRES: none is open.
  void EndClaims();
  // Whether the Markdown file can be written, before hours are spent on it. Creates it.
  absl::Status CheckWritable() const;
  // Writes the Markdown file and its plots. Unavailable names the file that could not be written.
  absl::Status Finish();

 private:
  void EndText() const;
  void EndMarkdown();

  const bool json_;
  std::ostream& out_;
  const std::string markdown_path_;
  std::string paper_, title_, remark_, markdown_;
  std::vector<Row> rows_;
  std::vector<PlotSpec> plots_;
  std::vector<std::string> conclusions_;
  std::vector<Row> claims_;
  std::vector<std::pair<std::string, std::string>> pictures_;  // File names and SVG.
};

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_PAPER_REPORT_H_
