// SPDX-License-Identifier: Apache-2.0
//
// The flags that say which scenes and workloads a command times, and how: what `embree`, `scaling`
// and `auto` share.
//
// Thread safety: none; belongs to one command.
//
//   WorkloadFlags options;
//   options.Register(&flags);
//   ... parse ...
//   SL_RETURN_IF_ERROR(options.Check());
//   for (const ImageSize& size : options.Sizes(workload)) ... options.Spec(workload, size) ...
#ifndef SIGHTLINE_TESTS_BENCH_WORKLOAD_FLAGS_H_
#define SIGHTLINE_TESTS_BENCH_WORKLOAD_FLAGS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/flags.h"
#include "core/accel/kd_builder.h"
#include "tests/bench/bench_scene.h"
#include "tests/bench/workload.h"

namespace sightline::bench {

struct ImageSize {
  uint32_t width = 0, height = 0;
};

struct WorkloadFlags {
  std::vector<std::string> scenes, workloads;
  std::string views;
  uint64_t width = 1920, height = 1080;
  std::vector<ImageSize> sweep;
  uint64_t points = 1'000'000, range = 0;
  std::string lights = "sky";
  bool shuffled = false, sources = false;
  uint64_t threads = 1, repeats = 5;
  std::string strategy = "AUTO", structure = "AUTO", isa = "best";
  KdBuildOptions kd_tree;
  bool quick = false, json = false;

  // Which choices of --strategy and --structure there are: one, or a command's own.
  enum class Choices : uint8_t { kOne, kAll };
  // REQUIRES: this outlives `flags`.
  void Register(cli::FlagSet* flags, Choices choices = Choices::kOne);
  // Usage errors: no scene, no workload, or one that is none.
  absl::Status Check() const;

  // Those to time, in turn: `all` is every one, of points with either kind of lights, as they come
  // and shuffled.
  std::vector<std::string> Workloads() const;
  // The BVH, and what the strategy and the structure want beside it.
  IndexOptions Index() const;
  // The sizes to time a workload at: those of the sweep, or the one of --width and --height; one
  // that does not matter where the workload has no picture.
  std::vector<ImageSize> Sizes(const std::string& workload) const;
  // FailedPrecondition: the machine has no such instruction set.
  absl::StatusOr<WorkloadSpec> Spec(const std::string& workload, const ImageSize& size) const;
};

// WIDTHxHEIGHT, or a width alone, which is 16:9; several with commas between them.
absl::StatusOr<std::vector<ImageSize>> ParseSizes(const std::string& text);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_WORKLOAD_FLAGS_H_
