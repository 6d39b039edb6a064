// SPDX-License-Identifier: Apache-2.0
//
// A service level objective: "p99=20ms,p50=5ms,errors=0.1%". Latencies are those from the planned
// time. Clauses:
//
//   pN=DURATION       N from 0 to 100, such as p50 or p99.9; mean= and max= likewise
//   errors=SHARE      failed requests of all, as 0.1% or 0.001; without this clause: none
//   rate=N            answers per second, at least
//
// An objective also wants at least one answer.
//
// Thread safety: plain values.
//
//   SL_ASSIGN_OR_RETURN(Slo slo, ParseSlo("p99=20ms,errors=0.1%"));
//   bool held = Held(slo.Judge(measured));
#ifndef SIGHTLINE_CLIENT_LOAD_SLO_H_
#define SIGHTLINE_CLIENT_LOAD_SLO_H_

#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/load/measurement.h"

namespace sightline::load {

struct SloClause {
  enum class Metric { kPercentile, kMean, kMax, kErrors, kRate };
  Metric metric = Metric::kPercentile;
  double percent = 0;  // Of kPercentile.
  double limit = 0;    // Seconds, a share from 0 to 1, or answers per second.
  std::string name;    // "p99"
};

struct SloResult {
  SloClause clause;
  double value = 0;  // In the limit's unit.
  bool held = false;
};

class Slo {
 public:
  Slo() = default;
  explicit Slo(std::vector<SloClause> clauses) : clauses_(std::move(clauses)) {}

  // Without a clause nothing was asked for.
  bool empty() const { return clauses_.empty(); }
  std::span<const SloClause> clauses() const { return clauses_; }
  std::vector<SloResult> Judge(const Measurement& measured) const;

 private:
  std::vector<SloClause> clauses_;
};

// Whether every clause held; an empty objective does.
bool Held(std::span<const SloResult> results);
// "p99 12.3 ms of 20 ms", "errors 0.2 % of 0.1 %", "rate 190/s of 200/s".
std::string DescribeSlo(const SloResult& result);

// INVALID_ARGUMENT naming the clause and what it may be. Adds errors=0 where errors are not named.
absl::StatusOr<Slo> ParseSlo(absl::string_view text);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_SLO_H_
