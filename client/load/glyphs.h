// SPDX-License-Identifier: Apache-2.0
//
// Letters of dots, five columns by nine rows, for the words of a plot: digits, small letters and
// what stands between numbers. The base line is under the seventh row.
//
// Thread safety: free functions.
//
//   if (GlyphDot('4', column, row)) ...
#ifndef SIGHTLINE_CLIENT_LOAD_GLYPHS_H_
#define SIGHTLINE_CLIENT_LOAD_GLYPHS_H_

namespace sightline::load {

inline constexpr int kGlyphColumns = 5, kGlyphRows = 9;
inline constexpr int kGlyphBaseRow = 7;  // The first row below the base line.

// Whether `c` has ink there; capitals are drawn as small letters, unknown letters not at all.
// REQUIRES: 0 <= column < kGlyphColumns, 0 <= row < kGlyphRows.
bool GlyphDot(char c, int column, int row);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_GLYPHS_H_
