// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/paper_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"

namespace sightline::bench {
namespace {

constexpr double kWidth = 640, kHeight = 360, kLeft = 60, kRight = 170, kTop = 30, kBottom = 54;
// As many as there are series of bars in one picture, at most: these are told apart by them alone.
constexpr std::array<const char*, 10> kColours = {"#1b6ca8", "#c0392b", "#2e8b57", "#8e44ad",
                                                  "#d68910", "#16a085", "#7f8c8d", "#2c3e50",
                                                  "#e377c2", "#8c564b"};
constexpr std::array kDashes = {"none", "6 3", "2 3"};
// Of the names beside the plot: what the piece of line before them takes, and a letter at most.
constexpr double kSample = 34, kLetter = 7;
// Of the marks below it: a row's height.
constexpr double kRow = 14;

std::string Escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '<') {
      out += "&lt;";
    } else if (c == '&') {
      out += "&amp;";
    } else {
      out += c;
    }
  }
  return out;
}

struct Line {
  std::string name;
  std::vector<std::pair<double, double>> points;
};

double NumberOf(const Row& value) {
  return value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN();
}

// `names`: of the places of bars, in their order.
std::vector<Line> LinesOf(const std::vector<Row>& rows, const PlotSpec& spec,
                          std::vector<std::string>* names) {
  std::vector<Line> lines;
  for (const Row& row : rows) {
    const double y = NumberOf(row.at(spec.y));
    double x = 0;
    if (!std::isfinite(y)) continue;  // No place in the picture, here and below.
    if (spec.bars) {
      const auto place = std::find(names->begin(), names->end(), PaperCell(row.at(spec.x)));
      x = static_cast<double>(place - names->begin());
      if (place == names->end()) names->push_back(PaperCell(row.at(spec.x)));
    } else {
      x = NumberOf(row.at(spec.x));
      if (spec.log_x) x = std::log10(x);
      if (!std::isfinite(x)) continue;
    }
    const std::string name = PaperCell(row.at(spec.series));
    auto line = std::find_if(lines.begin(), lines.end(),
                             [&](const Line& other) { return other.name == name; });
    if (line == lines.end()) line = lines.insert(lines.end(), {name, {}});
    line->points.emplace_back(x, y);
  }
  return lines;
}

// What lies between: from values to places in the picture.
struct Frame {
  double x0 = 0, x1 = 1, y1 = 1;
  double X(double x) const { return kLeft + (x - x0) / (x1 - x0) * (kWidth - kLeft - kRight); }
  double Y(double y) const { return kHeight - kBottom - y / y1 * (kHeight - kTop - kBottom); }
};

// The title, what stands beside the axes, and a line for each quarter of y.
std::string OpenSvg(double width, const Frame& frame, const PlotSpec& spec,
                    const std::string& title) {
  std::string svg = absl::StrFormat(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%.0f\" height=\"%.0f\" "
      "font-family=\"sans-serif\" font-size=\"11\">\n<rect width=\"100%%\" height=\"100%%\" "
      "fill=\"white\"/>\n<text x=\"%.0f\" y=\"16\" font-size=\"13\">%s</text>\n",
      width, kHeight, kLeft, Escaped(title));
  for (int i = 0; i <= 4; ++i) {
    const double y = frame.y1 * i / 4;
    absl::StrAppend(
        &svg,
        absl::StrFormat("<line x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\" stroke=\"#ddd\"/>\n",
                        kLeft, kWidth - kRight, frame.Y(y), frame.Y(y)),
        absl::StrFormat("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"end\">%s</text>\n", kLeft - 6,
                        frame.Y(y) + 4, PaperCell(y)));
  }
  absl::StrAppend(&svg, absl::StrFormat("<text x=\"%.1f\" y=\"%.1f\">%s, over %s</text>\n", kLeft,
                                        kHeight - 6, Escaped(spec.y), Escaped(spec.x)));
  return svg;
}

