// SPDX-License-Identifier: Apache-2.0
//
// Ids of resources that a client makes: known before the server's answer, so that what was given up
// on the way can be deleted all the same, and nobody else's.
//
// Thread safety: functions only.
//
//   const std::string id = NewId("load");  // "load-" and 64 random bits in hexadecimal.
#ifndef SIGHTLINE_CLIENT_LIB_NEW_ID_H_
#define SIGHTLINE_CLIENT_LIB_NEW_ID_H_

#include <cstdint>
#include <string>

#include "absl/random/random.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

namespace sightline::client {

inline std::string NewId(absl::string_view kind) {
  absl::BitGen random;
  return absl::StrFormat("%s-%016x", kind, absl::Uniform<uint64_t>(random));
}

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_NEW_ID_H_
