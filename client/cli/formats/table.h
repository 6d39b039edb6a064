// SPDX-License-Identifier: Apache-2.0
//
// Rows of numbers from whatever file holds them: .npy, text (.csv, .tsv, .txt, .xyz, .dat), or the
// vertices of a .ply, each also packed as .xz or .gz where the mesh readers take it so. The file
// must have exactly the columns that are asked for.
//
// Thread safety: free functions.
//
//   SL_ASSIGN_OR_RETURN(std::vector<double> xyz, ReadRows("P.npy", 3, "points"));
#ifndef SIGHTLINE_CLIENT_CLI_FORMATS_TABLE_H_
#define SIGHTLINE_CLIENT_CLI_FORMATS_TABLE_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/base/cancel.h"

namespace sightline::cli {

// `columns` numbers per row, row by row. `what` names the rows in messages: "points", "lights".
// Once `cancel` (may be null) stops, its status.
absl::StatusOr<std::vector<double>> ReadRows(const std::string& path, size_t columns,
                                             absl::string_view what,
                                             const CancelToken* cancel = nullptr);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_FORMATS_TABLE_H_
