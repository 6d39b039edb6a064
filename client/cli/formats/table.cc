// SPDX-License-Identifier: Apache-2.0
#include "client/cli/formats/table.h"

#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/cli/formats/csv.h"
#include "client/cli/formats/npy.h"
#include "client/import/import.h"
#include "core/base/status_macros.h"

namespace sightline::cli {

absl::StatusOr<std::vector<double>> ReadRows(const std::string& path, size_t columns,
                                             absl::string_view what, const CancelToken* cancel) {
  const std::string lower = absl::AsciiStrToLower(path);
  if (absl::EndsWith(lower, ".npy")) {
    SL_ASSIGN_OR_RETURN(NpyArray array, ReadNpy(path, cancel));
    if (array.shape.size() != 2 || array.shape[1] != columns) {
      const bool one_row = array.shape.size() == 1 && array.shape[0] == columns;
      return absl::InvalidArgumentError(absl::StrCat(
          "'", path, "': ", what, " want shape (n, ", columns, "), but its array has shape ",
          NpyShapeText(array.shape), " (dtype '", array.dtype, "'); ",
          one_row ? absl::StrCat("save it as a.reshape(1, ", columns, ")")
                  : absl::StrCat("save an array with ", columns, " columns")));
    }
    return std::move(array.values);
  }
  for (const char* extension : {".csv", ".tsv", ".txt", ".xyz", ".dat"}) {
    if (!absl::EndsWith(lower, extension)) continue;
    SL_ASSIGN_OR_RETURN(CsvTable table, ReadCsv(path, cancel));
    if (table.columns != columns) {
      return absl::InvalidArgumentError(absl::StrCat("'", path, "': ", what, " want ", columns,
                                                     " columns, but it has ", table.columns));
    }
    return std::move(table.values);
  }
  for (const char* extension : {".ply", ".ply.xz", ".ply.gz"}) {
    if (!absl::EndsWith(lower, extension) || columns != 3) continue;
    SL_ASSIGN_OR_RETURN(std::vector<Vec3d> points, ImportPoints(path, {.cancel = cancel}));
    std::vector<double> values;
    values.reserve(points.size() * 3);
    for (const Vec3d& p : points) values.insert(values.end(), {p.x, p.y, p.z});
    return values;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("'", path, "': ", what, " are read from .npy, .csv (.tsv, .txt, .xyz, .dat)",
                   columns == 3 ? " and .ply" : "", " files; the name must end so"));
}

}  // namespace sightline::cli
