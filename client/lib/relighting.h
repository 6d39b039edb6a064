// SPDX-License-Identifier: Apache-2.0
//
// A picture whose lights move: what a camera sees is kept on the server as a point set, what each
// light reaches is kept here, and a light that moves is the only one that is asked about again
// (paper 004, section 5; core/query/relighting.h is the same within one process).
//
// Two buffers, by pixel: `base` is the light of all lights but the chosen one, `color` that with
// it: sums of Light::weight / samples over the samples that reach the pixel, in double, the others'
// in order first, the chosen light's last. Pixels that see nothing stay 0. Choosing another light
// asks nothing: the base is summed anew from what is kept.
//
// Answers are TraceImage's, bit for bit, on the revision of the scene that the picture was made of.
// An edit ends it: as soon as the server has let go of that revision, moving a light is
// FAILED_PRECONDITION (REVISION_MISMATCH), and a new Relighting is needed. The point set is renewed
// with every move, and deleted with the object.
//
// Units: scene units for lights; weights have the caller's unit. Errors are the server's.
//
// Thread safety: none; one thread at a time.
//
//   auto picture = Relighting::Make(client, {.scene = "scenes/hall", .camera = camera,
//                                            .lights = lights});
//   (*picture)->Choose(0);
//   while (...) { (*picture)->Move(Light::Point(at)); Show((*picture)->color()); }
#ifndef SIGHTLINE_CLIENT_LIB_RELIGHTING_H_
#define SIGHTLINE_CLIENT_LIB_RELIGHTING_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/lib/client.h"
#include "client/lib/types.h"

namespace sightline::client {

class Relighting {
 public:
  struct Source {
    std::string scene;
    Camera camera;
    std::vector<Light> lights;  // At least one; the last is chosen.
    QueryOptions options;
    absl::Duration lease = absl::Minutes(10);  // Of the points, between two moves.
  };

  // Traces the camera's rays, and asks about every light. `stream` is also how moves are asked:
  // its timeout is that of this call and of each move anew, its deadline that of all of them, and
  // its cancellation must outlive the picture.
  static absl::StatusOr<std::unique_ptr<Relighting>> Make(const Client& client, Source source,
                                                          const StreamOptions& stream = {});
  ~Relighting();
  Relighting(const Relighting&) = delete;
  Relighting& operator=(const Relighting&) = delete;

  // Makes `light` the one that moves. INVALID_ARGUMENT: there is none of that number.
  absl::Status Choose(uint32_t light);
  // Puts `light` in the place of the chosen one. After an error nothing has changed.
  absl::Status Move(const Light& light);

  const std::vector<Light>& lights() const { return lights_; }
  uint32_t chosen() const { return chosen_; }
  // By pixel, row by row.
  const std::vector<double>& base() const { return base_; }
  const std::vector<double>& color() const { return color_; }
  // Of light `light`: [samples, pixels]; 1 lit, 0 blocked, 255 nothing seen.
  const std::vector<uint8_t>& lit(uint32_t light) const { return lit_[light]; }
  // Of what was asked last.
  const StreamSummary& summary() const { return summary_; }

 private:
  Relighting(const Client& client, Source source, const StreamOptions& stream);
  absl::StatusOr<std::vector<uint8_t>> Ask(const Light& light, const StreamOptions& stream);
  void AddTo(uint32_t light, std::vector<double>* sums) const;
  void SumBase();

  const Client client_;
  const Source source_;
  const StreamOptions stream_;
  std::string point_set_;
  std::vector<Light> lights_;
  std::vector<std::vector<uint8_t>> lit_;  // By light.
  uint32_t chosen_ = 0;
  std::vector<double> base_, color_;
  StreamSummary summary_;
};

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_RELIGHTING_H_
