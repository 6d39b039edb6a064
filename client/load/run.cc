// SPDX-License-Identifier: Apache-2.0
#include "client/load/run.h"

#include <memory>
#include <span>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"
#include "client/cli/commands/command.h"
#include "client/cli/exit_code.h"
#include "client/cli/finish.h"
#include "client/cli/formats/file.h"
#include "client/load/hgrm.h"
#include "client/load/load_test.h"
#include "client/load/options.h"
#include "client/load/plot.h"
#include "client/load/report.h"
#include "core/base/status_macros.h"

namespace sightline::load {
namespace {

using cli::ExitCode;
using cli::WithExitCode;

absl::Status WriteFiles(const LoadReport& report) {
  const LoadOptions& options = *report.options;
  const Measurement& measured = report.measured;
  absl::Status status;
  if (!options.hgrm.empty()) {
    status.Update(cli::WriteFile(options.hgrm, FormatHgrm(measured.all.planned)));
  }
  if (!options.plot.empty()) {
    status.Update(
        WritePlot(options.plot, measured,
                  absl::StrCat(options.scene, "   ", options.workload, "   ", LoopText(report),
                               "   ", measured.all.answered, " answers")));
  }
  return WithExitCode(status, cli::kExitCannotCreate);
}

absl::Status Missed(absl::string_view message) {
  return WithExitCode(absl::FailedPreconditionError(message), static_cast<ExitCode>(kExitMissed));
}

// What a run that went to its end says: nothing, or why its exit code is not 0.
absl::Status Verdict(const LoadReport& report) {
  const Measurement& measured = report.measured;
  if (measured.wrong > 0) {
    return WithExitCode(
        absl::DataLossError(absl::StrCat(measured.wrong, " of ", measured.checked,
                                         " answers are wrong; the first: ", measured.first_wrong)),
        static_cast<ExitCode>(kExitWrong));
  }
  std::string unanswered;
  if (measured.all.answered == 0 && !measured.first_error.ok()) {
    unanswered = absl::StrCat("no request was answered; the first failed with: ",
                              measured.first_error.message());
  }
  // Before why nothing was answered: whoever names an objective wants to hear of that, and a script
  // that tries again what may pass would never end.
  if (!Held(report.slo)) {
    std::vector<std::string> missed;
    for (const SloResult& result : report.slo) {
      if (!result.held) missed.push_back(DescribeSlo(result));
    }
    return Missed(absl::StrCat("the objective was missed: ", absl::StrJoin(missed, ", "),
                               unanswered.empty() ? "" : "; ", unanswered));
  }
  if (report.knee && report.knee->rate == 0) {
    return Missed("no rate that was tried meets the objective");
  }
  if (!unanswered.empty()) return absl::Status(measured.first_error.code(), unanswered);
  return absl::OkStatus();
}

absl::Status Load(const std::vector<std::string>& args, std::ostream& out, std::ostream& err,
                  bool err_is_terminal, const std::atomic<bool>* interrupted) {
  SL_ASSIGN_OR_RETURN(const std::unique_ptr<LoadOptions> options, ParseOptions(args, out));
  if (options == nullptr) return absl::OkStatus();
  SL_RETURN_IF_ERROR(cli::CheckOutputs({options->hgrm, options->plot}));
  LoadTest test(*options, err, err_is_terminal, interrupted);
  SL_RETURN_IF_ERROR(test.Prepare());
  LoadReport report;
  const absl::Status status = test.Run(&report);
  // A run that broke off is told as far as it came, and so is a search.
  const bool measured = report.measured.all.requests > 0 || status.ok();
  if (measured || report.measured_nothing()) PrintReport(report, options->output, out);
  const absl::Status written = measured ? WriteFiles(report) : absl::OkStatus();
  if (report.measured.wrong > 0) {
    // Whatever else failed: nobody may take the answers for right.
    if (!written.ok()) err << "warning: " << written.message() << '\n';
    return Verdict(report);
  }
  SL_RETURN_IF_ERROR(written);
  SL_RETURN_IF_ERROR(status);
  return Verdict(report);
}

}  // namespace

int RunLoad(const std::vector<std::string>& args, std::ostream& out, std::ostream& err,
            bool err_is_terminal, const std::atomic<bool>* interrupted) {
  return cli::RunAndFinish("sightline-load", out, err,
                           [&] { return Load(args, out, err, err_is_terminal, interrupted); });
}

}  // namespace sightline::load
