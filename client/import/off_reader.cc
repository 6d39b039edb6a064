// SPDX-License-Identifier: Apache-2.0
#include "client/import/off_reader.h"

#include <optional>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/import/polygon_fan.h"
#include "client/import/text_scanner.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// The shortest lines: "0 0 0" and "0", each with its end, which the last line may lack.
constexpr size_t kShortestVertex = 6, kShortestFace = 2;

class OffFileReader {
 public:
  OffFileReader(std::string_view text, const ImportOptions& options)
      : scanner_(text), cancel_(options.cancel), fan_(0, options, &scene_.report) {}

  absl::StatusOr<ImportedScene> Read() {
    scene_.report.format = "off";
    SL_RETURN_IF_ERROR(ReadCounts());
    SL_RETURN_IF_ERROR(ReadVertices());
    SL_RETURN_IF_ERROR(ReadFaces());
    const size_t rest = scanner_.remaining();
    if (!scanner_.ContentLine('#').empty()) {
      scene_.report.warnings.push_back(
          absl::StrCat(rest, " bytes after the last face were not read"));
    }
    if (!object_.indices.empty()) scene_.objects.push_back(std::move(object_));
    return std::move(scene_);
  }

 private:
  // Takes "OFF", "COFF", "STNOFF" off the front of the line. An error for what such a keyword says
  // and this reader cannot read.
  absl::Status TakeKeyword(std::string_view* line);
  absl::Status ReadCounts();
  absl::Status ReadVertices();
  absl::Status ReadFaces();
  // The next line with content; DataLoss at the end of the file.
  absl::StatusOr<std::string_view> NextLine();

  TextScanner scanner_;
  const CancelToken* const cancel_;
  ImportedScene scene_;
  PolygonFan fan_;
  ObjectInput object_;
  uint64_t vertex_count_ = 0, face_count_ = 0;
};

absl::StatusOr<std::string_view> OffFileReader::NextLine() {
  const std::string_view line = scanner_.ContentLine('#');
  if (line.empty()) return absl::DataLossError("ends before its last vertex or face");
  return line;
}

absl::Status OffFileReader::TakeKeyword(std::string_view* line) {
  const size_t off = line->find("OFF");
  const std::string_view prefix = line->substr(0, off);
  if (off == std::string_view::npos || prefix.size() > std::string_view("STCN4n").size() ||
      prefix.find_first_not_of("STCN4n") != std::string_view::npos) {
    if (!absl::ascii_isdigit(static_cast<unsigned char>(line->front()))) {
      return absl::InvalidArgumentError(
          absl::StrCat("is no OFF file: it begins with ", Quoted(*line)));
    }
    scene_.report.warnings.emplace_back("the keyword OFF is missing");
    return absl::OkStatus();
  }
  if (prefix.find_first_of("4n") != std::string_view::npos) {
    return absl::UnimplementedError(absl::StrCat(
        Quoted(line->substr(0, off + 3)), " has other than three dimensions; write it as OFF"));
  }
  line->remove_prefix(off + 3);
  std::string_view rest = *line;
  if (EqualsIgnoreCase(TakeToken(&rest), "BINARY")) {
    return absl::UnimplementedError("is binary OFF, which is not read; write it as ASCII");
  }
  return absl::OkStatus();
}

absl::Status OffFileReader::ReadCounts() {
  SL_ASSIGN_OR_RETURN(std::string_view line, NextLine());
  SL_RETURN_IF_ERROR(TakeKeyword(&line));
  if (TrimBlanks(line).empty()) {
    SL_ASSIGN_OR_RETURN(line, NextLine());
  }
  const std::string_view whole = line;
  const std::optional<int64_t> vertices = ParseInt(TakeToken(&line));
  const std::optional<int64_t> faces =
      ParseInt(TakeToken(&line));  // The number of edges is not used.
  if (!vertices.has_value() || !faces.has_value() || *vertices < 0 || *faces < 0) {
    return absl::InvalidArgumentError(
        absl::StrCat("has no counts of vertices and faces where they belong: ", Quoted(whole)));
  }
  vertex_count_ = static_cast<uint64_t>(*vertices);
  face_count_ = static_cast<uint64_t>(*faces);
  const uint64_t most_vertices = (scanner_.remaining() + 1) / kShortestVertex;
  const uint64_t most_faces = (scanner_.remaining() + 1) / kShortestFace;
  if (vertex_count_ > most_vertices || face_count_ > most_faces) {
    return absl::DataLossError(absl::StrCat("promises ", vertex_count_, " vertices and ",
                                            face_count_, " faces, but only ", scanner_.remaining(),
                                            " bytes follow"));
  }
  if (vertex_count_ > kMaxVertices) {
    return absl::ResourceExhaustedError("holds more vertices than 32 bits can number");
  }
  return absl::OkStatus();
}

absl::Status OffFileReader::ReadVertices() {
  object_.vertices.reserve(vertex_count_);
  uint64_t malformed = 0;
  for (uint64_t i = 0; i < vertex_count_; ++i) {
    SL_RETURN_IF_ERROR(CheckWanted(cancel_, i));
    SL_ASSIGN_OR_RETURN(std::string_view line, NextLine());
    Vec3d v;
    bool whole = true;
    for (int axis = 0; axis < 3; ++axis) {
      const std::optional<double> x = ParseDouble(TakeToken(&line));
      whole &= x.has_value();
      v[axis] = x.value_or(kNaN);
    }
    malformed += !whole;
    scene_.report.non_finite_vertices += !IsFinite(v);
    object_.vertices.push_back(CanonicalVertex(v));
  }
  if (malformed > 0) {
    scene_.report.warnings.push_back(
        absl::StrCat(malformed, " vertices lack a coordinate or hold one that is no number"));
  }
  fan_.set_vertex_count(vertex_count_);
  return absl::OkStatus();
}

absl::Status OffFileReader::ReadFaces() {
  std::vector<int64_t> corners;
  for (uint64_t i = 0; i < face_count_; ++i) {
    SL_ASSIGN_OR_RETURN(std::string_view line, NextLine());
    const std::string_view whole = line;
    const std::optional<int64_t> size = ParseInt(TakeToken(&line));
    corners.clear();
    while (size.has_value() && static_cast<int64_t>(corners.size()) < *size) {
      const std::string_view token = TakeToken(&line);
      if (token.empty()) break;
      corners.push_back(ParseInt(token).value_or(PolygonFan::kBadCorner));
    }
    if (!size.has_value() || static_cast<int64_t>(corners.size()) < *size) {
      return absl::DataLossError(
          absl::StrCat("face ", i, " has fewer corners than it promises: ", Quoted(whole)));
    }
    SL_RETURN_IF_ERROR(fan_.Add(corners, &object_.indices));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<ImportedScene> ReadOff(std::string_view text, const ImportOptions& options) {
  return OffFileReader(text, options).Read();
}

}  // namespace sightline
