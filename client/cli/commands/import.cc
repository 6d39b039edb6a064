// SPDX-License-Identifier: Apache-2.0
//
// sightline import: a mesh file, compiled and built, as a native scene file. Nothing is sent to a
// server: the scene is built as a server would build it.
#include "client/import/import.h"

#include <cmath>
#include <filesystem>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "absl/time/clock.h"
#include "client/cli/build_flags.h"
#include "client/cli/commands/command.h"
#include "client/cli/exit_code.h"
#include "client/cli/native_scene.h"
#include "client/cli/scene_argument.h"
#include "core/base/status_macros.h"
#include "core/mesh/builtin/builtin.h"
#include "core/scene/scene.h"

namespace sightline::cli {
namespace {

absl::StatusOr<ImportedScene> ReadScene(const std::string& name, Context& context) {
  switch (KindOf(name)) {
    case SceneKind::kServer:
      return UsageError(absl::StrCat("'", name,
                                     "' is a scene of a server, which stores it in its own "
                                     "repository; give a file or builtin:NAME"));
    case SceneKind::kNative:
      return UsageError(absl::StrCat("'", name, "' is a native scene file already"));
    case SceneKind::kBuiltin: {
      absl::StatusOr<BuiltinSpec> spec =
          ParseBuiltin(std::string(absl::StripPrefix(name, "builtin:")));
      if (!spec.ok()) return WithExitCode(spec.status(), kExitUsage);
      absl::StatusOr<BuiltinScene> scene = MakeBuiltin(*spec, context.interruption.work());
      if (absl::IsInvalidArgument(scene.status())) return UsageError(scene.status().message());
      SL_RETURN_IF_ERROR(scene.status());
      ImportedScene made{.objects = std::move(scene->objects)};
      made.report.format = "builtin";
      return made;
    }
    case SceneKind::kFile:
      break;
  }
  SL_ASSIGN_OR_RETURN(ImportedScene imported,
                      ImportFile(name, {.cancel = context.interruption.work()}));
  WarnOfLosses(name, imported.report, context.err);
  return imported;
}

}  // namespace

absl::Status ImportCommand(std::span<const std::string> args, Context& context) {
  std::string output, out;
  BuildFlags build;
  std::optional<Vec3d> origin;
  uint64_t threads = 0;
  FlagSet flags("sightline import FILE -o FILE.slscene [flags]",
                "Reads a mesh file (or builtin:NAME), builds what answers queries, and writes both "
                "as a native scene file, which servers and commands map instead of building.");
  flags.Text("out", "FILE", "the native scene file to write, ending in .slscene; -o is the same",
             &out);
  build.Register(&flags);
  flags.Point("origin",
              "what stored floats are relative to; without it the first vertex of the first object",
              &origin);
  flags.Count("threads", "N", "threads to build with, 0: one per core", &threads, 0, 1000);
  RegisterOutput(&flags, &output);
  std::vector<std::string> long_args(args.begin(), args.end());
  for (std::string& arg : long_args) {
    if (arg == "-o") arg = "--out";
  }
  std::vector<std::string> words;
  SL_ASSIGN_OR_RETURN(bool go,
                      ParseOrHelp(&flags, long_args, {"FILE"}, SceneFileHelp(), context, &words));
  if (!go) return absl::OkStatus();
  if (!IsSceneFileName(out)) {
    return UsageError(absl::StrCat("wants -o FILE", kSceneFileEnding, "; got '", out, "'"));
  }
  const std::string& name = words[0];
  SL_RETURN_IF_ERROR(build.Check(flags, name));
  if (KindOf(name) != SceneKind::kServer) SL_RETURN_IF_ERROR(CheckSceneFileWritable(out));

  const absl::Time start = absl::Now();
  SL_ASSIGN_OR_RETURN(const ImportedScene imported, ReadScene(name, context));
  const absl::Time read = absl::Now();
  ThreadPool pool(static_cast<int>(threads));
  const SceneBuildOptions options = build.ForLibrary();
  constexpr uint64_t kParts = 1000;  // Of the whole, for the progress.
  absl::StatusOr<std::shared_ptr<const Scene>> scene;
  {
    Progress progress(context.err, context.err_is_terminal, "building", "parts", kParts);
    Mutex mutex;
    scene = BuildScene(std::filesystem::path(out).stem().string(), /*revision=*/1, imported.objects,
                       origin, options, pool, context.interruption.work(), [&](double share) {
                         MutexLock lock(mutex);
                         progress.Update(static_cast<uint64_t>(share * kParts));
                       });
  }
  if (!scene.ok()) {
    return absl::Status(scene.status().code(),
                        absl::StrCat("'", name, "': ", scene.status().message()));
  }
  const absl::Time built = absl::Now();
  {
    Progress progress(context.err, context.err_is_terminal, "writing", "parts", kParts);
    SL_RETURN_IF_ERROR(SaveSceneFile(
        **scene, out, pool, context.interruption.work(),
        [&](double share) { progress.Update(static_cast<uint64_t>(share * kParts)); }));
  }
  const absl::Time written = absl::Now();
  SL_ASSIGN_OR_RETURN(const SceneBytes file, OpenSceneFile(out));
  const MeshReport& report = (*scene)->geometry.report;

  if (output == "json") {
    Json json;
    json["command"] = "import";
    json["file"] = name;
    json["out"] = out;
    json["bytes"] = file.bytes.size();
    json["objects"] = (*scene)->geometry.objects.size();
    json["triangles"] = report.triangles;
    json["vertices"] = report.vertices;
    json["never_hit_triangles"] = report.inert_triangles;
    json["duplicate_triangles"] = report.duplicate_triangles;
    json["max_rounding"] = report.largest_rounding;
    json["import_report"] = ImportJson(imported.report);
    json["build"] = build.preset();
    json["read_seconds"] = absl::ToDoubleSeconds(read - start);
    json["build_seconds"] = absl::ToDoubleSeconds(built - read);
    json["write_seconds"] = absl::ToDoubleSeconds(written - built);
    PrintJson(json, context.out);
    return absl::OkStatus();
  }
  const double bytes_per_triangle =
      report.triangles == 0
          ? 0
          : static_cast<double>(file.bytes.size()) / static_cast<double>(report.triangles);
  PrintTable(
      {{"file", name},
       {"written", absl::StrFormat("%s: %s bytes, %.1f a triangle", out,
                                   GroupedCount(file.bytes.size()), bytes_per_triangle)},
       {"objects", GroupedCount((*scene)->geometry.objects.size())},
       {"triangles", GroupedCount(report.triangles)},
       {"vertices", GroupedCount(report.vertices)},
       {"never hit", absl::StrCat(GroupedCount(report.non_finite_triangles), " not finite, ",
                                  GroupedCount(report.zero_area_triangles), " without area")},
       {"duplicates", GroupedCount(report.duplicate_triangles)},
       {"largest rounding", absl::StrFormat("%.3g", report.largest_rounding)},
       {"time",
        absl::StrFormat("%.3f s to read, %.3f s to build, %.3f s to write",
                        absl::ToDoubleSeconds(read - start), absl::ToDoubleSeconds(built - read),
                        absl::ToDoubleSeconds(written - built))}},
      context.out);
  return absl::OkStatus();
}

}  // namespace sightline::cli
