// SPDX-License-Identifier: Apache-2.0
#include "server/services/upload_reactor.h"

#include <string>

#include "absl/strings/str_cat.h"

namespace sightline {

absl::Status UploadIdleError(uint64_t max_upload_idle_seconds) {
  const std::string seconds = absl::StrCat(max_upload_idle_seconds);
  return MakeError(
      absl::StatusCode::kDeadlineExceeded, v1::ERROR_REASON_DEADLINE_EXCEEDED,
      absl::StrCat("this upload has kept the server waiting for max_upload_idle = ", seconds,
                   " s, less a second for every ", IdleClock::kBytesPerSecond,
                   " bytes that it brought: what had arrived is dropped; send it again without a ",
                   "pause, in smaller messages if the connection is slow, or have the server wait ",
                   "longer (--max-upload-idle-seconds)"),
      {{"limit", "max_upload_idle"}, {"limit_value", seconds}});
}

}  // namespace sightline
