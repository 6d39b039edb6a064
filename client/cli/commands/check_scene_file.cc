// SPDX-License-Identifier: Apache-2.0
//
// sightline check FILE.slscene: every check that a server makes, and what the file holds.
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/commands/command.h"
#include "client/cli/native_scene.h"
#include "core/base/status_macros.h"

namespace sightline::cli {

absl::Status CheckSceneFile(const std::string& path, bool with_objects, const std::string& output,
                            Context& context) {
  SL_ASSIGN_OR_RETURN(const SceneBytes file, OpenSceneFile(path));
  SL_ASSIGN_OR_RETURN(const SceneFileInfo info, InspectSceneFile(file));
  ThreadPool pool(0);
  const absl::Time start = absl::Now();
  SL_ASSIGN_OR_RETURN(const std::shared_ptr<const Scene> scene,
                      LoadScene(file, path, {}, pool, context.interruption.work()));
  const double seconds = absl::ToDoubleSeconds(absl::Now() - start);
  const MeshReport& report = scene->geometry.report;

  if (output == "json") {
    Json json;
    json["command"] = "check";
    json["file"] = path;
    json["format"] = "slscene";
    json["version"] = info.version;
    json["bytes"] = info.file_bytes;
    json["revision"] = info.revision;
    json["objects"] = info.objects;
    json["triangles"] = info.triangles;
    json["vertices"] = info.vertices;
    json["never_hit_triangles"] = report.inert_triangles;
    json["duplicate_triangles"] = report.duplicate_triangles;
    json["max_rounding"] = report.largest_rounding;
    json["nodes"] = scene->bvh.nodes.size();
    json["check_seconds"] = seconds;
    json["sections"] = Json::array();
    for (const SceneFileSection& section : info.sections) {
      json["sections"].push_back({{"name", std::string(SectionName(section.kind))},
                                  {"offset", section.offset},
                                  {"elements", section.count},
                                  {"bytes", section.count * section.element_bytes},
                                  {"sum", absl::StrFormat("%016x", section.sum)}});
    }
    if (with_objects) {
      json["object_list"] = Json::array();
      for (const ObjectRecord& object : scene->geometry.objects) {
        json["object_list"].push_back({{"name", object.name},
                                       {"triangles", object.triangle_count},
                                       {"vertices", object.vertex_count}});
      }
    }
    PrintJson(json, context.out);
    return absl::OkStatus();
  }
  PrintTable(
      {{"file", path},
       {"format", absl::StrCat("native scene, version ", info.version)},
       {"bytes", GroupedCount(info.file_bytes)},
       {"revision", absl::StrCat(info.revision)},
       {"objects", GroupedCount(info.objects)},
       {"triangles", GroupedCount(info.triangles)},
       {"vertices", GroupedCount(info.vertices)},
       {"never hit", absl::StrCat(GroupedCount(report.non_finite_triangles), " not finite, ",
                                  GroupedCount(report.zero_area_triangles), " without area")},
       {"duplicates", GroupedCount(report.duplicate_triangles)},
       {"checked", absl::StrFormat("sums, indices, boxes and tree in %.3f s", seconds)}},
      context.out);
  context.out << '\n'
              << absl::StreamFormat("%-16s %14s %16s %16s  %s\n", "section", "elements", "offset",
                                    "bytes", "sum");
  for (const SceneFileSection& section : info.sections) {
    context.out << absl::StreamFormat(
        "%-16s %14s %16s %16s  %016x\n", std::string(SectionName(section.kind)),
        GroupedCount(section.count), GroupedCount(section.offset),
        GroupedCount(section.count * section.element_bytes), section.sum);
  }
  if (with_objects) {
    context.out << '\n' << absl::StreamFormat("%12s %12s  %s\n", "triangles", "vertices", "object");
    for (const ObjectRecord& object : scene->geometry.objects) {
      context.out << absl::StreamFormat("%12s %12s  %s\n", GroupedCount(object.triangle_count),
                                        GroupedCount(object.vertex_count), object.name);
    }
  }
  return absl::OkStatus();
}

}  // namespace sightline::cli
