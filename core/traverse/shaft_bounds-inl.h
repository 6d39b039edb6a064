// SPDX-License-Identifier: Apache-2.0
//
// What a shaft's walk knows of the rays that it is asked about: where they are, block by block and
// together, and which of them are.
//
// Thread safety: plain values.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_BOUNDS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_BOUNDS_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_BOUNDS_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_BOUNDS_INL_H_
#endif

#include <cstdint>

#include "core/shaft/wedge-inl.h"
#include "core/traverse/shaft_lanes-inl.h"
#include "core/traverse/shaft_sides-inl.h"
#include "hwy/highway.h"

namespace sightline {
namespace HWY_NAMESPACE {

// The rays of a set, block by block and together.
struct BlockBounds {
  uint32_t open_blocks;  // Those that have a ray that is still asked about.
  bool whole;            // A full packet was open when these were taken.
  // Rectangles of slopes or offsets: ends (inverted where a block has no open ray), middle and half
  // extent (0 there).
  alignas(64) float x0[kShaftBlocks], x1[kShaftBlocks], y0[kShaftBlocks], y1[kShaftBlocks];
  alignas(64) float mx[kShaftBlocks], my[kShaftBlocks], hx[kShaftBlocks], hy[kShaftBlocks];
  // Depths. One origin: where the nearest and farthest rays end (far: or, for closest hits, where
  // all have found a hit; +inf without an end). Parallel: of the origins.
  alignas(64) float near[kShaftBlocks], far[kShaftBlocks];
  // Of a pixels' grid, closest hits: bounds of w·D, as far as kDepthScale allows.
  alignas(64) float depth[kShaftBlocks];
  float left, right, below, above;  // Of all: ends,
  float cx, cy, ex, ey;             // middle and half extent.
  float all_near, all_far;
  ShaftSides sides;  // Left, right, below, above; for any hit: the end (the start, if parallel)
                     // and the receivers' cap.
  ShaftWedges wedges;
  float cap_most;  // Of the cap, margin included.
};

// And those that are still asked about, by themselves.
template <class Bits>
struct OpenBounds : BlockBounds {
  alignas(64) Bits open[kShaftBlocks];
};
using ShaftBounds = OpenBounds<uint16_t>;

}  // namespace HWY_NAMESPACE
}  // namespace sightline

#endif  // per-target include guard
