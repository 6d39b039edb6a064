// SPDX-License-Identifier: Apache-2.0
#include "client/load/slo.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/load/plain_number.h"
#include "core/base/status_macros.h"

namespace sightline::load {
namespace {

using Metric = SloClause::Metric;

absl::Status Bad(absl::string_view clause, absl::string_view why) {
  return absl::InvalidArgumentError(absl::StrCat("'", clause, "': ", why));
}

absl::StatusOr<SloClause> ParseClause(absl::string_view text) {
  const std::pair<absl::string_view, absl::string_view> parts =
      absl::StrSplit(text, absl::MaxSplits('=', 1));
  const auto& [name, value] = parts;
  SloClause clause{.name = std::string(name)};
  if (name == "errors") {
    clause.metric = Metric::kErrors;
    const bool percent = absl::EndsWith(value, "%");
    if (!absl::SimpleAtod(absl::StripSuffix(value, "%"), &clause.limit)) clause.limit = -1;
    if (percent) clause.limit /= 100;
    if (!(clause.limit >= 0 && clause.limit <= 1)) {
      return Bad(text, "wants a share from 0 to 1, or from 0% to 100%");
    }
    return clause;
  }
  if (name == "rate") {
    clause.metric = Metric::kRate;
    if (!absl::SimpleAtod(value, &clause.limit) || !(clause.limit > 0) ||
        !std::isfinite(clause.limit)) {
      return Bad(text, "wants answers per second, above 0");
    }
    return clause;
  }
  if (name == "mean") {
    clause.metric = Metric::kMean;
  } else if (name == "max") {
    clause.metric = Metric::kMax;
  } else if (!absl::StartsWith(name, "p") || !absl::SimpleAtod(name.substr(1), &clause.percent) ||
             !(clause.percent >= 0 && clause.percent <= 100)) {
    return Bad(text, "wants p0 to p100, mean, max, errors or rate, then = and a value");
  }
  absl::Duration limit;
  if (!absl::ParseDuration(value, &limit) || limit <= absl::ZeroDuration() ||
      limit == absl::InfiniteDuration()) {
    return Bad(text, "wants a duration above 0, such as 20ms or 1.5s");
  }
  clause.limit = absl::ToDoubleSeconds(limit);
  return clause;
}

// NaN where nothing was measured: it meets no limit.
double ValueOf(const SloClause& clause, const Measurement& measured) {
  const LatencyHistogram& latency = measured.all.planned;
  switch (clause.metric) {
    case Metric::kErrors:
      return measured.all.requests > 0 ? measured.ErrorShare()
                                       : std::numeric_limits<double>::quiet_NaN();
    case Metric::kRate:
      return measured.Rate();
    default:
      break;
  }
  if (latency.count() == 0) return std::numeric_limits<double>::quiet_NaN();
  switch (clause.metric) {
    case Metric::kPercentile:
      return absl::ToDoubleSeconds(latency.PercentileOf(clause.percent));
    case Metric::kMean:
      return absl::ToDoubleSeconds(latency.mean());
    default:
      return absl::ToDoubleSeconds(latency.max());
  }
}

}  // namespace

std::vector<SloResult> Slo::Judge(const Measurement& measured) const {
  std::vector<SloResult> results;
  for (const SloClause& clause : clauses_) {
    SloResult result{.clause = clause, .value = ValueOf(clause, measured)};
    const bool met = clause.metric == Metric::kRate ? result.value >= clause.limit
                                                    : result.value <= clause.limit;
    // What the run gave up on has latencies, and errors may all be allowed.
    result.held = met && measured.all.answered > 0;
    results.push_back(std::move(result));
  }
  return results;
}

bool Held(std::span<const SloResult> results) {
  return std::all_of(results.begin(), results.end(), [](const SloResult& r) { return r.held; });
}

std::string DescribeSlo(const SloResult& result) {
  const SloClause& clause = result.clause;
  if (std::isnan(result.value)) return absl::StrCat(clause.name, ": no answer");
  switch (clause.metric) {
    case Metric::kErrors:
      return absl::StrCat(clause.name, " ", PlainNumber(100 * result.value, 3), " % of ",
                          PlainNumber(100 * clause.limit, 3), " %");
    case Metric::kRate:
      return absl::StrCat(clause.name, " ", PlainNumber(result.value, 4), "/s of ",
                          PlainNumber(clause.limit, 4), "/s");
    default:
      return absl::StrCat(clause.name, " ", MillisecondsText(absl::Seconds(result.value)),
                          " ms of ", MillisecondsText(absl::Seconds(clause.limit)), " ms");
  }
}

absl::StatusOr<Slo> ParseSlo(absl::string_view text) {
  std::vector<SloClause> clauses;
  for (absl::string_view part : absl::StrSplit(text, ',')) {
    SL_ASSIGN_OR_RETURN(SloClause clause, ParseClause(part));
    for (const SloClause& other : clauses) {
      if (other.name == clause.name) return Bad(part, "is named twice");
    }
    clauses.push_back(std::move(clause));
  }
  const bool errors = std::any_of(clauses.begin(), clauses.end(),
                                  [](const SloClause& c) { return c.metric == Metric::kErrors; });
  if (!errors) clauses.push_back({.metric = Metric::kErrors, .name = "errors"});
  return Slo(std::move(clauses));
}

}  // namespace sightline::load
