// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/command.h"

#include <algorithm>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/exit_code.h"
#include "core/base/status_macros.h"
#include "core/mesh/builtin/builtin.h"

namespace sightline::bench {

absl::StatusOr<bool> ParseOrHelp(cli::FlagSet* flags, std::span<const std::string> args,
                                 Context& context) {
  SL_ASSIGN_OR_RETURN(const std::vector<std::string> words, flags->Parse(args));
  if (flags->help_requested()) {
    context.out << flags->Help()
                << "\nA scene is a mesh file (also .xz and .gz), or builtin:NAME[:TRIANGLES] with "
                   "NAME one of\n";
    for (const BuiltinInfo& info : BuiltinScenes()) {
      context.out << absl::StrFormat("  %-10s %s\n", std::string(info.name),
                                     std::string(info.description));
    }
    return false;
  }
  if (!words.empty()) {
    return cli::UsageError(absl::StrCat("takes flags alone; got '", words.front(), "'"));
  }
  return true;
}

void RegisterQuick(cli::FlagSet* flags, bool* quick) {
  flags->Switch(
      "quick", "see that it runs: a repetition is one pass, however short; the figures say nothing",
      quick);
}

void RegisterThreads(cli::FlagSet* flags, uint64_t* threads) {
  flags->Count("threads", "N", "threads of each side; 0: one per hardware thread", threads, 0,
               1000);
}

int ResolveThreads(uint64_t threads) {
  if (threads > 0) return static_cast<int>(threads);
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

void RegisterIsa(cli::FlagSet* flags, std::string* isa) {
  flags->Choice("isa", {"best", "avx2", "avx512"},
                "instruction set of the engine, and the widest that the peer may use", isa);
}

absl::StatusOr<SimdTarget> ResolveIsa(const std::string& isa) {
  const SimdTarget target = isa == "avx2"     ? SimdTarget::kAvx2
                            : isa == "avx512" ? SimdTarget::kAvx512
                                              : BestSimdTarget();
  if (!SimdTargetAvailable(target)) {
    return absl::FailedPreconditionError(
        absl::StrCat("this machine has no ", SimdTargetName(target), "; leave --isa out"));
  }
  return target;
}

}  // namespace sightline::bench
