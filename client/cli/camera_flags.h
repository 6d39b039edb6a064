// SPDX-License-Identifier: Apache-2.0
//
// The camera of a command line: where it stands, what it looks at, how large its picture is.
//
// Units: scene units, degrees, pixels. Sizes: sides from 1 to kMaxImageSide, kMaxPixels in all.
//
// Thread safety: plain values; belongs to one command.
//
//   CameraFlags camera;
//   camera.Register(&flags);
//   ... parse ...
//   SL_ASSIGN_OR_RETURN(ViewChoice view,
//                       ChooseView(session, scene, name, camera, camera.aspect()));
//   SL_ASSIGN_OR_RETURN(client::Camera eye, camera.CameraOf(view));
#ifndef SIGHTLINE_CLIENT_CLI_CAMERA_FLAGS_H_
#define SIGHTLINE_CLIENT_CLI_CAMERA_FLAGS_H_

#include <cstdint>

#include "absl/status/statusor.h"
#include "client/cli/flags.h"
#include "client/cli/view_choice.h"
#include "client/lib/types.h"

namespace sightline::cli {

// Pixels that commands hold arrays for: 2^28 take about 10 GB with three lights.
inline constexpr uint64_t kMaxPixels = uint64_t{1} << 28;

struct CameraFlags : ViewFlags {
  uint32_t width = 1920, height = 1080;

  // --eye, --at, --up, --fov, --size. REQUIRES: this outlives `flags`.
  void Register(FlagSet* flags);
  double aspect() const { return static_cast<double>(width) / height; }
  uint64_t pixels() const { return uint64_t{width} * height; }
  // Usage errors: an eye at what it looks at, an up along the view.
  absl::StatusOr<client::Camera> CameraOf(const ViewChoice& view) const;
};

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_CAMERA_FLAGS_H_
