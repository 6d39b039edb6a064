// SPDX-License-Identifier: Apache-2.0
//
// Rules that every single file keeps. Each returns its findings; an empty list means that it is
// kept.
//
// Thread safety: pure functions.
#ifndef SIGHTLINE_TESTS_POLICY_HYGIENE_RULES_H_
#define SIGHTLINE_TESTS_POLICY_HYGIENE_RULES_H_

#include <string>
#include <vector>

#include "tests/policy/source_tree.h"

namespace sightline::policy {

// The licence stands in the first line, or in the second below a #! line: .h, .cc, .proto, .sh,
// .awk, .py.
std::vector<std::string> CheckLicenceLine(const SourceFile& file);

// No path of somebody's machine: a clone works wherever it is put.
std::vector<std::string> CheckNoMachinePaths(const SourceFile& file);

// Nothing is left to be done later in the text of the code.
std::vector<std::string> CheckNoLeftovers(const SourceFile& file);

// Sources of more than 600 lines are listed, with the reason, in hygiene_rules.cc. Documents hold
// something.
std::vector<std::string> CheckLength(const SourceFile& file);

// C++ and proto: 100 columns (code points), no tabs, no blanks at line ends.
std::vector<std::string> CheckLineForm(const SourceFile& file);

// Headers: the guard is named after the path; the comment at the top tells about thread safety
// (except in Highway's -inl.h, which hold functions of one target alone).
std::vector<std::string> CheckHeaderForm(const SourceFile& file);

// x.cc includes x.h before anything else, and so does tests/…/x_test.cc: thus each header is
// compiled on its own somewhere. Sources that Highway compiles once per target have an order of
// their own. `headers` are the headers that exist.
std::vector<std::string> CheckOwnHeaderFirst(const SourceFile& file,
                                             const std::vector<std::string>& headers);

// Tests wait for events, never for time.
std::vector<std::string> CheckNoSleepInTests(const SourceFile& file);

}  // namespace sightline::policy

#endif  // SIGHTLINE_TESTS_POLICY_HYGIENE_RULES_H_
