// SPDX-License-Identifier: Apache-2.0
//
// "Did you mean": how many letters must be put in, taken out or replaced, or pairs of neighbours
// exchanged, to make one word another.
//
// Thread safety: free functions.
#ifndef SIGHTLINE_CORE_BASE_EDIT_DISTANCE_H_
#define SIGHTLINE_CORE_BASE_EDIT_DISTANCE_H_

#include <algorithm>
#include <numeric>
#include <span>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace sightline {

inline size_t EditDistance(absl::string_view a, absl::string_view b) {
  // Rows of the usual table: for the prefixes of `a` that are two and one shorter, and this one.
  std::vector<size_t> before(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
  std::iota(last.begin(), last.end(), size_t{0});
  for (size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      row[j] =
          std::min({row[j - 1] + 1, last[j] + 1, last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        row[j] = std::min(row[j], before[j - 2] + 1);
      }
    }
    before.swap(last);
    last.swap(row);
  }
  return last[b.size()];
}

// The word nearest to `word`, or "" if none is near: at most a third of its letters may differ, or
// `word` is its beginning.
inline std::string NearestWord(absl::string_view word, std::span<const std::string> words) {
  std::string best;
  size_t best_distance = std::max<size_t>(1, word.size() / 3) + 1;
  for (const std::string& candidate : words) {
    size_t distance = EditDistance(word, candidate);
    if (word.size() >= 3 && absl::string_view(candidate).substr(0, word.size()) == word)
      distance = 1;
    if (distance < best_distance) {
      best_distance = distance;
      best = candidate;
    }
  }
  return best;
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_EDIT_DISTANCE_H_
