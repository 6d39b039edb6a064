// SPDX-License-Identifier: Apache-2.0
//
// sightline-bench: the engine against its peer, and against itself. See `sightline-bench --help`.
#include <exception>
#include <iostream>
#include <new>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/exit_code.h"
#include "tests/bench/command.h"

namespace sightline::bench {
namespace {

struct Entry {
  const char* name;
  const char* summary;
  Command run;
};

constexpr Entry kCommands[] = {
    {"embree", "rays per second against Embree, by workload and scene", EmbreeCommand},
    {"auto", "what AUTO chooses against every strategy and structure there is", AutoCommand},
    {"build", "build times, build and one picture, bytes per triangle against Embree",
     BuildCommand},
    {"scaling", "what more threads gain, as a share of an arithmetic loop's gain", ScalingCommand},
    {"verify", "soak: the strategies against each other, a walk of its own and brute force",
     VerifyCommand},
    {"service", "rays per CPU second through gRPC against in process; latency of a tile",
     ServiceCommand},
    {"papers", "the tables of the papers the engine is built from, ours beside them",
     PapersCommand},
};

std::string GeneralHelp() {
  std::string help =
      "sightline-bench measures the engine and checks it.\n\n"
      "Usage: sightline-bench COMMAND [flags]\n\nCommands:\n";
  for (const Entry& entry : kCommands) {
    absl::StrAppend(&help, absl::StrFormat("  %-8s %s\n", entry.name, entry.summary));
  }
  absl::StrAppend(
      &help,
      "\nsightline-bench COMMAND --help lists a command's flags. Figures go to standard output,\n"
      "progress to standard error. Ends with 0; with 1 where an answer was wrong; else with the\n"
      "codes of sightline --help.\n");
  return help;
}

absl::StatusOr<bool> Dispatch(const std::vector<std::string>& args, Context& context) {
  if (args.empty()) return cli::UsageError("wants a command; see sightline-bench --help");
  if (args[0] == "--help" || args[0] == "-h" || args[0] == "help") {
    context.out << GeneralHelp();
    return true;
  }
  for (const Entry& entry : kCommands) {
    if (args[0] == entry.name) return entry.run(std::span(args).subspan(1), context);
  }
  return cli::UsageError(
      absl::StrCat("unknown command '", args[0], "'; see sightline-bench --help"));
}

int Run(const std::vector<std::string>& args, Context& context) {
  absl::StatusOr<bool> good = true;
  try {
    good = Dispatch(args, context);
  } catch (const std::bad_alloc&) {  // The one boundary at which library exceptions end.
    good = absl::ResourceExhaustedError("out of memory");
  } catch (const std::exception& e) {
    good = absl::InternalError(absl::StrCat("unexpected exception: ", e.what()));
  }
  context.out.flush();
  if (good.ok()) return *good ? cli::kExitOk : 1;
  context.err << "sightline-bench: " << good.status().message() << std::endl;
  return cli::ToExitCode(good.status());
}

}  // namespace
}  // namespace sightline::bench

int main(int argc, char** argv) {
  sightline::bench::Context context{std::cout, std::cerr};
  return sightline::bench::Run(std::vector<std::string>(argv + 1, argv + argc), context);
}
