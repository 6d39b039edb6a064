// SPDX-License-Identifier: Apache-2.0
#include "core/base/utf8.h"

namespace sightline {

size_t Utf8CharacterSize(absl::string_view text) {
  if (text.empty()) return 0;
  const auto in = [text](size_t i, unsigned lo, unsigned hi) {
    return i < text.size() && static_cast<unsigned char>(text[i]) >= lo &&
           static_cast<unsigned char>(text[i]) <= hi;
  };
  const auto tail = [&in](size_t i) { return in(i, 0x80, 0xBF); };
  if (in(0, 0x00, 0x7F)) return 1;
  if (in(0, 0xC2, 0xDF)) return tail(1) ? 2 : 0;
  // The second byte keeps the forms short, below the surrogates or above them, and in range.
  if (in(0, 0xE0, 0xEF)) {
    const bool second = in(0, 0xE0, 0xE0)   ? in(1, 0xA0, 0xBF)
                        : in(0, 0xED, 0xED) ? in(1, 0x80, 0x9F)
                                            : tail(1);
    return second && tail(2) ? 3 : 0;
  }
  const bool second = in(0, 0xF0, 0xF0)   ? in(1, 0x90, 0xBF)
                      : in(0, 0xF4, 0xF4) ? in(1, 0x80, 0x8F)
                                          : in(0, 0xF1, 0xF3) && tail(1);
  return second && tail(2) && tail(3) ? 4 : 0;
}

bool IsUtf8(absl::string_view text) {
  while (!text.empty()) {
    const size_t size = Utf8CharacterSize(text);
    if (size == 0) return false;
    text.remove_prefix(size);
  }
  return true;
}

}  // namespace sightline
