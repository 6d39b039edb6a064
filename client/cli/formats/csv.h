// SPDX-License-Identifier: Apache-2.0
//
// Tables of numbers as text, one row a line. Columns are separated by commas, semicolons, or blanks
// and tabs; the first line of content decides. A first line without any number is a header and is
// skipped. Empty lines and lines that start with # are skipped; line ends may be LF or CRLF.
// Numbers are read in the C locale and rounded once; nan and inf are numbers. Anything else is an
// error that names the line: no row is dropped in silence.
//
// Thread safety: free functions.
//
//   SL_ASSIGN_OR_RETURN(CsvTable points, ReadCsv("P.csv"));   // points.columns == 3
#ifndef SIGHTLINE_CLIENT_CLI_FORMATS_CSV_H_
#define SIGHTLINE_CLIENT_CLI_FORMATS_CSV_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/base/cancel.h"

namespace sightline::cli {

struct CsvTable {
  size_t rows = 0;
  size_t columns = 0;
  std::vector<double> values;       // Row by row.
  std::vector<std::string> header;  // Names of the columns; empty without a header line.
};

// `name` is the file's name for the messages. INVALID_ARGUMENT for text that is no such table and
// for text without a single row; the status of `cancel` once that stops.
absl::StatusOr<CsvTable> ParseCsv(absl::string_view text, const std::string& name,
                                  const CancelToken* cancel = nullptr);
absl::StatusOr<CsvTable> ReadCsv(const std::string& path, const CancelToken* cancel = nullptr);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_FORMATS_CSV_H_
