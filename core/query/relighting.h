// SPDX-License-Identifier: Apache-2.0
//
// Pictures whose lights move: the hits of a camera's rays are kept as packets, and only the shadows
// of the light that moves are asked about again (paper 004, section 5). For programs that hold the
// engine themselves, and what sightline-bench measures the paper by; client/lib/relighting.h is the
// same over the service, where hits, shadows and sums are apart: it sums by the same rules.
//
// Packets: the hits of side × side pixels follow one another, so that with PACKET shadow packets
// from a light are those of the picture, however many samples it has. A pixel that hit nothing
// stands there with the packet's first hit, which keeps the packet together and costs no answer;
// packets without a hit are left out. Other strategies may find an order of their own.
//
// Two buffers: `base` is the light of all but the chosen light at each pixel, `color` that with it.
// Choosing another light traces nothing: what every sample reaches is kept, a bit a point. (The
// paper subtracts the chosen light from the picture; here the base is summed anew, so that no
// rounding of a subtraction stays behind.) Sums run in double, the others' samples in order first,
// then the chosen light's: color is, bit for bit, what ComputeShadows' weighted sums are over the
// samples in that order.
//
// Units: weights and buffers have the caller's unit. Errors name what was given and what is meant.
//
// Thread safety: none; one Relighting belongs to one thread at a time. The scene must outlive it.
//
//   SL_ASSIGN_OR_RETURN(Relighting picture, Relighting::Make(*scene, PacketsOfHits(tile.points,
//       tile.point_pixel, width, height, 16), samples, weights, options));
//   SL_RETURN_IF_ERROR(picture.Choose(2));
//   while (...) SL_RETURN_IF_ERROR(picture.Move(samples_of_light_2, weights_of_light_2, options));
#ifndef SIGHTLINE_CORE_QUERY_RELIGHTING_H_
#define SIGHTLINE_CORE_QUERY_RELIGHTING_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/accel/indexed_geometry.h"
#include "core/light/light.h"
#include "core/query/options.h"
#include "core/query/points.h"
#include "core/query/tile_result.h"

namespace sightline {

struct HitPackets {
  PreparedPoints points;        // Whole packets of side × side.
  std::vector<uint32_t> pixel;  // Of each point; kNoPixel where it stands in for a miss.
  size_t pixel_count = 0;       // Of the picture.
  int side = 0;
};

// `hits` with their `pixels` (row by row of a picture of width × height, ascending), as TraceTile
// gives them for a whole picture. REQUIRES: as many pixels as hits, all within the picture, which
// has fewer than 2^32 - 1; side is one of kPacketSides.
HitPackets PacketsOfHits(const PreparedPoints& hits, std::span<const uint32_t> pixels,
                         uint32_t width, uint32_t height, int side);

class Relighting {
 public:
  // Asks about all samples, one weight each; LightSample::light numbers the lights, ascending from
  // 0 without a gap. The last light is chosen. With strategy PACKET the packets' side is that of
  // `hits`, which PacketsOfHits made. InvalidArgument: numbers of weights or lights that do not
  // fit; what ComputeShadows says.
  static absl::StatusOr<Relighting> Make(const IndexedGeometry& scene, HitPackets hits,
                                         std::span<const LightSample> samples,
                                         std::span<const double> weights,
                                         const QueryOptions& options);

  // Makes `light` the one that moves. InvalidArgument: there is none of that number.
  absl::Status Choose(uint32_t light);
  // Puts the chosen light elsewhere: as many samples as it likes, `light` in them unread. Errors as
  // above, and Cancelled / DeadlineExceeded; then nothing has changed.
  absl::Status Move(std::span<const LightSample> samples, std::span<const double> weights,
                    const QueryOptions& options);

  uint32_t light_count() const { return static_cast<uint32_t>(lights_.size()); }
  uint32_t chosen() const { return chosen_; }
  // By pixel; 0 where nothing is hit.
  const std::vector<double>& base() const { return base_; }
  const std::vector<double>& color() const { return color_; }
  const QueryStats& stats() const { return stats_; }  // Of the last call that traced.

 private:
  // What a light's samples reach: rows of a bit a point.
  struct Lit {
    std::vector<uint8_t> bits;
    std::vector<double> weights;
  };

  Relighting(const IndexedGeometry& scene, HitPackets hits)
      : scene_(&scene), hits_(std::move(hits)) {}
  absl::StatusOr<Lit> Ask(std::span<const LightSample> samples, std::span<const double> weights,
                          const QueryOptions& options);
  void AddTo(const Lit& lit, std::vector<double>* sums) const;
  void SumBase();
  void SumColor();

  const IndexedGeometry* scene_;
  HitPackets hits_;
  std::vector<Lit> lights_;
  uint32_t chosen_ = 0;
  std::vector<double> base_, color_;
  QueryStats stats_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_RELIGHTING_H_
