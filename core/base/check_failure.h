// SPDX-License-Identifier: Apache-2.0
//
// What happens between a failed check (check.h) and the end of the process: for whoever has
// something left to write. The check's own text then goes to stderr; where nobody reads that, it
// holds the end up for a second at most. Another thread whose check fails meanwhile writes its own
// text and waits for the first, for three seconds at most.
//
// Thread safety: from any thread.
//
//   SetBeforeCheckFailure([] { FlushLog(absl::Seconds(1)); });
#ifndef SIGHTLINE_CORE_BASE_CHECK_FAILURE_H_
#define SIGHTLINE_CORE_BASE_CHECK_FAILURE_H_

namespace sightline {

// `prepare` is called once, by the thread whose check fails first, before anything is printed. It
// must come back soon. Null: nothing is called.
void SetBeforeCheckFailure(void (*prepare)());

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_CHECK_FAILURE_H_
