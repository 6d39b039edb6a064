// SPDX-License-Identifier: Apache-2.0
#include "client/cli/exit_code.h"

#include <string>
#include <utility>

#include "absl/strings/cord.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "client/lib/status.h"

namespace sightline::cli {
namespace {

constexpr char kExitCodeUrl[] = "sightline.cli/exit_code";

}  // namespace

absl::string_view ExitCodeHelp() {
  return "Exit codes:\n"
         "  0   done\n"
         "  64  the command line makes no sense\n"
         "  65  a file or a value is bad, or passes a limit of the server\n"
         "  66  a file cannot be read, there is no such scene, or the server denies access\n"
         "  69  the server cannot be reached (trying again may help)\n"
         "  70  internal error\n"
         "  73  an output file cannot be written\n"
         "  75  the server was busy, time ran out, or a signal came (trying again may help)\n"
         "  78  this processor cannot run it\n";
}

absl::Status WithExitCode(absl::Status status, ExitCode code) {
  if (!status.ok()) status.SetPayload(kExitCodeUrl, absl::Cord(absl::StrCat(code)));
  return status;
}

absl::Status UsageError(absl::string_view message) {
  return WithExitCode(absl::InvalidArgumentError(message), kExitUsage);
}

ExitCode ToExitCode(const absl::Status& status) {
  if (const auto payload = status.GetPayload(kExitCodeUrl)) {
    int code = kExitInternal;
    if (absl::SimpleAtoi(std::string(*payload), &code)) return static_cast<ExitCode>(code);
  }
  switch (status.code()) {
    case absl::StatusCode::kOk:
      return kExitOk;
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kOutOfRange:
    case absl::StatusCode::kDataLoss:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kAlreadyExists:
    case absl::StatusCode::kUnimplemented:
      return kExitData;
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kPermissionDenied:
    case absl::StatusCode::kUnauthenticated:
      return kExitNoInput;
    case absl::StatusCode::kUnavailable:
      return kExitUnavailable;
    case absl::StatusCode::kResourceExhausted:
      return client::IsRetryable(status) ? kExitTemporary : kExitData;
    case absl::StatusCode::kDeadlineExceeded:
    case absl::StatusCode::kAborted:
    case absl::StatusCode::kCancelled:
      return kExitTemporary;
    default:
      return kExitInternal;
  }
}

bool MayComeOfInterruption(const absl::Status& status) {
  const ExitCode code = ToExitCode(status);
  return absl::IsCancelled(status) || code == kExitTemporary || code == kExitUnavailable;
}

}  // namespace sightline::cli