std::string MarkX(double x, size_t row, const std::string& text) {
  return absl::StrFormat("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"middle\">%s</text>\n", x,
                         kHeight - kBottom + kRow * static_cast<double>(row + 1), Escaped(text));
}

const char* Colour(size_t line) { return kColours[line % kColours.size()]; }
// Where colours come again, they come dashed.
const char* Dashes(size_t line) { return kDashes[line / kColours.size() % kDashes.size()]; }

// Its name beside the plot, behind a piece of line.
std::string NameLine(size_t line, const std::string& name) {
  const double y = kTop + 12 + 16 * static_cast<double>(line);
  return absl::StrCat(
      absl::StrFormat("<line x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\" stroke=\"%s\" "
                      "stroke-width=\"2\" stroke-dasharray=\"%s\"/>\n",
                      kWidth - kRight + 10, kWidth - kRight + kSample, y - 4, y - 4, Colour(line),
                      Dashes(line)),
      absl::StrFormat("<text x=\"%.1f\" y=\"%.1f\" fill=\"%s\">%s</text>\n",
                      kWidth - kRight + kSample + 6, y, Colour(line), Escaped(name)));
}

double WidthFor(const std::vector<Line>& lines) {
  size_t longest_name = 0;
  for (const Line& line : lines) longest_name = std::max(longest_name, line.name.size());
  return std::max(kWidth,
                  kWidth - kRight + 20 + kSample + kLetter * static_cast<double>(longest_name));
}

std::string Polyline(const Line& line, size_t number, const Frame& frame) {
  std::string points;
  for (const auto& [x, y] : line.points) {
    absl::StrAppend(&points, absl::StrFormat("%.1f,%.1f ", frame.X(x), frame.Y(y)));
  }
  return absl::StrFormat(
      "<polyline points=\"%s\" fill=\"none\" stroke=\"%s\" stroke-width=\"2\" "
      "stroke-dasharray=\"%s\"/>\n",
      points, Colour(number), Dashes(number));
}

// Those of one of `count` lines, beside the others' at every place.
std::string Bars(const Line& line, size_t number, size_t count, const Frame& frame) {
  const double width = 0.8 / static_cast<double>(count);
  std::string bars;
  for (const auto& [x, y] : line.points) {
    const double left = frame.X(x - 0.4 + width * static_cast<double>(number));
    absl::StrAppend(
        &bars,
        absl::StrFormat(
            "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"%s\"/>\n", left,
            frame.Y(y), frame.X(x - 0.4 + width * static_cast<double>(number + 1)) - left,
            frame.Y(0) - frame.Y(y), Colour(number)));
  }
  return bars;
}

// A cell ends at a bar, so one of its own is marked as such.
std::string MarkdownCell(const std::string& text) {
  return absl::StrReplaceAll(text, {{"|", "\\|"}});
}

// From the table's title to a file name.
std::string Slug(const std::string& text) {
  std::string slug;
  for (const char c : text) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9');
    const bool upper = c >= 'A' && c <= 'Z';
    if (plain || upper) {
      slug += static_cast<char>(upper ? c + ('a' - 'A') : c);
    } else if (!slug.empty() && slug.back() != '-') {
      slug += '-';
    }
  }
  return slug;
}

absl::Status Write(const std::filesystem::path& path, const std::string& text,
                   std::ios::openmode mode) {
  std::ofstream file(path, std::ios::binary | mode);
  file << text;
  file.close();
  if (!file.fail()) return absl::OkStatus();
  return absl::UnavailableError(
      absl::StrCat("cannot write '", path.string(), "'; its folder must exist, and be writable"));
}

const char* VerdictName(Verdict verdict) {
  return verdict == Verdict::kHolds ? "yes" : verdict == Verdict::kInPart ? "in part" : "no";
}

}  // namespace

Verdict VerdictOfGain(double measured, double paper) {
  // The band of a small gain reaches below 1: a loss is never one.
  const bool holds = measured >= (1 - kGainBand) * paper && (measured > 1 || paper <= 1);
  return holds ? Verdict::kHolds : measured > 1 ? Verdict::kInPart : Verdict::kDoesNotHold;
}

