// SPDX-License-Identifier: Apache-2.0
#include "client/import/position_table.h"

#include <random>

namespace sightline {

uint64_t PositionTable::ProcessSalt() {
  static const uint64_t salt = [] {
    std::random_device random;
    return uint64_t{random()} << 32 | random();
  }();
  return salt;
}

}  // namespace sightline
