// SPDX-License-Identifier: Apache-2.0
//
// The text of an OBJ file as tinyobjloader can take it: a stream buffer that hands on `v`, `f`, `o`
// and `g` statements, one a line, and reads the coordinates of `v` itself.
//
// - A line that ends in a backslash goes on in the next one.
// - `v` becomes "v 0": tinyobjloader only has to count it. Its exact coordinates are in vertices().
// - Of a face's corner only the vertex index is handed on, and 0, which is no index, in place of
//   one that is no number or does not fit in 31 bits.
// - A bare `g` becomes "g " (the default group), which tinyobjloader otherwise ignores.
// - Points, lines and free-form elements are counted; every other statement ends here.
//
// Invariant: when tinyobjloader has seen the k-th `v`, vertices() holds at least k entries.
//
// Thread safety: one buffer per thread; the text must outlive it.
//
//   ObjStatements statements(text);
//   std::istream stream(&statements);
//   tinyobj::LoadObjWithCallback(stream, callback, this);
#ifndef SIGHTLINE_CLIENT_IMPORT_OBJ_STATEMENTS_H_
#define SIGHTLINE_CLIENT_IMPORT_OBJ_STATEMENTS_H_

#include <cstdint>
#include <streambuf>
#include <string>
#include <string_view>
#include <vector>

#include "client/import/text_scanner.h"
#include "core/base/cancel.h"

namespace sightline {

class ObjStatements : public std::streambuf {
 public:
  // Once `cancel` (may be null) stops, the text ends.
  explicit ObjStatements(std::string_view text, const CancelToken* cancel = nullptr)
      : scanner_(text), cancel_(cancel) {}

  const std::vector<Vec3d>& vertices() const { return vertices_; }
  uint64_t non_finite_vertices() const { return non_finite_vertices_; }
  // `v` statements with a coordinate that is missing or no number; among the non-finite ones.
  uint64_t malformed_vertices() const { return malformed_vertices_; }
  uint64_t skipped_primitives() const { return skipped_primitives_; }

 protected:
  int_type underflow() override;

 private:
  // Text that is handed on at once; a longer statement is handed on whole.
  static constexpr size_t kChunkBytes = size_t{64} << 10;

  // The next statement with its continued lines; a view into the text or into joined_.
  std::string_view NextLine();
  // False once `cancel` has stopped, and from then on. Asked line by line, it looks now and then:
  // most lines hand on nothing, and a file may hold no others.
  bool Wanted();
  void Translate(std::string_view line);
  void ReadVertex(std::string_view arguments);
  void TranslateFace(std::string_view arguments);

  TextScanner scanner_;
  const CancelToken* const cancel_;
  std::string joined_;
  std::string chunk_;
  std::vector<Vec3d> vertices_;
  uint64_t lines_ = 0;
  bool stopped_ = false;
  uint64_t non_finite_vertices_ = 0;
  uint64_t malformed_vertices_ = 0;
  uint64_t skipped_primitives_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_OBJ_STATEMENTS_H_