Verdict VerdictOfShare(double measured, double paper) {
  return measured >= paper - kShareBand ? Verdict::kHolds
         : measured > 0                 ? Verdict::kInPart
                                        : Verdict::kDoesNotHold;
}

std::string PaperCell(const Row& value) {
  if (value.is_null()) return "-";
  if (value.is_string()) return value.get<std::string>();
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (value.is_number_integer()) return absl::StrCat(value.get<int64_t>());
  const double x = value.get<double>();
  const double size = std::abs(x);
  if (size != 0 && (size < 1e-3 || size >= 1e7)) return absl::StrFormat("%.2e", x);
  return absl::StrFormat("%.*f", size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3, x);
}

std::string PlotSvg(const std::vector<Row>& rows, const PlotSpec& spec, const std::string& title) {
  std::vector<std::string> names;  // Of bars' places.
  const std::vector<Line> lines = LinesOf(rows, spec, &names);
  double x0 = std::numeric_limits<double>::infinity(), x1 = -x0, y1 = 0;
  for (const Line& line : lines) {
    for (const auto& [x, y] : line.points) {
      x0 = std::min(x0, x);
      x1 = std::max(x1, x);
      y1 = std::max(y1, y);
    }
  }
  if (spec.bars) {
    x0 = -0.5;
    x1 = static_cast<double>(names.size()) - 0.5;
  }
  if (lines.empty()) x0 = 0;
  if (!(x1 > x0)) x1 = x0 + 1;
  const Frame frame = {x0, x1, y1 > 0 ? y1 : 1};
  std::string svg = OpenSvg(WidthFor(lines), frame, spec, title);
  // Names take turns in two rows: long ones would run into their neighbours.
  for (size_t i = 0; i < names.size(); ++i) {
    absl::StrAppend(&svg, MarkX(frame.X(static_cast<double>(i)), i % 2, names[i]));
  }
  for (int i = 0; i <= 4 && !spec.bars; ++i) {
    const double x = x0 + (x1 - x0) * i / 4;
    absl::StrAppend(&svg, MarkX(frame.X(x), 0, PaperCell(spec.log_x ? std::pow(10, x) : x)));
  }
  for (size_t i = 0; i < lines.size(); ++i) {
    absl::StrAppend(
        &svg, spec.bars ? Bars(lines[i], i, lines.size(), frame) : Polyline(lines[i], i, frame));
    absl::StrAppend(&svg, NameLine(i, lines[i].name));
  }
  return svg + "</svg>\n";
}

void PaperReport::Begin(std::string paper, std::string title, std::string remark) {
  paper_ = std::move(paper);
  title_ = std::move(title);
  remark_ = std::move(remark);
  rows_.clear();
  plots_.clear();
  conclusions_.clear();
}

void PaperReport::Add(Row row) {
  if (json_) {
    Row line = {{"paper", paper_}, {"table", title_}, {"remark", remark_}};
    for (const auto& [key, value] : row.items()) line[key] = value;
    out_ << line.dump() << std::endl;
  }
  rows_.push_back(std::move(row));
}

void PaperReport::Claim(PaperClaim claim) {
  claims_.push_back(
      {{"paper", paper_},
       {"table", title_},
       {"claim", std::move(claim.what)},
       {"the paper's", std::move(claim.paper)},
       {"measured", std::move(claim.measured)},
       {"carries over", VerdictName(claim.verdict)},
       {"our explanation", claim.verdict == Verdict::kHolds ? "" : std::move(claim.explanation)}});
}

void PaperReport::NotMeasured(const std::string& paper, const std::string& what,
                              const std::string& why) {
  if (json_) {
    out_ << Row({{"paper", paper}, {"not measured", what}, {"why", why}}).dump() << std::endl;
  } else {
    out_ << "\nPaper " << paper << ", not measured: " << what << " (" << why << ")\n";
  }
  absl::StrAppend(&markdown_, "Paper ", paper, ", not measured: ", what, " (", why, ")\n\n");
}

