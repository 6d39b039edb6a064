// SPDX-License-Identifier: Apache-2.0
//
// A load test from its options to its report: opens the scene, prepares what is asked and what is
// due, runs, and takes away what it made on the server.
//
// Thread safety: one thread.
//
//   LoadTest test(options, err, is_terminal, &interrupted);
//   SL_RETURN_IF_ERROR(test.Prepare());
//   LoadReport report;
//   SL_RETURN_IF_ERROR(test.Run(&report));
#ifndef SIGHTLINE_CLIENT_LOAD_LOAD_TEST_H_
#define SIGHTLINE_CLIENT_LOAD_LOAD_TEST_H_

#include <atomic>
#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/session.h"
#include "client/lib/cancellation.h"
#include "client/lib/types.h"
#include "client/load/check_source.h"
#include "client/load/clock.h"
#include "client/load/driver.h"
#include "client/load/options.h"
#include "client/load/reference.h"
#include "client/load/reloader.h"
#include "client/load/report.h"
#include "client/load/server_target.h"
#include "client/load/test_scene.h"
#include "client/load/workload.h"
#include "core/base/cancel.h"

namespace sightline::load {

class LoadTest {
 public:
  // `options` must outlive the test and its reports.
  LoadTest(const LoadOptions& options, std::ostream& err, bool is_terminal,
           const std::atomic<bool>* interrupted);
  ~LoadTest();

  // Everything before the first request. Cancelled once `interrupted` is set: calls to the server
  // and the engine's work in this process end within a moment.
  absl::Status Prepare();
  // Searches the knee if that is wanted, then measures. An error of the run is in its status and
  // the report of what there was in `report` nevertheless.
  absl::Status Run(LoadReport* report);

 private:
  absl::Status PrepareAll();
  // A step of the preparation begins: whoever looks on is told, and an interruption heard of.
  void Begin(const std::string& step);
  void HearOfInterruption();
  absl::Status OpenPointSet();
  // Enough for a run of the plan, or all that the server grants.
  absl::Duration LeaseFor(const RunPlan& plan) const;
  absl::Status FindReference();
  // One run of the plan; the target's status.
  absl::Status Measure(const RunPlan& plan, bool until_stable, const std::string& title,
                       Measurement* measured);
  // The same at the report's rate, for the report: with what the server counted meanwhile, its
  // warm-up and what it still answered afterwards among it.
  absl::Status MeasureReported(LoadReport* report);
  // A short run at that rate. Wrong answers end the search, and become what the report is about.
  absl::StatusOr<KneeTrial> Try(double rate, LoadReport* report);
  // Searches the knee, then measures it in full.
  absl::Status RunAtKnee(LoadReport* report);
  bool Interrupted() const { return interrupted_ != nullptr && interrupted_->load(); }

  const LoadOptions& options_;
  std::ostream& err_;
  const bool is_terminal_;
  const std::atomic<bool>* const interrupted_;
  SteadyClock clock_;
  // Of the preparation alone: a run ends by its driver, and calls that tidy up go on.
  client::Cancellation cancelled_calls_;
  CancelToken cancelled_work_;
  // In the order in which they stand on each other.
  std::unique_ptr<cli::Session> session_;
  TestScene scene_;
  std::optional<Workload> workload_;
  std::string metrics_token_;
  client::Capabilities capabilities_;
  std::string point_set_;  // Made for the test; empty: none.
  CheckSource check_;
  std::unique_ptr<Reference> reference_;
  std::unique_ptr<ServerTarget> target_;
  std::unique_ptr<Reloader> reloader_;
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_LOAD_TEST_H_
