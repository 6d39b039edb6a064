// SPDX-License-Identifier: Apache-2.0
#include "client/import/stl_reader.h"

#include <cstring>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/import/polygon_fan.h"
#include "client/import/position_table.h"
#include "client/import/text_scanner.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

constexpr size_t kBinaryHeader = 80, kBinaryPrefix = 84, kBinaryTriangle = 50;

// One object under construction: corners in, shared vertices and triangles out.
class SolidBuilder {
 public:
  SolidBuilder(const ImportOptions& options, ImportReport* report)
      : fan_(kMaxVertices, options, report), report_(report) {}

  int64_t AddVertex(Vec3d v) {
    report_->non_finite_vertices += !IsFinite(v);
    return table_.Insert(CanonicalVertex(v));
  }

  absl::Status AddFace(const std::vector<int64_t>& corners) {
    if (table_.positions().size() >= kMaxVertices - corners.size()) {
      return absl::ResourceExhaustedError("holds more vertices than 32 bits can number");
    }
    return fan_.Add(corners, &object_.indices);
  }

  // Appends the object, if it has a triangle, and starts the next one.
  void Finish(std::string_view name, ImportedScene* scene) {
    object_.name = std::string(name);
    object_.vertices = table_.TakePositions();
    if (!object_.indices.empty()) scene->objects.push_back(std::move(object_));
    object_ = {};
    table_ = {};
  }

 private:
  PolygonFan fan_;
  ImportReport* const report_;
  PositionTable table_;
  ObjectInput object_;
};

absl::StatusOr<ImportedScene> ReadBinary(std::string_view bytes, const ImportOptions& options) {
  uint32_t count = 0;
  std::memcpy(&count, bytes.data() + kBinaryHeader, sizeof(count));
  const uint64_t needed = kBinaryPrefix + kBinaryTriangle * uint64_t{count};
  if (bytes.size() < needed) {
    return absl::DataLossError(absl::StrCat("is cut short: ", count, " triangles take ", needed,
                                            " bytes, the file has ", bytes.size()));
  }
  ImportedScene scene;
  scene.report.format = "stl binary";
  if (bytes.size() > needed) {
    scene.report.warnings.push_back(
        absl::StrCat(bytes.size() - needed, " bytes after the last triangle were not read"));
  }
  SolidBuilder solid(options, &scene.report);
  std::vector<int64_t> corners(3);
  for (uint64_t i = 0; i < count; ++i) {
    // A normal, three corners, two bytes of attributes.
    float f[12];
    std::memcpy(f, bytes.data() + kBinaryPrefix + kBinaryTriangle * i, sizeof(f));
    for (int c = 0; c < 3; ++c) {
      corners[c] = solid.AddVertex({f[3 + 3 * c], f[4 + 3 * c], f[5 + 3 * c]});
    }
    SL_RETURN_IF_ERROR(solid.AddFace(corners));
  }
  solid.Finish("", &scene);
  return scene;
}

class AsciiReader {
 public:
  AsciiReader(std::string_view text, const ImportOptions& options)
      : scanner_(text), cancel_(options.cancel), solid_(options, &scene_.report) {}

  absl::StatusOr<ImportedScene> Read() {
    scene_.report.format = "stl ascii";
    for (uint64_t lines = 0; !scanner_.AtEnd(); ++lines) {
      SL_RETURN_IF_ERROR(CheckWanted(cancel_, lines));
      std::string_view line = scanner_.RestOfLine();
      const std::string_view keyword = TakeToken(&line);
      if (!keyword.empty()) SL_RETURN_IF_ERROR(Statement(keyword, line));
    }
    // Vertices may come without the facet around them.
    if (in_facet_ || !corners_.empty()) return absl::DataLossError("ends inside a facet");
    if (in_solid_) scene_.report.warnings.emplace_back("the last solid has no endsolid");
    solid_.Finish(name_, &scene_);
    if (not_understood_ > 0) {
      scene_.report.warnings.push_back(absl::StrCat(not_understood_, " lines were not understood"));
    }
    return std::move(scene_);
  }

 private:
  absl::Status Statement(std::string_view keyword, std::string_view line) {
    if (EqualsIgnoreCase(keyword, "vertex")) {
      Vec3d v;
      for (int axis = 0; axis < 3; ++axis) v[axis] = ParseDouble(TakeToken(&line)).value_or(kNaN);
      corners_.push_back(solid_.AddVertex(v));
    } else if (EqualsIgnoreCase(keyword, "endloop")) {
      SL_RETURN_IF_ERROR(solid_.AddFace(corners_));
      corners_.clear();
    } else if (EqualsIgnoreCase(keyword, "facet")) {
      in_facet_ = true;
    } else if (EqualsIgnoreCase(keyword, "endfacet")) {
      in_facet_ = false;
      // Vertices without the loop around them.
      if (!corners_.empty()) SL_RETURN_IF_ERROR(solid_.AddFace(corners_));
      corners_.clear();
    } else if (EqualsIgnoreCase(keyword, "solid")) {
      if (!corners_.empty()) return absl::DataLossError("a solid begins inside a facet");
      solid_.Finish(name_, &scene_);
      name_ = TrimBlanks(line);
      in_solid_ = true;
    } else if (EqualsIgnoreCase(keyword, "endsolid")) {
      if (!corners_.empty()) return absl::DataLossError("a solid ends inside a facet");
      solid_.Finish(name_, &scene_);
      name_ = {};
      in_solid_ = false;
    } else if (!EqualsIgnoreCase(keyword, "outer")) {
      ++not_understood_;
    }
    return absl::OkStatus();
  }

  TextScanner scanner_;
  const CancelToken* const cancel_;
  ImportedScene scene_;
  SolidBuilder solid_;
  std::string_view name_;
  std::vector<int64_t> corners_;
  bool in_solid_ = false, in_facet_ = false;
  uint64_t not_understood_ = 0;
};

bool IsBinary(std::string_view bytes) {
  if (bytes.size() >= kBinaryPrefix) {
    uint32_t count = 0;
    std::memcpy(&count, bytes.data() + kBinaryHeader, sizeof(count));
    if (bytes.size() == kBinaryPrefix + kBinaryTriangle * uint64_t{count}) return true;
  }
  std::string_view text = bytes;
  const bool solid = EqualsIgnoreCase(TakeToken(&text), "solid");
  return !solid || bytes.find('\0') != std::string_view::npos;
}

}  // namespace

absl::StatusOr<ImportedScene> ReadStl(std::string_view bytes, const ImportOptions& options) {
  if (!IsBinary(bytes)) return AsciiReader(bytes, options).Read();
  if (bytes.size() < kBinaryPrefix) {
    return absl::DataLossError(
        "is no STL file: it neither begins with \"solid\" nor holds the 84 bytes of a binary "
        "header");
  }
  return ReadBinary(bytes, options);
}

}  // namespace sightline