void PaperReport::EndClaims() {
  if (claims_.empty()) return;
  Begin("all", "what carries over",
        absl::StrFormat("the papers' claims, each with what was measured here; yes: from %.0f %% "
                        "below the paper's gain on, or %.0f points below its share; in part: the "
                        "same effect, but less of it; explanations are ours, not measured",
                        100 * kGainBand, 100 * kShareBand));
  for (Row& claim : claims_) {
    // Its own paper and table, not this one's.
    if (json_) out_ << claim.dump() << std::endl;
    rows_.push_back(std::move(claim));
  }
  claims_.clear();
  End();
}

void PaperReport::End() {
  if (json_) {
    for (const std::string& sentence : conclusions_) {
      out_ << Row({{"paper", paper_}, {"table", title_}, {"conclusion", sentence}}).dump()
           << std::endl;
    }
  } else {
    EndText();
  }
  if (!markdown_path_.empty()) EndMarkdown();
}

void PaperReport::EndText() const {
  out_ << "\nPaper " << paper_ << ", " << title_ << ": " << remark_ << "\n\n";
  if (!rows_.empty()) {
    std::vector<Column> columns;
    for (const auto& [key, value] : rows_[0].items()) {
      columns.push_back(
          {key, [key = key](const Row& row) { return PaperCell(row.at(key)); }, value.is_string()});
    }
    Report table(std::move(columns), /*json=*/false, out_);
    for (const Row& row : rows_) table.Add(row);
    table.Finish();
  }
  for (const std::string& sentence : conclusions_) out_ << sentence << '\n';
  out_.flush();
}

void PaperReport::EndMarkdown() {
  absl::StrAppend(&markdown_, "## Paper ", paper_, ", ", title_, "\n\n", remark_, "\n\n");
  if (!rows_.empty()) {
    std::string heads("|"), rule("|");
    for (const auto& [key, value] : rows_[0].items()) {
      absl::StrAppend(&heads, " ", MarkdownCell(key), " |");
      absl::StrAppend(&rule, value.is_string() ? "---|" : "--:|");
    }
    absl::StrAppend(&markdown_, heads, "\n", rule, "\n");
    for (const Row& row : rows_) {
      absl::StrAppend(&markdown_, "|");
      for (const auto& [key, value] : row.items()) {
        absl::StrAppend(&markdown_, " ", MarkdownCell(PaperCell(value)), " |");
      }
      absl::StrAppend(&markdown_, "\n");
    }
    absl::StrAppend(&markdown_, "\n");
  }
  for (const PlotSpec& plot : plots_) {
    const std::string stem = std::filesystem::path(markdown_path_).stem().string();
    const std::string name =
        absl::StrCat(stem, "-", paper_, "-", Slug(title_), "-", Slug(plot.y), ".svg");
    pictures_.emplace_back(name, PlotSvg(rows_, plot, absl::StrCat(paper_, ", ", title_)));
    absl::StrAppend(&markdown_, "![", plot.y, " over ", plot.x, "](", name, ")\n\n");
  }
  for (const std::string& sentence : conclusions_) absl::StrAppend(&markdown_, sentence, "\n\n");
}

absl::Status PaperReport::CheckWritable() const {
  if (markdown_path_.empty()) return absl::OkStatus();
  return Write(markdown_path_, "", std::ios::app);
}

absl::Status PaperReport::Finish() {
  if (markdown_path_.empty()) return absl::OkStatus();
  const std::filesystem::path path(markdown_path_);
  absl::Status status =
      Write(path, absl::StrCat("# The papers' tables, and ours beside them\n\n", markdown_),
            std::ios::trunc);
  for (const auto& [name, svg] : pictures_) {
    if (status.ok()) status = Write(path.parent_path() / name, svg, std::ios::trunc);
  }
  return status;
}

}  // namespace sightline::bench
