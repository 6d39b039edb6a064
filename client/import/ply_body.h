// SPDX-License-Identifier: Apache-2.0
//
// The values behind a PLY header, one after another, whatever their encoding: as doubles (which
// hold every PLY type exactly).
//
// Errors stick: after a value that is missing or unreadable, ok() is false and every further value
// is 0.
//
// Thread safety: one body per thread; the bytes must outlive it.
//
//   PlyBody body(bytes, header);
//   double x = body.Scalar(property.type);
//   if (!body.ok()) return body.error();
#ifndef SIGHTLINE_CLIENT_IMPORT_PLY_BODY_H_
#define SIGHTLINE_CLIENT_IMPORT_PLY_BODY_H_

#include <cstdint>
#include <optional>
#include <string_view>

#include "absl/status/status.h"
#include "client/import/ply_header.h"
#include "client/import/text_scanner.h"

namespace sightline {

class PlyBody {
 public:
  PlyBody(std::string_view bytes, const PlyHeader& header)
      : encoding_(header.encoding),
        text_(bytes.substr(header.size)),
        binary_(bytes.substr(header.size)) {}

  // The next value. In text, a token that is no number is NaN.
  double Scalar(PlyType type);

  // A list's length. Fails unless it is a whole number for whose values there are bytes enough.
  uint64_t ListSize(const PlyProperty& list);

  // Reads past one property, list or scalar.
  void Skip(const PlyProperty& property);

  // The most elements of this kind that the rest can hold; any number where an element takes no
  // bytes.
  uint64_t MostElements(const PlyElement& element) const;

  // Bytes that no value has been read from; in text without the blanks before the next one.
  uint64_t Unread() const;

  bool ok() const { return error_.ok(); }
  const absl::Status& error() const { return error_; }

 private:
  bool ascii() const { return encoding_ == PlyHeader::Encoding::kAscii; }
  void Fail(absl::Status error);

  const PlyHeader::Encoding encoding_;
  TextScanner text_;         // ASCII.
  std::string_view binary_;  // Binary: what is left.
  absl::Status error_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_PLY_BODY_H_
