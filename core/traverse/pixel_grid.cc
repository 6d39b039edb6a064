// SPDX-License-Identifier: Apache-2.0
#include "core/traverse/pixel_grid.h"

#include <algorithm>
#include <cmath>

#include "core/geometry/vec3.h"
#include "core/shaft/margins.h"

namespace sightline {
namespace {

// What the corners' depths have of their lengths, at least: kMinDepthShare and room for the
// rounding of the rays and of the frame (below 2^-20 together).
constexpr double kLeastShare = kMinDepthShare + 0x1p-16;

Vec3d TermOf(const PixelTerms& terms, uint32_t i) {
  return {terms[0][i], terms[1][i], terms[2][i]};
}

// fn(edge, run, term) for the outer terms of every run of `count`.
template <class Fn>
void ForEachRun(const PixelTerms& terms, uint32_t count, const Fn& fn) {
  for (uint32_t run = 0; run < PixelGrid::kRuns; ++run) {
    const uint32_t first = std::min(run * PixelGrid::kRun, count - 1);
    fn(0, run, TermOf(terms, first));
    fn(1, run, TermOf(terms, std::min(first + PixelGrid::kRun, count) - 1));
  }
}

}  // namespace

bool MakePixelGrid(const PixelTerms& columns, uint32_t width, const PixelTerms& rows,
                   uint32_t height, PixelGrid* grid) {
  const Vec3d left = TermOf(columns, 0), right = TermOf(columns, width - 1);
  const Vec3d top = TermOf(rows, 0), bottom = TermOf(rows, height - 1);
  const Vec3d axis = (left + right + top + bottom) * 0.5;
  if (!MakeShaftFrame(axis, right - left, &grid->frame)) return false;
  const Vec3d axes[3] = {ToDouble(grid->frame.u), ToDouble(grid->frame.v), ToDouble(grid->frame.w)};
  double norm_inf = 0;
  for (const Vec3d& column : {left, right}) {
    for (const Vec3d& row : {top, bottom}) {
      // A cone, so that it holds what lies between.
      const Vec3d corner = column + row;
      const double depth = Dot(axes[2], corner);
      if (!(depth >= kLeastDepth && depth >= kLeastShare * Length(corner))) return false;
      norm_inf = std::max(norm_inf, MaxAbs(corner));
    }
  }
  // Rays are rounded, and so is this.
  grid->norm_inf = static_cast<float>(norm_inf) * (1 + 0x1p-22f);
  for (int k = 0; k < 3; ++k) {
    ForEachRun(columns, width, [&](int edge, uint32_t run, Vec3d term) {
      grid->columns[edge][k][run] = static_cast<float>(Dot(axes[k], term));
    });
    ForEachRun(rows, height, [&](int edge, uint32_t run, Vec3d term) {
      std::fill_n(grid->rows[edge][k][run], PixelGrid::kRun,
                  static_cast<float>(Dot(axes[k], term)));
    });
  }
  return true;
}

}  // namespace sightline
