// SPDX-License-Identifier: Apache-2.0
//
// sightline check: what a scene of a file would hold, and what is wrong with the file. Nothing is
// sent to a server: the file is read and compiled as a server would compile it.
#include <cmath>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "client/cli/commands/command.h"
#include "client/cli/exit_code.h"
#include "client/cli/scene_argument.h"
#include "client/import/import.h"
#include "core/base/status_macros.h"
#include "core/mesh/builtin/builtin.h"
#include "core/mesh/scene_geometry.h"
#include "core/scene/scene.h"

namespace sightline::cli {
namespace {

std::string PointText(Vec3d p) { return absl::StrFormat("(%.17g, %.17g, %.17g)", p.x, p.y, p.z); }
Json PointJson(Vec3d p) { return Json::array({p.x, p.y, p.z}); }

}  // namespace

absl::Status CheckCommand(std::span<const std::string> args, Context& context) {
  std::string output;
  bool with_objects = false;
  FlagSet flags(
      "sightline check FILE [flags]",
      "Reads a mesh file (or builtin:NAME) and tells what a scene of it would hold and what "
      "was wrong with it; or a native scene file, every sum and index of it.");
  flags.Switch("objects", "list its objects too", &with_objects);
  RegisterOutput(&flags, &output);
  std::vector<std::string> words;
  SL_ASSIGN_OR_RETURN(bool go,
                      ParseOrHelp(&flags, args, {"FILE"}, SceneFileHelp(), context, &words));
  if (!go) return absl::OkStatus();
  const std::string& name = words[0];

  ImportedScene imported;
  switch (KindOf(name)) {
    case SceneKind::kNative:
      return CheckSceneFile(name, with_objects, output, context);
    case SceneKind::kServer:
      return UsageError(
          absl::StrCat("'", name, "' is a scene of a server; see sightline scene show"));
    case SceneKind::kBuiltin: {
      absl::StatusOr<BuiltinSpec> spec =
          ParseBuiltin(std::string(absl::StripPrefix(name, "builtin:")));
      if (!spec.ok()) return WithExitCode(spec.status(), kExitUsage);
      absl::StatusOr<BuiltinScene> scene = MakeBuiltin(*spec, context.interruption.work());
      if (absl::IsInvalidArgument(scene.status())) return UsageError(scene.status().message());
      SL_RETURN_IF_ERROR(scene.status());
      imported.objects = std::move(scene->objects);
      imported.report.format = "builtin";
      break;
    }
    case SceneKind::kFile: {
      SL_ASSIGN_OR_RETURN(imported, ImportFile(name, {.cancel = context.interruption.work()}));
      break;
    }
  }
  absl::StatusOr<SceneGeometry> geometry =
      CompileScene(imported.objects, std::nullopt, MeshLimits{}, context.interruption.work());
  if (!geometry.ok()) {
    return absl::Status(geometry.status().code(),
                        absl::StrCat("'", name, "': ", geometry.status().message()));
  }
  const MeshReport& report = geometry->report;
  const uint64_t bytes = EstimateSceneBytes(report.triangles, report.vertices);
  const bool hittable = !geometry->bounds.empty();
  const Vec3d lo = geometry->origin + ToDouble(geometry->bounds.lo);
  const Vec3d hi = geometry->origin + ToDouble(geometry->bounds.hi);

  if (output == "json") {
    Json json;
    json["command"] = "check";
    json["file"] = name;
    json["objects"] = geometry->objects.size();
    json["triangles"] = report.triangles;
    json["vertices"] = report.vertices;
    json["origin"] = PointJson(geometry->origin);
    json["bounds"] = hittable ? Json::array({PointJson(lo), PointJson(hi)}) : Json(nullptr);
    json["memory_estimate_bytes"] = bytes;
    json["import_report"] = ImportJson(imported.report);
    Json scene;
    scene["non_finite_vertices"] = report.non_finite_vertices;
    scene["non_finite_triangles"] = report.non_finite_triangles;
    scene["zero_area_triangles"] = report.zero_area_triangles;
    scene["duplicate_triangles"] = report.duplicate_triangles;
    scene["never_hit_triangles"] = report.inert_triangles;
    scene["max_rounding"] = report.largest_rounding;
    json["scene_report"] = std::move(scene);
    if (with_objects) {
      json["object_list"] = Json::array();
      for (const ObjectRecord& object : geometry->objects) {
        json["object_list"].push_back({{"name", object.name},
                                       {"triangles", object.triangle_count},
                                       {"vertices", object.vertex_count}});
      }
    }
    PrintJson(json, context.out);
    return absl::OkStatus();
  }
  PrintTable(
      {{"file", name},
       {"format", imported.report.format},
       {"objects", GroupedCount(geometry->objects.size())},
       {"triangles", GroupedCount(report.triangles)},
       {"vertices", GroupedCount(report.vertices)},
       {"bounds",
        hittable ? absl::StrCat(PointText(lo), " .. ", PointText(hi)) : "nothing can be hit"},
       {"origin", PointText(geometry->origin)},
       {"largest rounding", absl::StrFormat("%.3g", report.largest_rounding)},
       {"memory estimate", absl::StrCat(GroupedCount(bytes), " bytes")},
       {"never hit", absl::StrCat(GroupedCount(report.non_finite_triangles), " not finite, ",
                                  GroupedCount(report.zero_area_triangles), " without area")},
       {"duplicates", GroupedCount(report.duplicate_triangles)}},
      context.out);
  if (KindOf(name) == SceneKind::kFile) {
    context.out << "\nin the file:\n";
    for (const std::string& line : DescribeReport(imported.report))
      context.out << "  " << line << '\n';
  }
  if (with_objects) {
    context.out << '\n' << absl::StreamFormat("%12s %12s  %s\n", "triangles", "vertices", "object");
    for (const ObjectRecord& object : geometry->objects) {
      context.out << absl::StreamFormat("%12s %12s  %s\n", GroupedCount(object.triangle_count),
                                        GroupedCount(object.vertex_count), object.name);
    }
  }
  return absl::OkStatus();
}

}  // namespace sightline::cli
