// SPDX-License-Identifier: Apache-2.0
#include "client/cli/commands/command.h"

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <string>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/cli/exit_code.h"
#include "client/cli/formats/file.h"
#include "core/traverse/leaf_culling.h"

namespace sightline::cli {
namespace {

Json PointJson(const client::Point3& p) { return Json::array({p[0], p[1], p[2]}); }

std::string PointText(const client::Point3& p) {
  return absl::StrFormat("(%.17g, %.17g, %.17g)", p[0], p[1], p[2]);
}

// The words of a flag, and what they mean; the first is assumed.
template <typename T>
using Word = std::pair<const char*, T>;

constexpr Word<client::Strategy> kStrategies[] = {
    {"AUTO", client::Strategy::kAuto},     {"SINGLE", client::Strategy::kSingle},
    {"PACKET", client::Strategy::kPacket}, {"SHAFT", client::Strategy::kShaft},
    {"RTT", client::Strategy::kRtt},       {"BRUTE_FORCE", client::Strategy::kBruteForce}};
constexpr Word<client::Structure> kStructures[] = {{"AUTO", client::Structure::kAuto},
                                                   {"BVH", client::Structure::kBvh},
                                                   {"KD_TREE", client::Structure::kKdTree},
                                                   {"BINARY_BVH", client::Structure::kBinaryBvh}};
constexpr Word<client::Intersector> kIntersectors[] = {
    {"exact", client::Intersector::kExact},
    {"havel-herout", client::Intersector::kHavelHerout},
    {"havel-herout-divided", client::Intersector::kHavelHeroutDivided},
    {"wald", client::Intersector::kWald},
    {"shevtsov", client::Intersector::kShevtsov},
    {"kensler-shirley", client::Intersector::kKenslerShirley},
    {"moeller-trumbore", client::Intersector::kMoellerTrumbore},
    {"havel-herout-dot-product", client::Intersector::kHavelHeroutDotProduct}};

template <typename T, size_t kCount>
std::vector<std::string> WordsOf(const Word<T> (&words)[kCount]) {
  std::vector<std::string> names;
  for (const auto& [name, value] : words) names.emplace_back(name);
  return names;
}
// REQUIRES: it is one of the words.
template <typename T, size_t kCount>
T ValueOf(const Word<T> (&words)[kCount], const std::string& name) {
  T result = words[0].second;
  for (const auto& [word, value] : words) {
    if (name == word) result = value;
  }
  return result;
}

constexpr absl::string_view kRayBoxFrom = "ray-box-from=";

// The words of --leaf-culling.
absl::Status ParseLeafCulling(const std::string& text,
                              std::optional<client::LeafCulling>* culling) {
  client::LeafCulling result;
  const std::pair<absl::string_view, bool*> switches[] = {
      {"side-planes", &result.side_planes}, {"near-far", &result.near_far_planes},
      {"aperture", &result.aperture},       {"aperture-first", &result.aperture_first},
      {"skip-edges", &result.skip_edges},   {"first-axis", &result.first_axis},
      {"ray-mask", &result.ray_mask},       {"split-to-rays", &result.split_to_rays},
      {"ray-box", &result.ray_box},         {"ray-box-fixed", &result.ray_box_fixed},
      {"mailbox", &result.mailbox},         {"cell-boxes", &result.cell_boxes}};
  for (const absl::string_view word : absl::StrSplit(text, ',')) {
    const auto found = std::find_if(std::begin(switches), std::end(switches),
                                    [&](const auto& entry) { return entry.first == word; });
    if (found != std::end(switches)) {
      *found->second = true;
    } else if (word == "rows") {
      result.frustum_rays = client::FrustumRays::kRows;
    } else if (word == "masked") {
      result.frustum_rays = client::FrustumRays::kMasked;
    } else if (word == "corner-nodes") {
      result.node_test = client::NodeTest::kCorners;
    } else if (word == "all-ray-nodes") {
      result.node_test = client::NodeTest::kAllRays;
    } else if (absl::string_view number = word; absl::ConsumePrefix(&number, kRayBoxFrom)) {
      uint32_t least = 0;
      if (!absl::SimpleAtoi(number, &least) || least < 1 || least > kMaxRayBoxMinTriangles) {
        return UsageError(absl::StrCat("'", word, "': ", kRayBoxFrom,
                                       "N takes a whole number from 1 to ",
                                       kMaxRayBoxMinTriangles));
      }
      result.ray_box = true;
      result.ray_box_min_triangles = least;
    } else {
      std::string names;
      for (const auto& [name, target] : switches) absl::StrAppend(&names, name, ", ");
      return UsageError(absl::StrCat("'", word, "' is none of ", names,
                                     "rows, masked, corner-nodes, all-ray-nodes, ray-box-from=N"));
    }
  }
  *culling = result;
  return absl::OkStatus();
}

absl::Status ParseMask(const std::string& text, uint32_t* mask) {
  const bool hex = absl::StartsWithIgnoreCase(text, "0x");
  if (hex ? absl::SimpleHexAtoi(text, mask) : absl::SimpleAtoi(text, mask)) return absl::OkStatus();
  return UsageError(absl::StrCat("'", text,
                                 "' is no mask: a whole number from 0 to 4294967295, or 0x and "
                                 "up to eight hexadecimal digits"));
}

}  // namespace

Json ImportJson(const ImportReport& r) {
  Json json;
  json["format"] = r.format;
  json["polygons"] = r.polygons;
  json["polygons_fanned"] = r.polygons_fanned;
  json["triangles"] = r.triangles;
  json["skipped_primitives"] = r.skipped_primitives;
  json["faces_too_few_corners"] = r.faces_too_few_corners;
  json["faces_bad_index"] = r.faces_bad_index;
  json["non_finite_vertices"] = r.non_finite_vertices;
  json["non_finite_triangles"] = r.non_finite_triangles;
  json["degenerate_triangles"] = r.degenerate_triangles;
  json["zero_area_triangles"] = r.zero_area_triangles;
  json["duplicate_triangles"] = r.duplicate_triangles;
  json["float_precision_loss"] = r.float_precision_loss;
  json["warnings"] = r.warnings;
  return json;
}

const char* StateName(client::SceneState state) {
  switch (state) {
    case client::SceneState::kBuilding:
      return "building";
    case client::SceneState::kReady:
      return "ready";
    case client::SceneState::kUpdating:
      return "updating";
    case client::SceneState::kFailed:
      return "failed";
    case client::SceneState::kDeleted:
      return "deleted";
    case client::SceneState::kUnloaded:
      return "unloaded";
    case client::SceneState::kUnknown:
      break;
  }
  return "unknown";
}

void RegisterOutput(FlagSet* flags, std::string* output) {
  *output = "text";
  flags->Choice("output", {"text", "json"}, "what is printed on standard output", output);
}

void PrintJson(const Json& json, std::ostream& out) {
  out << json.dump(2, ' ', /*ensure_ascii=*/false, Json::error_handler_t::replace) << '\n';
}

void StrategyFlags::Register(FlagSet* flags) {
  flags->Custom("mask", "BITS",
                "only objects whose mask shares a bit with this one are seen, and cast shadows: "
                "32 bits, as a whole number or as 0x and hexadecimal digits",
                "0xFFFFFFFF", [this](const std::string& text) { return ParseMask(text, &mask); });
  strategy = kStrategies[0].first;
  structure = kStructures[0].first;
  flags->Choice("strategy", WordsOf(kStrategies),
                "how the engine goes about it; every answer is the same bit for bit", &strategy);
  flags->Choice("structure", WordsOf(kStructures),
                "which of the scene's structures is walked; AUTO takes what the strategy needs",
                &structure);
  flags->Count(
      "rtt-antialiasing", "N",
      "with RTT: the picture will be averaged over N by N of its pixels, so that tiles are "
      "4N by 4N, and --tile should be a multiple",
      &rtt_antialiasing, 1, 6);
  flags->Switch("rtt-shared-edges",
                "with RTT: let two triangles that share an edge end a tile's corner rays, too; not "
                "in mirrors",
                &rtt_shared_edges);
  flags->Count("rtt-side-by-side", "N",
               "with RTT: tiles whose corner rays share a register; 0: as many as fit",
               &rtt_side_by_side, 0, 4);
  flags->Custom(
      "leaf-culling", "WORD,...",
      "what is left out within leaves: with PACKET side-planes, near-far, aperture, "
      "aperture-first, skip-edges, rows or masked (the frustum's rays), first-axis, ray-mask, "
      "split-to-rays, and how nodes are tested, corner-nodes or all-ray-nodes; with SINGLE "
      "ray-box, ray-box-fixed, ray-box-from=N (a ray-box in leaves of N triangles or more alone), "
      "mailbox; on KD_TREE also cell-boxes, the cells for the leaves' "
      "boxes; suns and segments are single rays with PACKET, too",
      "", [this](const std::string& text) { return ParseLeafCulling(text, &leaf_culling); });
  intersector = kIntersectors[0].first;
  flags->Choice("intersector", WordsOf(kIntersectors),
                "with SINGLE, PACKET or BRUTE_FORCE, the ray-triangle test that decides; all but "
                "exact round as they were published, havel-herout-dot-product not with PACKET",
                &intersector);
  flags->Count("packet-side", "N", "with PACKET, the pixels along a packet's side: 2, 4, 8 or 16",
               &packet_side, 2, 16);
  flags->Switch("pixel-shadow-packets",
                "with PACKET, let a packet of a picture's shadow rays be that of its pixels' "
                "square, those that hit nothing moved to its first hit",
                &pixel_shadow_packets);
}

void StrategyFlags::Apply(client::QueryOptions* options) const {
  options->mask = mask;
  options->strategy = ValueOf(kStrategies, strategy);
  options->structure = ValueOf(kStructures, structure);
  options->rtt_antialiasing = static_cast<uint32_t>(rtt_antialiasing);
  options->rtt_shared_edges = rtt_shared_edges;
  options->rtt_side_by_side = static_cast<uint32_t>(rtt_side_by_side);
  options->leaf_culling = leaf_culling;
  options->intersector = ValueOf(kIntersectors, intersector);
  options->packet_side = static_cast<uint32_t>(packet_side);
  options->pixel_shadow_packets = pixel_shadow_packets;
}

BuildFlags::Trees StrategyFlags::Trees() const {
  return {.kd_tree = strategy == "RTT" || structure == "KD_TREE",
          .binary_bvh = structure == "BINARY_BVH"};
}

absl::StatusOr<bool> ParseOrHelp(FlagSet* flags, std::span<const std::string> args,
                                 const std::vector<std::string>& word_names,
                                 const std::string& epilogue, Context& context,
                                 std::vector<std::string>* words) {
  absl::StatusOr<std::vector<std::string>> parsed = flags->Parse(args);
  if (!parsed.ok()) return parsed.status();
  if (flags->help_requested()) {
    context.out << flags->Help();
    if (!epilogue.empty()) context.out << '\n' << epilogue;
    context.out << '\n' << ExitCodeHelp();
    return false;
  }
  if (parsed->size() != word_names.size()) {
    if (parsed->size() > word_names.size()) {
      return UsageError(absl::StrCat("unexpected '", (*parsed)[word_names.size()], "'"));
    }
    return UsageError(absl::StrCat("wants ", absl::StrJoin(word_names, " ")));
  }
  *words = *std::move(parsed);
  return true;
}

absl::Status CheckOutputs(std::initializer_list<std::string> paths) {
  for (const std::string& path : paths) {
    if (path.empty()) continue;
    if (absl::Status s = CheckWritable(path); !s.ok()) return WithExitCode(s, kExitCannotCreate);
  }
  return absl::OkStatus();
}

absl::Status CheckAnswers(uint64_t lights, uint64_t places, absl::string_view what,
                          absl::string_view remedy) {
  constexpr uint64_t kMost = uint64_t{1} << 32;
  if (places == 0 || lights <= kMost / places) return absl::OkStatus();
  return UsageError(absl::StrCat(lights, " lights at ", places, " ", what, " are ", lights * places,
                                 " answers; at most ", kMost, " are kept: ", remedy));
}

Json SunsJson(const LightFlags& lights) {
  Json json = Json::array();
  for (const TimedSun& sun : lights.timed_suns()) {
    json.push_back({{"at", sun.text},
                    {"altitude_deg", sun.position.altitude_degrees},
                    {"azimuth_deg", sun.position.azimuth_degrees}});
  }
  return json;
}

void AddSunRows(const LightFlags& lights, std::vector<std::pair<std::string, std::string>>* rows) {
  for (const TimedSun& sun : lights.timed_suns()) {
    rows->emplace_back(
        absl::StrCat("sun at ", sun.text),
        absl::StrFormat("altitude %.2f, azimuth %.2f degrees", sun.position.altitude_degrees,
                        sun.position.azimuth_degrees));
  }
}

Json SceneJson(const client::Scene& scene) {
  Json json;
  json["name"] = scene.name;
  json["state"] = StateName(scene.state);
  if (!scene.state_message.empty()) json["state_message"] = scene.state_message;
  json["stored"] = scene.stored;
  json["revision"] = scene.revision;
  json["objects"] = scene.objects;
  json["triangles"] = scene.triangles;
  json["vertices"] = scene.vertices;
  json["origin"] = PointJson(scene.origin);
  if (scene.bounds) {
    json["bounds"] = Json::array({PointJson((*scene.bounds)[0]), PointJson((*scene.bounds)[1])});
  } else {
    json["bounds"] = nullptr;
  }
  Json report;
  report["non_finite_vertices"] = scene.report.non_finite_vertices;
  report["non_finite_triangles"] = scene.report.non_finite_triangles;
  report["zero_area_triangles"] = scene.report.zero_area_triangles;
  report["duplicate_triangles"] = scene.report.duplicate_triangles;
  report["max_rounding"] = scene.report.max_rounding;
  report["compile_seconds"] = absl::ToDoubleSeconds(scene.report.compile_time);
  report["structure_seconds"] = absl::ToDoubleSeconds(scene.report.structure_time);
  report["nodes"] = scene.report.nodes;
  report["leaves"] = scene.report.leaves;
  report["depth"] = scene.report.depth;
  report["refitted"] = scene.report.refitted;
  report["resident_bytes"] = scene.report.resident_bytes;
  if (scene.report.binary_bvh_nodes > 0) {
    report["binary_bvh"] = {{"nodes", scene.report.binary_bvh_nodes},
                            {"leaves", scene.report.binary_bvh_leaves},
                            {"depth", scene.report.binary_bvh_depth},
                            {"bytes", scene.report.binary_bvh_bytes},
                            {"seconds", absl::ToDoubleSeconds(scene.report.binary_bvh_time)}};
  }
  if (scene.report.kd_tree_nodes > 0) {
    report["kd_tree"] = {{"nodes", scene.report.kd_tree_nodes},
                         {"leaves", scene.report.kd_tree_leaves},
                         {"references", scene.report.kd_tree_references},
                         {"depth", scene.report.kd_tree_depth},
                         {"bytes", scene.report.kd_tree_bytes},
                         {"seconds", absl::ToDoubleSeconds(scene.report.kd_tree_time)}};
  }
  json["build_report"] = std::move(report);
  if (scene.create_time != absl::InfinitePast()) {
    json["create_time"] = absl::FormatTime(scene.create_time, absl::UTCTimeZone());
  }
  if (scene.update_time != absl::InfinitePast()) {
    json["update_time"] = absl::FormatTime(scene.update_time, absl::UTCTimeZone());
  }
  return json;
}

void PrintScene(const client::Scene& scene, std::ostream& out) {
  const client::BuildReport& report = scene.report;
  std::vector<std::pair<std::string, std::string>> rows = {
      {"scene", scene.name},
      {"state", absl::StrCat(StateName(scene.state), scene.state_message.empty() ? "" : ": ",
                             scene.state_message)},
      {"revision", absl::StrCat(scene.revision, scene.stored ? ", stored" : "")},
      {"objects", GroupedCount(scene.objects)},
      {"triangles", GroupedCount(scene.triangles)},
      {"vertices", GroupedCount(scene.vertices)},
      {"origin", PointText(scene.origin)},
      {"bounds", scene.bounds ? absl::StrCat(PointText((*scene.bounds)[0]), " .. ",
                                             PointText((*scene.bounds)[1]))
                              : "nothing can be hit"},
      {"never hit", absl::StrCat(GroupedCount(report.non_finite_triangles), " not finite, ",
                                 GroupedCount(report.zero_area_triangles), " without area")},
      {"duplicates", GroupedCount(report.duplicate_triangles)},
      {"largest rounding", absl::StrFormat("%.3g", report.max_rounding)},
      {"build time", absl::StrFormat("%.3f s", absl::ToDoubleSeconds(report.compile_time +
                                                                     report.structure_time))},
      {"memory", absl::StrCat(GroupedCount(report.resident_bytes), " bytes")}};
  if (report.kd_tree_nodes > 0) {
    rows.emplace_back("kd-tree",
                      absl::StrCat(GroupedCount(report.kd_tree_nodes), " nodes, ",
                                   GroupedCount(report.kd_tree_references), " triangles in ",
                                   GroupedCount(report.kd_tree_leaves), " leaves, ",
                                   GroupedCount(report.kd_tree_bytes), " bytes"));
  }
  if (report.binary_bvh_nodes > 0) {
    rows.emplace_back("binary BVH",
                      absl::StrCat(GroupedCount(report.binary_bvh_nodes), " nodes, ",
                                   GroupedCount(report.binary_bvh_leaves), " leaves, ",
                                   GroupedCount(report.binary_bvh_bytes), " bytes"));
  }
  PrintTable(rows, out);
}

double EngineRate(const client::StreamSummary& summary, uint32_t threads) {
  const double seconds = absl::ToDoubleSeconds(summary.statistics.compute) / std::max(1u, threads);
  return seconds > 0 ? static_cast<double>(summary.statistics.rays) / seconds : 0;
}

double ClientRate(const client::StreamSummary& summary) {
  const double seconds = absl::ToDoubleSeconds(summary.elapsed);
  const uint64_t rays = summary.statistics.rays > 0 ? summary.statistics.rays : summary.rays;
  return seconds > 0 ? static_cast<double>(rays) / seconds : 0;
}

void AddSummaryJson(const client::StreamSummary& summary, uint32_t threads, Json* json) {
  Json& j = *json;
  j["items"] = summary.items;
  j["resent_items"] = summary.resent_items;
  j["rays_asked"] = summary.rays;
  j["rays"] = summary.statistics.rays;
  for (const auto& [name, value] : kStrategies) {
    if (value == summary.statistics.strategy) j["strategy"] = name;
  }
  j["seconds"] = absl::ToDoubleSeconds(summary.elapsed);
  j["compute_thread_seconds"] = absl::ToDoubleSeconds(summary.statistics.compute);
  j["threads"] = threads;
  j["rays_per_s_engine"] = EngineRate(summary, threads);
  j["rays_per_s_client"] = ClientRate(summary);
  j["nodes"] = summary.statistics.nodes;
  j["leaves"] = summary.statistics.leaves;
  j["triangle_tests"] = summary.statistics.triangle_tests;
  j["double_tests"] = summary.statistics.double_tests;
  j["exact_tests"] = summary.statistics.exact_tests;
  j["answered_by"] = {{"shaft", summary.statistics.answered_by_shaft},
                      {"triangles", summary.statistics.answered_by_triangles},
                      {"packet", summary.statistics.answered_by_packet},
                      {"ray", summary.statistics.answered_by_ray}};
  if (summary.statistics.tiles > 0) {
    j["tiles"] = summary.statistics.tiles;
    j["tiles_answered"] = summary.statistics.tiles_answered;
    j["relevant_triangles"] = summary.statistics.relevant_triangles;
  }
  if (summary.statistics.culled_tests > 0) j["culled_tests"] = summary.statistics.culled_tests;
  if (summary.statistics.shaft_triangles > 0) {
    j["shaft"] = {{"triangles", summary.statistics.shaft_triangles},
                  {"relevant", summary.statistics.shaft_relevant},
                  {"pairs", summary.statistics.shaft_pairs},
                  {"covers", summary.statistics.shaft_covers},
                  {"splits", summary.statistics.shaft_splits},
                  {"singles", summary.statistics.shaft_singles}};
  }
  j["bytes_received"] = summary.bytes_received;
  j["bytes_sent"] = summary.bytes_sent;
}

void PrintTable(const std::vector<std::pair<std::string, std::string>>& rows, std::ostream& out) {
  size_t width = 0;
  for (const auto& [name, value] : rows) width = std::max(width, name.size());
  for (const auto& [name, value] : rows) {
    out << name << std::string(width + 2 - name.size(), ' ') << value << '\n';
  }
}

std::string Percent(double share) { return absl::StrFormat("%.1f %%", 100.0 * share); }

}  // namespace sightline::cli
