// SPDX-License-Identifier: Apache-2.0
//
// Early return on error, for functions that return absl::Status or absl::StatusOr.
//
//   absl::StatusOr<Mesh> Load(const std::string& path) {
//     SL_RETURN_IF_ERROR(CheckReadable(path));
//     SL_ASSIGN_OR_RETURN(std::string bytes, ReadFile(path));
//     return Parse(bytes);
//   }
//
// Thread safety: macros without state.
#ifndef SIGHTLINE_CORE_BASE_STATUS_MACROS_H_
#define SIGHTLINE_CORE_BASE_STATUS_MACROS_H_

#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

// `expression` is evaluated once.
#define SL_RETURN_IF_ERROR(expression)                            \
  do {                                                            \
    if (absl::Status sl_status = (expression); !sl_status.ok()) { \
      return sl_status;                                           \
    }                                                             \
  } while (false)

// `declaration` may declare a variable or name one; a type with a comma in it needs parentheses or
// an alias. Expands to several statements: it needs braces under an `if`.
#define SL_ASSIGN_OR_RETURN(declaration, expression) \
  SL_INTERNAL_ASSIGN_OR_RETURN(SL_INTERNAL_CONCAT(sl_result_, __LINE__), declaration, expression)

#define SL_INTERNAL_CONCAT(a, b) SL_INTERNAL_CONCAT2(a, b)
#define SL_INTERNAL_CONCAT2(a, b) a##b
#define SL_INTERNAL_ASSIGN_OR_RETURN(result, declaration, expression) \
  auto result = (expression);                                         \
  if (!result.ok()) return std::move(result).status();                \
  declaration = *std::move(result)

#endif  // SIGHTLINE_CORE_BASE_STATUS_MACROS_H_
