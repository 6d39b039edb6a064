// SPDX-License-Identifier: Apache-2.0
//
// The subcommands of sightline-bench: functions of their words.
//
// Thread safety: none; one command runs in a process.
#ifndef SIGHTLINE_TESTS_BENCH_COMMAND_H_
#define SIGHTLINE_TESTS_BENCH_COMMAND_H_

#include <cstdint>
#include <ostream>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/flags.h"
#include "core/traverse/simd_target.h"

namespace sightline::bench {

struct Context {
  std::ostream& out;  // Figures.
  std::ostream& err;  // Progress and warnings.
};

// Whether what was measured is as it should be: false ends the process with code 1.
using Command = absl::StatusOr<bool> (*)(std::span<const std::string> args, Context& context);

absl::StatusOr<bool> EmbreeCommand(std::span<const std::string> args, Context& context);
absl::StatusOr<bool> AutoCommand(std::span<const std::string> args, Context& context);
absl::StatusOr<bool> BuildCommand(std::span<const std::string> args, Context& context);
absl::StatusOr<bool> ScalingCommand(std::span<const std::string> args, Context& context);
absl::StatusOr<bool> VerifyCommand(std::span<const std::string> args, Context& context);
absl::StatusOr<bool> ServiceCommand(std::span<const std::string> args, Context& context);
absl::StatusOr<bool> PapersCommand(std::span<const std::string> args, Context& context);

// ---- What commands share

// Parses; on --help prints it with the paragraph on scenes and returns false. Words are errors.
absl::StatusOr<bool> ParseOrHelp(cli::FlagSet* flags, std::span<const std::string> args,
                                 Context& context);

// --threads: 0 means one per hardware thread, and is replaced by that number.
void RegisterThreads(cli::FlagSet* flags, uint64_t* threads);
// --quick, for whoever wants to see that it runs.
void RegisterQuick(cli::FlagSet* flags, bool* quick);
int ResolveThreads(uint64_t threads);

// --isa avx2|avx512, the best of this machine unless said otherwise. FailedPrecondition: the
// machine has no such instructions.
void RegisterIsa(cli::FlagSet* flags, std::string* isa);
absl::StatusOr<SimdTarget> ResolveIsa(const std::string& isa);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_COMMAND_H_
