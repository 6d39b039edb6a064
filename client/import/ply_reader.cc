// SPDX-License-Identifier: Apache-2.0
#include "client/import/ply_reader.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"
#include "client/import/ply_body.h"
#include "client/import/ply_header.h"
#include "client/import/polygon_fan.h"
#include "client/import/text_scanner.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// Whether the body can hold the elements that the header promises.
absl::Status CheckCount(const PlyElement& element, const PlyBody& body) {
  const uint64_t most = body.MostElements(element);
  if (element.count > most) {
    return absl::DataLossError(absl::StrCat("the header promises ", element.count, " elements \"",
                                            element.name,
                                            "\", but the bytes that follow hold at most ", most));
  }
  if (element.name == "vertex" && element.count > kMaxVertices) {
    return absl::ResourceExhaustedError("holds more vertices than 32 bits can number");
  }
  return absl::OkStatus();
}

absl::Status SkipElement(const PlyElement& element, PlyBody* body, const CancelToken* cancel) {
  // Without a property there is nothing to read, however many there are.
  for (uint64_t i = 0; i < element.count && !element.properties.empty() && body->ok(); ++i) {
    SL_RETURN_IF_ERROR(CheckWanted(cancel, i));
    for (const PlyProperty& property : element.properties) body->Skip(property);
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<Vec3d>> ReadVertices(const PlyElement& element, PlyBody* body,
                                                const CancelToken* cancel) {
  std::vector<int> axis_of(element.properties.size(), -1);
  constexpr std::array<std::string_view, 3> kAxes{"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis) {
    const int at = element.Find(kAxes[axis]);
    if (at < 0 || element.properties[at].is_list) {
      return absl::InvalidArgumentError(
          absl::StrCat("its vertices have no scalar property \"", ToAbsl(kAxes[axis]), "\""));
    }
    axis_of[at] = axis;
  }
  std::vector<Vec3d> vertices;
  vertices.reserve(element.count);  // Held against the bytes by CheckCount.
  for (uint64_t i = 0; i < element.count && body->ok(); ++i) {
    SL_RETURN_IF_ERROR(CheckWanted(cancel, i));
    Vec3d v;
    for (size_t p = 0; p < element.properties.size(); ++p) {
      if (axis_of[p] < 0) {
        body->Skip(element.properties[p]);
      } else {
        v[axis_of[p]] = body->Scalar(element.properties[p].type);
      }
    }
    vertices.push_back(CanonicalVertex(v));
  }
  return vertices;
}

int64_t CornerOf(double value) {
  return value >= 0 && value < 0x1p32 && value == std::floor(value) ? static_cast<int64_t>(value)
                                                                    : PolygonFan::kBadCorner;
}

// Of a strip: begins a new one. Of all values that are no index, -1 alone does.
constexpr int64_t kRestart = -2;

int64_t StripCornerOf(double value) { return value == -1 ? kRestart : CornerOf(value); }

// Reads the elements in file order; faces become triangles at once where the vertices came first,
// which is the rule, and wait for them otherwise.
class PlyFileReader {
 public:
  PlyFileReader(const PlyHeader& header, std::string_view bytes, const ImportOptions& options)
      : header_(header),
        body_(bytes, header),
        cancel_(options.cancel),
        fan_(0, options, &scene_.report) {}

  absl::StatusOr<ImportedScene> Read();

 private:
  absl::Status ReadFaces(const PlyElement& element);
  absl::Status AddFace(const std::vector<int64_t>& corners);
  absl::Status AddStrip(const std::vector<int64_t>& corners);

  const PlyHeader& header_;
  PlyBody body_;
  const CancelToken* const cancel_;
  ImportedScene scene_;
  PolygonFan fan_;
  ObjectInput object_;
};

absl::Status PlyFileReader::AddStrip(const std::vector<int64_t>& corners) {
  size_t start = 0;  // Of the strip in hand.
  for (size_t i = 0; i < corners.size(); ++i) {
    if (corners[i] == kRestart) {
      start = i + 1;
    } else if (i >= start + 2) {
      const bool odd = (i - start) % 2 != 0;  // Every other triangle of a strip is turned over.
      SL_RETURN_IF_ERROR(fan_.Add(
          std::array{corners[i - 2 + odd], corners[i - 1 - odd], corners[i]}, &object_.indices));
    }
  }
  return absl::OkStatus();
}

absl::Status PlyFileReader::ReadFaces(const PlyElement& element) {
  int list = element.Find("vertex_indices");
  if (list < 0) list = element.Find("vertex_index");
  if (list < 0 || !element.properties[list].is_list) {
    if (element.count == 0) return absl::OkStatus();
    return absl::InvalidArgumentError(
        absl::StrCat("its elements \"", element.name, "\" have no list \"vertex_indices\""));
  }
  const auto corner_of = element.name == "face" ? CornerOf : StripCornerOf;
  std::vector<int64_t> corners;
  for (uint64_t i = 0; i < element.count && body_.ok(); ++i) {
    SL_RETURN_IF_ERROR(CheckWanted(cancel_, i));
    for (size_t p = 0; p < element.properties.size(); ++p) {
      const PlyProperty& property = element.properties[p];
      if (static_cast<int>(p) != list) {
        body_.Skip(property);
        continue;
      }
      const uint64_t size = body_.ListSize(property);
      corners.clear();
      for (uint64_t c = 0; c < size; ++c) corners.push_back(corner_of(body_.Scalar(property.type)));
    }
    if (!body_.ok()) break;
    SL_RETURN_IF_ERROR(element.name == "face" ? fan_.Add(corners, &object_.indices)
                                              : AddStrip(corners));
  }
  return absl::OkStatus();
}

absl::StatusOr<ImportedScene> PlyFileReader::Read() {
  ImportReport& report = scene_.report;
  report.format = header_.encoding == PlyHeader::Encoding::kAscii ? "ply ascii" : "ply binary";
  // The fan needs the vertices' number; the header knows it, and a body that holds fewer is an
  // error.
  for (const PlyElement& element : header_.elements) {
    if (element.name == "vertex") fan_.set_vertex_count(std::min(element.count, kMaxVertices));
  }
  bool has_vertices = false;
  for (const PlyElement& element : header_.elements) {
    SL_RETURN_IF_ERROR(CheckCount(element, body_));
    if (element.name == "vertex") {
      if (has_vertices) return absl::InvalidArgumentError("has two elements \"vertex\"");
      has_vertices = true;
      SL_ASSIGN_OR_RETURN(object_.vertices, ReadVertices(element, &body_, cancel_));
    } else if (element.name == "face" || element.name == "tristrips") {
      SL_RETURN_IF_ERROR(ReadFaces(element));
    } else {
      if (element.name == "edge") report.skipped_primitives += element.count;
      SL_RETURN_IF_ERROR(SkipElement(element, &body_, cancel_));
    }
    if (!body_.ok()) return body_.error();
  }
  if (const uint64_t unread = body_.Unread(); unread > 0) {
    report.warnings.push_back(absl::StrCat(unread, " bytes after the last element were not read"));
  }
  for (const Vec3d& v : object_.vertices) report.non_finite_vertices += !IsFinite(v);
  if (!object_.indices.empty()) scene_.objects.push_back(std::move(object_));
  return std::move(scene_);
}

}  // namespace

absl::StatusOr<ImportedScene> ReadPly(std::string_view bytes, const ImportOptions& options) {
  SL_ASSIGN_OR_RETURN(const PlyHeader header, ParsePlyHeader(bytes));
  return PlyFileReader(header, bytes, options).Read();
}

absl::StatusOr<std::vector<Vec3d>> ReadPlyPoints(std::string_view bytes,
                                                 const CancelToken* cancel) {
  SL_ASSIGN_OR_RETURN(const PlyHeader header, ParsePlyHeader(bytes));
  PlyBody body(bytes, header);
  for (const PlyElement& element : header.elements) {
    SL_RETURN_IF_ERROR(CheckCount(element, body));
    if (element.name == "vertex") {
      SL_ASSIGN_OR_RETURN(std::vector<Vec3d> points, ReadVertices(element, &body, cancel));
      if (!body.ok()) return body.error();
      return points;
    }
    SL_RETURN_IF_ERROR(SkipElement(element, &body, cancel));
    if (!body.ok()) return body.error();
  }
  return absl::InvalidArgumentError("has no element \"vertex\"");
}

}  // namespace sightline
