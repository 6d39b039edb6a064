// SPDX-License-Identifier: Apache-2.0
//
// Pictures of what a camera query answered.
//
//  lit    Objects in muted colours of their own, shaded by how their surface is turned, with every
//         lamp's light, by its weight, where its bit says that it arrives. What none reaches is in
//         ambient light.
//  depth  Near is light, far is dark, even steps of the logarithm; pixels without a hit are grey.
//  cost   Work per tile: boxes and triangles tested per pixel; even steps of the logarithm.
//  strategy
//         What answered each ray, a hue each (StrategyKey): whole shafts, a shaft's relevant
//         triangles, packets, or the ray by itself. Surfaces are shaded, so that the scene is seen.
//
// Surface normals are not asked of the server: the normal of a pixel is that of the plane through
// its hit and the hits of its neighbours, of the same triangle where there is one.
//
// Thread safety: free functions; the same input gives the same picture.
#ifndef SIGHTLINE_CLIENT_CLI_PICTURE_PICTURES_H_
#define SIGHTLINE_CLIENT_CLI_PICTURE_PICTURES_H_

#include <span>
#include <vector>

#include "client/cli/formats/png.h"
#include "client/lib/types.h"
#include "core/geometry/vec3.h"

namespace sightline::cli {

// REQUIRES: `image` has object, triangle and depth, and `lit` if there are lights (one sample
// each).
Image LitPicture(const client::TileImage& image, const client::Camera& camera,
                 std::span<const client::Light> lights, Vec3d up);

// REQUIRES: `image` has depth.
Image DepthPicture(const client::TileImage& image);

// REQUIRES: `image` has costs.
Image CostPicture(const client::TileImage& image);

// What a hue of the strategy picture means, in the order of client::AnsweredBy without kNoRay.
struct StrategyKeyEntry {
  const char* color;  // "blue"
  const char* what;
  Rgb light;  // Linear.
};
std::span<const StrategyKeyEntry> StrategyKey();

// `answered_by`: an AnsweredBy for each pixel, of the camera's rays or of one light's. Pixels of
// kNoRay are dark grey.
// REQUIRES: `image` has object, triangle and depth; as many of `answered_by`.
Image StrategyPicture(const client::TileImage& image, const client::Camera& camera,
                      std::span<const uint8_t> answered_by);

// The unit normal at every pixel, toward the eye; zero where nothing is hit.
// REQUIRES: `image` has object, triangle and depth.
std::vector<Vec3d> PixelNormals(const client::TileImage& image, const client::Camera& camera);

// The colour of an object, linear light: stable for its number, different from its neighbours'.
Rgb ObjectColor(uint32_t object);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_PICTURE_PICTURES_H_
