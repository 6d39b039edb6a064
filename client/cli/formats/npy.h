// SPDX-License-Identifier: Apache-2.0
//
// NumPy's .npy files. The reader takes versions 1, 2 and 3, C and Fortran order, both byte orders,
// floats of 2, 4 and 8 bytes and integers of 1 to 8 bytes, and hands out doubles in C order; a
// value that a double cannot hold exactly is an error. Every length in a file is checked against
// the bytes there before memory is taken. The writer's bytes are those of numpy.save for a C-order
// array (version 1, little endian).
//
// xtensor's xnpy was looked at and not used: it trusts the header's lengths.
//
// Thread safety: free functions.
//
//   SL_ASSIGN_OR_RETURN(NpyArray points, ReadNpy("P.npy"));   // points.shape == {n, 3}
//   SL_RETURN_IF_ERROR(WriteNpy<uint8_t>("lit.npy", std::array{lights, n}, lit));
#ifndef SIGHTLINE_CLIENT_CLI_FORMATS_NPY_H_
#define SIGHTLINE_CLIENT_CLI_FORMATS_NPY_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/base/cancel.h"

namespace sightline::cli {

struct NpyArray {
  std::string dtype;           // As the file says it, e.g. "<f8".
  std::vector<size_t> shape;   // Empty for a scalar.
  std::vector<double> values;  // C order: the last index runs fastest.
};

// "(100, 3)", as NumPy prints a shape.
std::string NpyShapeText(std::span<const size_t> shape);

// `name` is the file's name for the messages. INVALID_ARGUMENT for what is no such file.
absl::StatusOr<NpyArray> ParseNpy(absl::string_view bytes, const std::string& name);
absl::StatusOr<NpyArray> ReadNpy(const std::string& path, const CancelToken* cancel = nullptr);

// The bytes of a file that holds `values`. T: uint8_t, int32_t, int64_t, float or double.
// REQUIRES: values.size() is the product of `shape`.
template <typename T>
std::string FormatNpy(std::span<const size_t> shape, std::span<const T> values);

template <typename T>
absl::Status WriteNpy(const std::string& path, std::span<const size_t> shape,
                      std::span<const T> values);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_FORMATS_NPY_H_
