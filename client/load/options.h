// SPDX-License-Identifier: Apache-2.0
//
// What sightline-load is told: every flag, with its meaning, its default and what it may be.
//
// Thread safety: plain values; ParseOptions is a free function.
//
//   SL_ASSIGN_OR_RETURN(std::unique_ptr<LoadOptions> options, ParseOptions(args, out));
#ifndef SIGHTLINE_CLIENT_LOAD_OPTIONS_H_
#define SIGHTLINE_CLIENT_LOAD_OPTIONS_H_

#include <cstdint>
#include <memory>
#include <ostream>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/cli/light_flags.h"
#include "client/cli/session.h"
#include "client/cli/view_choice.h"
#include "client/lib/types.h"
#include "client/load/driver.h"
#include "client/load/reloader.h"
#include "client/load/slo.h"
#include "client/load/workload.h"

namespace sightline::load {

enum class Check { kNone, kSample, kAll };

struct LoadOptions {
  std::string scene;        // A file, builtin:NAME, or scenes/NAME of the server.
  std::string check_scene;  // What the engine has to compare with; empty: see check_source.h.
  std::string workload = "tiles";
  RunPlan plan;
  absl::Duration window = absl::Seconds(1);
  bool until_stable = false;
  Slo slo;
  bool find_knee = false;
  absl::Duration trial = absl::Seconds(5);
  Check check = Check::kSample;
  uint64_t reload_every = 0;  // Requests; 0: never.
  ReloadBy reload_by = ReloadBy::kEdit;
  // What is asked.
  Mix mix = {1, 0, 0};
  uint32_t width = 640, height = 360, tile = 64;
  uint64_t cameras = 4;
  uint64_t points = 1024, segments = 1, distinct = 256;
  std::string path;
  cli::ViewFlags view;
  cli::LightFlags lights;
  absl::Duration item_timeout = absl::ZeroDuration();
  // What comes out.
  std::string output = "text", hgrm, plot, server_metrics, metrics_token_file;
  cli::SessionFlags session;
};

// Null after --help, which is then printed on `out`. Usage errors name the flag and its value.
absl::StatusOr<std::unique_ptr<LoadOptions>> ParseOptions(std::span<const std::string> args,
                                                          std::ostream& out);

// Whether the server takes a message as large as a request will be. A usage error that names the
// flag, its value, the limit and the most that fits.
absl::Status CheckMessages(const LoadOptions& options, const client::Limits& limits);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_OPTIONS_H_
