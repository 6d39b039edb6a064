// SPDX-License-Identifier: Apache-2.0
#include "client/load/report.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "client/cli/commands/command.h"
#include "client/cli/progress.h"
#include "client/load/plain_number.h"

namespace sightline::load {
namespace {

using cli::GroupedCount;
using cli::HumanCount;
using cli::Json;
using Rows = std::vector<std::pair<std::string, std::string>>;

// The most server metrics that the page shows; JSON has all.
constexpr size_t kMetricsShown = 40;

double Milliseconds(absl::Duration duration) { return absl::ToDoubleMilliseconds(duration); }

std::string PercentName(double percent) { return absl::StrCat("p", percent); }

// ---- Text

std::string ServerText(const LoadReport& report) {
  const std::string& address = report.options->session.server;
  return absl::StrCat(address.empty() ? "in this process" : address, ", version ",
                      report.server.version, ", ", report.server.instruction_set, ", ",
                      report.server.threads, " threads");
}

std::string WorkloadText(const LoadReport& report) {
  const LoadOptions& o = *report.options;
  if (o.workload != "mixed") return o.workload;
  std::vector<std::string> parts;
  for (size_t i = 0; i < kKinds; ++i) {
    if (o.mix[i] > 0) parts.push_back(absl::StrCat(kKindNames[i], " ", o.mix[i]));
  }
  return absl::StrCat("mixed: ", absl::StrJoin(parts, ", "));
}

std::string StabilityText(const Stability& stability) {
  if (!std::isfinite(stability.rate_spread) || !std::isfinite(stability.latency_spread)) {
    return absl::StrCat("not known: fewer than ", kStableWindows, " windows with answers");
  }
  return absl::StrFormat("%s: the last %d windows differ by %.1f %% in rate, %.1f %% in median",
                         stability.stable ? "stable" : "NOT STABLE", kStableWindows,
                         100 * stability.rate_spread, 100 * stability.latency_spread);
}

std::string RequestsText(const Series& all) {
  std::string text = absl::StrCat(GroupedCount(all.requests), ", ", GroupedCount(all.answered),
                                  " answered, ", GroupedCount(all.failed), " failed");
  if (all.unsent > 0) {
    absl::StrAppend(&text, ", of them ", GroupedCount(all.unsent), " never sent");
  }
  return text;
}

std::string RefusalWaitText(const LoadReport& report) {
  const Measurement& m = report.measured;
  const double whole =
      absl::ToDoubleSeconds(m.elapsed) * static_cast<double>(report.options->plan.concurrency);
  const double waited = absl::ToDoubleSeconds(m.refusal_wait);
  return absl::StrCat(GroupedCount(m.refusal_waits), " times after a refusal, ",
                      absl::StrFormat("%.2f s together, %.1f %% of the loop's time", waited,
                                      whole > 0 ? 100 * waited / whole : 0.0));
}

std::string CheckText(const LoadReport& report) {
  const Measurement& m = report.measured;
  std::string text = absl::StrCat(
      GroupedCount(m.checked), " answers",
      report.options->plan.warm_up > absl::ZeroDuration() ? ", the warm-up's too, " : ", ",
      GroupedCount(m.wrong), " wrong; ");
  switch (report.check.by) {
    case CheckSource::By::kNothing:
      return "nothing (--check none)";
    case CheckSource::By::kEngine:
      return absl::StrCat(text, "by the engine in this process on ", report.check.what);
    case CheckSource::By::kServer:
      break;
  }
  return absl::StrCat(text, "by the server itself with ", report.check.what);
}

std::string LatencyRow(const char* name, const LatencyHistogram& h) {
  std::string row = absl::StrFormat("%-18s", name);
  for (const double percent : kReportedPercentiles) {
    absl::StrAppend(&row, absl::StrFormat(" %9.3f", Milliseconds(h.PercentileOf(percent))));
  }
  absl::StrAppend(&row,
                  absl::StrFormat(" %9.3f %9.3f\n", Milliseconds(h.max()), Milliseconds(h.mean())));
  return row;
}

std::string LatencyTable(const Measurement& m) {
  std::string text = absl::StrFormat("\n%-18s", "latency, ms");
  for (const double percent : kReportedPercentiles) {
    absl::StrAppend(&text, absl::StrFormat(" %9s", PercentName(percent)));
  }
  absl::StrAppend(&text, absl::StrFormat(" %9s %9s\n", "max", "mean"));
  absl::StrAppend(&text, LatencyRow("from the plan", m.all.planned));
  absl::StrAppend(&text, LatencyRow("from the send", m.all.sent));
  size_t kinds = 0;
  for (const Series& series : m.by_kind) kinds += series.requests > 0 ? 1 : 0;
  for (size_t i = 0; i < kKinds && kinds > 1; ++i) {
    if (m.by_kind[i].requests > 0) {
      absl::StrAppend(&text, LatencyRow(absl::StrCat("  ", kKindNames[i], ", plan").c_str(),
                                        m.by_kind[i].planned));
    }
  }
  if (m.server_compute.count() > 0) {
    absl::StrAppend(&text, LatencyRow("server's queue", m.server_queue),
                    LatencyRow("server's compute", m.server_compute));
  }
  return text;
}

std::string KneeText(const Knee& knee, bool interrupted) {
  std::string text = "\nrate/s    answered/s     p50 ms     p99 ms\n";
  bool whole = false;
  for (const KneeTrial& trial : knee.trials) {
    absl::StrAppend(
        &text, absl::StrFormat("%-9s %10s %10.3f %10.3f  %s%s\n", PlainNumber(trial.rate, 4),
                               PlainNumber(trial.answered, 4), trial.p50, trial.p99,
                               trial.held ? "held" : "missed", trial.whole ? ", in full" : ""));
    whole = whole || trial.whole;
  }
  // The last run of a search that came to its end held in full.
  const bool found = !knee.trials.empty() && knee.trials.back().whole && knee.trials.back().held;
  const bool cut = interrupted && !found;
  if (cut) text += "interrupted before the knee was known; by then ";
  if (knee.rate == 0) {
    return absl::StrCat(text, "no rate met the objective", whole ? " in full" : "", "\n");
  }
  const char* const name = found ? "knee: " : cut ? "trials of " : "knee, by trials alone: ";
  absl::StrAppend(&text, name, PlainNumber(knee.rate, 4),
                  cut ? " requests/s met the objective" : " requests/s meet the objective");
  if (knee.missed > 0) {
    absl::StrAppend(&text, ", ", PlainNumber(knee.missed, 4), cut ? " did not" : " do not");
  }
  return absl::StrCat(text, "\n");
}

// Counts in full, "1,047,060"; what is no count as short as may be.
std::string SampleText(double value) {
  constexpr double kExact = 1e15;  // Doubles hold every whole number up to here.
  if (value == std::floor(value) && std::abs(value) < kExact) {
    return absl::StrCat(value < 0 ? "-" : "", GroupedCount(static_cast<uint64_t>(std::abs(value))));
  }
  return std::abs(value) < 1000 ? PlainNumber(value, 4) : HumanCount(value);
}

// What Prometheus has in seconds, people read in milliseconds.
std::string MeanText(const std::string& name, double mean) {
  return absl::StrContains(name, "_seconds_count")
             ? absl::StrCat(MillisecondsText(absl::Seconds(mean)), " ms")
             : PlainNumber(mean, 3);
}

std::string MetricsText(const LoadReport& report) {
  if (!report.server_metrics_error.empty()) {
    return absl::StrCat("\nserver's metrics: ", report.server_metrics_error, "\n");
  }
  if (report.server_metrics.empty()) return "";
  std::string text = "\nserver's metrics during the run\n";
  size_t shown = 0;
  for (const auto& [name, change] : report.server_metrics) {
    if (name.find("_sum") != std::string::npos) continue;  // With its count.
    if (++shown > kMetricsShown) {
      absl::StrAppend(&text, "  and more: --output json has all\n");
      break;
    }
    const double grown = change.after - change.before;
    const char* const sign = grown < 0 ? "" : "+";
    const auto sum = report.server_metrics.find(absl::StrReplaceAll(name, {{"_count", "_sum"}}));
    if (name.find("_count") != std::string::npos && sum != report.server_metrics.end()) {
      const double mean = (sum->second.after - sum->second.before) / grown;
      absl::StrAppend(&text, absl::StrFormat("  %-58s %s%s, mean %s\n",
                                             absl::StrReplaceAll(name, {{"_count", ""}}), sign,
                                             SampleText(grown), MeanText(name, mean)));
    } else {
      absl::StrAppend(&text, absl::StrFormat("  %-58s %s%s, now %s\n", name, sign,
                                             SampleText(grown), SampleText(change.after)));
    }
  }
  return text;
}

void PrintText(const LoadReport& report, std::ostream& out) {
  const Measurement& m = report.measured;
  const LoadOptions& o = *report.options;
  Rows rows = {{"server", ServerText(report)},
               {"scene", absl::StrCat(o.scene, ", ", GroupedCount(report.triangles), " triangles")},
               {"asked", WorkloadText(report)},
               {"load", absl::StrCat(LoopText(report), "; ", o.session.connections,
                                     " connections, ", report.streams, " streams")}};
  if (report.measured_nothing()) {
    rows.emplace_back("measured", "nothing in full: interrupted");
    cli::PrintTable(rows, out);
    if (report.knee) out << KneeText(*report.knee, report.interrupted);
    return;
  }
  const Rows measured = {
      {"measured",
       absl::StrFormat("%.2f s after %.2f s of warm-up%s", absl::ToDoubleSeconds(m.elapsed),
                       absl::ToDoubleSeconds(o.plan.warm_up),
                       report.interrupted ? ": interrupted" : "")},
      {"windows", StabilityText(report.stability)},
      {"requests", RequestsText(m.all)},
      {"answers/s", PlainNumber(m.Rate(), 4)},
      {"rays/s", HumanCount(m.PerSecond(m.all.rays_in_time))},
      {"bytes/s", absl::StrCat(HumanCount(m.PerSecond(m.all.bytes_received_in_time)), " received, ",
                               HumanCount(m.PerSecond(m.all.bytes_sent_in_time)), " sent")}};
  rows.insert(rows.end(), measured.begin(), measured.end());
  for (const auto& [name, count] : m.errors)
    rows.emplace_back("failed", absl::StrCat(GroupedCount(count), " ", name));
  if (m.all.given_up() > 0) {
    rows.emplace_back("given up", absl::StrCat(GroupedCount(m.all.given_up()),
                                               " of them at the end; latencies from ",
                                               "the plan have what they had waited by then"));
  }
  if (m.refusal_waits > 0) rows.emplace_back("held back", RefusalWaitText(report));
  rows.emplace_back("checked", CheckText(report));
  if (m.wrong > 0) rows.emplace_back("first wrong", m.first_wrong);
  if (report.reloads) {
    rows.emplace_back(
        report.reloads->by == ReloadBy::kEdit ? "edits" : "reloads",
        absl::StrCat(report.reloads->changes, ", p50 ",
                     MillisecondsText(report.reloads->latency.PercentileOf(50)), " ms, max ",
                     MillisecondsText(report.reloads->latency.max()), " ms"));
  }
  for (const SloResult& result : report.slo) {
    rows.emplace_back("objective",
                      absl::StrCat(DescribeSlo(result), result.held ? ": held" : ": MISSED"));
  }
  cli::PrintTable(rows, out);
  out << LatencyTable(m);
  if (report.knee) out << KneeText(*report.knee, report.interrupted);
  out << MetricsText(report);
}

// ---- JSON

Json LatencyJson(const LatencyHistogram& h) {
  Json json;
  json["count"] = h.count();
  json["mean"] = Milliseconds(h.mean());
  json["min"] = Milliseconds(h.min());
  for (const double percent : kReportedPercentiles) {
    json[PercentName(percent)] = Milliseconds(h.PercentileOf(percent));
  }
  json["max"] = Milliseconds(h.max());
  return json;
}

Json SeriesJson(const Measurement& m, const Series& series) {
  Json json;
  json["requests"] = series.requests;
  json["answered"] = series.answered;
  json["failed"] = series.failed;
  json["unsent"] = series.unsent;
  json["given_up"] = series.given_up();
  json["answers_per_s"] = m.PerSecond(series.answered_in_time);
  json["rays_per_s"] = m.PerSecond(series.rays_in_time);
  json["bytes_received_per_s"] = m.PerSecond(series.bytes_received_in_time);
  json["bytes_sent_per_s"] = m.PerSecond(series.bytes_sent_in_time);
  json["latency_planned_ms"] = LatencyJson(series.planned);
  json["latency_sent_ms"] = LatencyJson(series.sent);
  return json;
}

Json Finite(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json KneeJson(const Knee& knee) {
  Json json;
  json["rate_per_s"] = knee.rate;
  json["missed_per_s"] = knee.missed > 0 ? Json(knee.missed) : Json(nullptr);
  json["trials"] = Json::array();
  for (const KneeTrial& trial : knee.trials) {
    json["trials"].push_back({{"rate_per_s", trial.rate},
                              {"answers_per_s", trial.answered},
                              {"p50_ms", trial.p50},
                              {"p99_ms", trial.p99},
                              {"held", trial.held},
                              {"in_full", trial.whole}});
  }
  return json;
}

Json MainJson(const LoadReport& report) {
  const Measurement& m = report.measured;
  const LoadOptions& o = *report.options;
  Json json;
  json["server"] = {{"address", o.session.server.empty() ? Json(nullptr) : Json(o.session.server)},
                    {"version", report.server.version},
                    {"instruction_set", report.server.instruction_set},
                    {"threads", report.server.threads}};
  json["scene"] = o.scene;
  json["scene_name"] = report.scene_name;
  json["triangles"] = report.triangles;
  json["workload"] = o.workload;
  for (size_t i = 0; i < kKinds; ++i) json["mix"][kKindNames[i]] = o.mix[i];
  json["mode"] = o.plan.mode == Mode::kOpen ? "open" : "closed";
  if (o.plan.mode == Mode::kOpen) {
    json["arrivals"] = o.plan.arrivals == Arrivals::kPoisson ? "poisson" : "constant";
    json["rate_per_s"] = report.rate;
  } else {
    json["concurrency"] = o.plan.concurrency;
    json["refusal_waits"] = {{"count", m.refusal_waits},
                             {"total_s", absl::ToDoubleSeconds(m.refusal_wait)}};
  }
  json["connections"] = o.session.connections;
  json["streams"] = report.streams;
  json["seed"] = o.plan.seed;
  json["warm_up_s"] = absl::ToDoubleSeconds(o.plan.warm_up);
  json["interrupted"] = report.interrupted;
  json["measured_s"] = absl::ToDoubleSeconds(m.elapsed);
  json["stable"] = report.stability.stable;
  json["rate_spread"] = Finite(report.stability.rate_spread);
  json["latency_spread"] = Finite(report.stability.latency_spread);
  json["all"] = SeriesJson(m, m.all);
  for (size_t i = 0; i < kKinds; ++i) {
    if (m.by_kind[i].requests > 0) json["by_kind"][kKindNames[i]] = SeriesJson(m, m.by_kind[i]);
  }
  json["errors"] = Json::object();
  for (const auto& [name, count] : m.errors) json["errors"][name] = count;
  json["check_by"] = report.check.by == CheckSource::By::kEngine   ? Json("engine")
                     : report.check.by == CheckSource::By::kServer ? Json("server")
                                                                   : Json(nullptr);
  json["check_with"] = report.check.what;
  json["checked"] = m.checked;
  json["wrong"] = m.wrong;
  if (m.wrong > 0) json["first_wrong"] = m.first_wrong;
  json["server_queue_ms"] = LatencyJson(m.server_queue);
  json["server_compute_ms"] = LatencyJson(m.server_compute);
  return json;
}

void PrintJson(const LoadReport& report, std::ostream& out) {
  Json json = MainJson(report);
  if (report.reloads) {
    const bool edits = report.reloads->by == ReloadBy::kEdit;
    json[edits ? "edits" : "reloads"] = report.reloads->changes;
    json[edits ? "edit_latency_ms" : "reload_latency_ms"] = LatencyJson(report.reloads->latency);
  }
  if (!report.slo.empty()) {
    json["slo_held"] = Held(report.slo);
    json["slo"] = Json::array();
    for (const SloResult& result : report.slo) {
      const bool seconds = result.clause.metric != SloClause::Metric::kErrors &&
                           result.clause.metric != SloClause::Metric::kRate;
      const double scale = seconds ? 1000 : 1;
      json["slo"].push_back({{"clause", result.clause.name},
                             {"unit", seconds                                            ? "ms"
                                      : result.clause.metric == SloClause::Metric::kRate ? "1/s"
                                                                                         : "share"},
                             {"value", Finite(scale * result.value)},
                             {"limit", scale * result.clause.limit},
                             {"held", result.held}});
    }
  }
  if (report.knee) json["knee"] = KneeJson(*report.knee);
  for (const auto& [name, change] : report.server_metrics) {
    json["server_metrics"][name] = {{"before", Finite(change.before)},
                                    {"after", Finite(change.after)}};
  }
  if (!report.server_metrics_error.empty()) {
    json["server_metrics_error"] = report.server_metrics_error;
  }
  // A file's name may be any bytes, and so may what a server says of its metrics.
  out << json.dump(2, ' ', /*ensure_ascii=*/false, Json::error_handler_t::replace) << '\n';
}

// ---- CSV

// What a row says, of a window or of the run.
struct CsvRow {
  std::string name;
  double seconds = 0;
  uint64_t answered = 0, failed = 0, rays = 0, bytes_received = 0, bytes_sent = 0;
  const LatencyHistogram& planned;
  const LatencyHistogram& sent;
  const CodeCounts& failed_by_code;
};

void PrintCsvHeader(std::ostream& out) {
  out << "window,seconds,answered,failed,rays";
  for (const double percent : kReportedPercentiles) out << ',' << PercentName(percent) << "_ms";
  out << ",max_ms,mean_ms";
  for (const double percent : kReportedPercentiles) {
    out << ",sent_" << PercentName(percent) << "_ms";
  }
  out << ",sent_max_ms,sent_mean_ms,bytes_received,bytes_sent";
  for (size_t code = 1; code < kCodes; ++code) {
    out << ",failed_"
        << absl::AsciiStrToLower(absl::StatusCodeToString(static_cast<absl::StatusCode>(code)));
  }
  out << '\n';
}

void PrintCsvRow(const CsvRow& row, std::ostream& out) {
  out << absl::StrFormat("%s,%.6g,%d,%d,%d", row.name, row.seconds, row.answered, row.failed,
                         row.rays);
  for (const LatencyHistogram* latency : {&row.planned, &row.sent}) {
    for (const double percent : kReportedPercentiles) {
      out << absl::StrFormat(",%.6g", Milliseconds(latency->PercentileOf(percent)));
    }
    out << absl::StrFormat(",%.6g,%.6g", Milliseconds(latency->max()),
                           Milliseconds(latency->mean()));
  }
  out << ',' << row.bytes_received << ',' << row.bytes_sent;
  for (size_t code = 1; code < kCodes; ++code) out << ',' << row.failed_by_code[code];
  out << '\n';
}

void PrintCsv(const LoadReport& report, std::ostream& out) {
  const Measurement& m = report.measured;
  PrintCsvHeader(out);
  const double seconds = absl::ToDoubleSeconds(m.window);
  for (size_t i = 0; i < m.windows.size(); ++i) {
    const Window& w = m.windows[i];
    PrintCsvRow({absl::StrCat(i), seconds, w.answered, w.failed, w.rays, w.bytes_received,
                 w.bytes_sent, w.planned, w.sent, w.failed_by_code},
                out);
  }
  PrintCsvRow({"all", absl::ToDoubleSeconds(m.elapsed), m.all.answered, m.all.failed,
               m.all.rays_in_time, m.all.bytes_received_in_time, m.all.bytes_sent_in_time,
               m.all.planned, m.all.sent, m.failed_by_code},
              out);
}

}  // namespace

std::string LoopText(const LoadReport& report) {
  const RunPlan& plan = report.options->plan;
  if (plan.mode == Mode::kClosed)
    return absl::StrCat("closed loop, ", plan.concurrency, " at once");
  return absl::StrCat("open loop, ", plan.arrivals == Arrivals::kPoisson ? "poisson" : "constant",
                      ", ", PlainNumber(report.rate, 4), "/s");
}

void PrintReport(const LoadReport& report, const std::string& output, std::ostream& out) {
  if (output == "json") {
    PrintJson(report, out);
  } else if (output == "csv") {
    PrintCsv(report, out);
  } else {
    PrintText(report, out);
  }
}

}  // namespace sightline::load
