// SPDX-License-Identifier: Apache-2.0
#include "client/import/obj_statements.h"

#include <limits>

#include "absl/strings/str_cat.h"
#include "client/import/import_types.h"

namespace sightline {

ObjStatements::int_type ObjStatements::underflow() {
  chunk_.clear();
  if (cancel_ != nullptr && cancel_->cancelled()) return traits_type::eof();
  while (chunk_.size() < kChunkBytes && !scanner_.AtEnd() && Wanted()) Translate(NextLine());
  if (chunk_.empty() || stopped_) return traits_type::eof();
  setg(chunk_.data(), chunk_.data(), chunk_.data() + chunk_.size());
  return traits_type::to_int_type(chunk_.front());
}

bool ObjStatements::Wanted() {
  stopped_ = stopped_ || !CheckWanted(cancel_, lines_++).ok();
  return !stopped_;
}

std::string_view ObjStatements::NextLine() {
  const auto continues = [](std::string_view line) { return !line.empty() && line.back() == '\\'; };
  std::string_view line = scanner_.RestOfLine();
  if (!continues(line)) return line;
  joined_.clear();
  while (continues(line) && Wanted()) {
    joined_.append(line.substr(0, line.size() - 1)).push_back(' ');
    line = scanner_.RestOfLine();  // Empty at the end of the text, which ends the loop.
  }
  return joined_.append(line);
}

void ObjStatements::Translate(std::string_view line) {
  const std::string_view keyword = TakeToken(&line);
  if (keyword == "v") {
    ReadVertex(line);
    chunk_.append("v 0\n");
  } else if (keyword == "f") {
    TranslateFace(line);
  } else if (keyword == "o" || keyword == "g") {
    // tinyobjloader reads C strings: an embedded zero would hide the rest of the name and nothing
    // else.
    chunk_.append(keyword).append(" ").append(TrimBlanks(line)).push_back('\n');
  } else if (keyword == "p" || keyword == "l" || keyword == "curv" || keyword == "curv2" ||
             keyword == "surf") {
    ++skipped_primitives_;
  }
}

void ObjStatements::ReadVertex(std::string_view arguments) {
  Vec3d v;
  bool malformed = false;
  for (int axis = 0; axis < 3; ++axis) {
    const std::optional<double> x = ParseDouble(TakeToken(&arguments));
    malformed |= !x.has_value();
    v[axis] = x.value_or(kNaN);
  }
  malformed_vertices_ += malformed;
  non_finite_vertices_ += !IsFinite(v);
  vertices_.push_back(CanonicalVertex(v));
}

void ObjStatements::TranslateFace(std::string_view arguments) {
  arguments = arguments.substr(0, arguments.find('#'));
  std::string_view corner = TakeToken(&arguments);
  chunk_.append(corner.empty() ? "f 0"
                               : "f ");  // tinyobjloader does not report a face of no corners.
  for (; !corner.empty(); corner = TakeToken(&arguments)) {
    const std::optional<int64_t> index = ParseInt(corner.substr(0, corner.find('/')));
    constexpr int64_t kMost = std::numeric_limits<int32_t>::max();
    const bool fits = index.has_value() && *index >= -kMost && *index <= kMost;
    absl::StrAppend(&chunk_, fits ? *index : 0, " ");
  }
  chunk_.push_back('\n');
}

}  // namespace sightline
