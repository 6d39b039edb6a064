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
    digits.insert(static_cast<size_t>(at), 1, ' ');
  }
  return digits;
}

// A row's picture size, or what stands for it.
std::string SizeText(const Row& row, const std::string& none, const std::string& before = "") {
  if (!row.contains("width")) return none;
  return absl::StrCat(before, row.at("width").get<uint64_t>(), "x",
                      row.at("height").get<uint64_t>());
}

// Whether all rows have the key, and a value for it.
bool AllHave(const std::vector<const Row*>& rows, const std::string& key) {
  return std::all_of(rows.begin(), rows.end(), [&key](const Row* row) {
    return row->contains(key) && !row->at(key).is_null();
  });
}

// What rows of one workload and size, each of another scene, have in common: sums of what is
// counted, and what is the same in all. A rate or a ratio of all of them there is none.
Row AllScenes(const std::vector<const Row*>& rows) {
  Row line = {{"scene", "all"}};
  for (const char* key : {"views", "queries", "disagreements", "disagreements_beyond_rounding"}) {
    if (!AllHave(rows, key)) continue;
    uint64_t sum = 0;
    for (const Row* row : rows) sum += row->at(key).get<uint64_t>();
    line[key] = sum;
  }
  for (const char* key : {"workload", "threads", "isa", "strategy", "peer", "peer_mode"}) {
    if (!AllHave(rows, key)) continue;
    const Row& first = rows[0]->at(key);
    const auto same = [&](const Row* row) { return row->at(key) == first; };
    if (std::all_of(rows.begin(), rows.end(), same)) line[key] = first;
  }
  line["scenes"] = rows.size();
  return WithCommonKeys(line);
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

const std::vector<std::string> kCommonKeys = {"workload",
                                              "scene",
                                              "triangles",
                                              "views",
                                              "queries",
                                              "threads",
                                              "isa",
                                              "strategy",
                                              "rate_per_s",
                                              "peer",
                                              "peer_mode",
                                              "peer_rate_per_s",
                                              "ratio",
                                              "ratio_min",
                                              "ratio_max",
                                              "disagreements",
                                              "disagreements_beyond_rounding"};

Row WithCommonKeys(const Row& row) {
  Row whole = Row::object();
  for (const std::string& key : kCommonKeys) whole[key] = row.contains(key) ? row.at(key) : Row();
  for (const auto& [key, value] : row.items()) whole[key] = value;
  return whole;
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

absl::Status RunScenes(const std::vector<std::string>& scenes, Report* report, std::ostream& err,
                       const std::function<absl::Status(const std::string& scene)>& run) {
  absl::Status first;
  for (const std::string& scene : scenes) {
    const absl::Status status = run(scene);
    if (status.ok()) continue;
    err << scene << ": " << status.message() << std::endl;
    first.Update(status);
  }
  report->Finish();
  return first;
}

Column SizeColumn(std::string heading) {
  return {std::move(heading), [](const Row& row) { return SizeText(row, "-"); }};
}

Column SceneColumn(std::string heading) {
  return {std::move(heading),
          [](const Row& row) {
            const auto scene = row.at("scene").get<std::string>();
            return row.contains("view")
                       ? absl::StrCat(scene, ", view ", row.at("view").get<size_t>())
                       : scene;
          },
          /*left=*/true};
}

void PrintOverScenes(const std::vector<Row>& rows, const std::string& key, bool json,
                     std::ostream& out) {
  std::vector<std::vector<const Row*>> groups;  // In the order in which they came.
  for (const Row& row : rows) {
    if (row.contains("view")) continue;
    const auto alike = [&row](const std::vector<const Row*>& group) {
      return group[0]->at("workload") == row.at("workload") &&
             SizeText(*group[0], "") == SizeText(row, "");
    };
    const auto group = std::find_if(groups.begin(), groups.end(), alike);
    if (group == groups.end()) {
      groups.push_back({&row});
    } else {
      group->push_back(&row);
    }
  }
  for (const std::vector<const Row*>& group : groups) {
    if (group.size() < 2) continue;
    double sum = 0;
    const Row* worst = group[0];
    for (const Row* row : group) {
      const auto value = row->at(key).get<double>();
      sum += std::log(value);
      if (value < worst->at(key).get<double>()) worst = row;
    }
    const double mean = std::exp(sum / static_cast<double>(group.size()));
    const auto workload = worst->at("workload").get<std::string>();
    const auto scene = worst->at("scene").get<std::string>();
    if (!json) {
      out << absl::StrFormat(
          "%s%s: over %d scenes the geometric mean of the %s is %.2f, the worst "
          "%.2f (%s)\n",
          workload, SizeText(*worst, "", " at "), group.size(), key, mean,
          worst->at(key).get<double>(), scene);
      continue;
    }
    Row line = AllScenes(group);
    if (worst->contains("width")) {
      line["width"] = worst->at("width");
      line["height"] = worst->at("height");
    }
    line[absl::StrCat(key, "_geometric_mean")] = mean;
    line[absl::StrCat(key, "_worst")] = worst->at(key);
    line["worst_scene"] = scene;
    out << line.dump() << std::endl;
  }
}

}  // namespace sightline::bench
