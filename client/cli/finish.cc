// SPDX-License-Identifier: Apache-2.0
#include "client/cli/finish.h"

#include <exception>
#include <new>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "client/cli/exit_code.h"

namespace sightline::cli {

absl::Status WithoutExceptions(absl::FunctionRef<absl::Status()> run) {
  try {
    return run();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory");
  } catch (const std::exception& e) {
    return absl::InternalError(absl::StrCat("unexpected exception: ", e.what()));
  }
}

int Finish(absl::Status status, absl::string_view name, std::ostream& out, std::ostream& err) {
  if (status.ok()) {
    out.flush();
    if (out.good()) return kExitOk;
    status =
        WithExitCode(absl::DataLossError("standard output cannot be written"), kExitCannotCreate);
  }
  // One line, whatever the message holds.
  err << name << ": "
      << absl::StrReplaceAll(std::string(status.message()), {{"\n", " "}, {"\r", " "}});
  const ExitCode code = ToExitCode(status);
  // `sightline` alone lists commands in its message.
  if (code == kExitUsage && name != "sightline") err << " (see " << name << " --help)";
  err << '\n';
  err.flush();
  return code;
}

int RunAndFinish(absl::string_view name, std::ostream& out, std::ostream& err,
                 absl::FunctionRef<absl::Status()> run) {
  return Finish(WithoutExceptions(run), name, out, err);
}

}  // namespace sightline::cli
