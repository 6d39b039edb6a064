// SPDX-License-Identifier: Apache-2.0
#include "tests/policy/room_rules.h"

#include <algorithm>
#include <iterator>

namespace sightline::policy {
namespace {

// From the top down. `target` is what the names of the room's targets begin with.
struct Room {
  std::string_view folder;
  std::string_view target;
};
constexpr Room kRooms[] = {
    {"proto", "sightline_proto"},
    {"core/base", "sightline_core_base"},
    {"core/geometry", "sightline_core_geometry"},
    {"core/mesh", "sightline_core_mesh"},
    {"core/intersect", "sightline_core_intersect"},
    {"core/accel", "sightline_core_accel"},
    {"core/shaft", "sightline_core_shaft"},
    {"core/traverse", "sightline_core_traverse"},
    {"core/light", "sightline_core_light"},
    {"core/query", "sightline_core_query"},
    {"core/scene", "sightline_core_scene"},
    {"client/lib", "sightline_client"},
    {"client/import", "sightline_import"},
    {"server", "sightline_server"},
    {"client/cli", "sightline_cli"},
    {"client/load", "sightline_load"},
    {"client/python", "sightline_python"},
    {"tests", "sightline_test_support"},
};

// Targets whose names do not begin with their room's.
constexpr Room kOtherTargets[] = {
    {"core/mesh", "sightline_core_builtin"},
    {"server", "sightlined"},
};

// What a room must not use although it stands above it: the engine knows no wire, the client
// library needs the wire alone, the importers make plain arrays, the server parses no mesh file.
struct Exclusion {
  std::string_view user;
  std::string_view used;
};
constexpr Exclusion kExclusions[] = {
    {"core/", "proto"},
    {"client/lib", "core/"},
    // The importers.
    {"client/import", "proto"},
    {"client/import", "client/lib"},
    {"server", "client/"},
};

// Libraries outside the tree that some rooms must not include, by the beginning of the header's
// name.
struct Ban {
  std::string_view user;
  std::string_view header;
  std::string_view except;  // A file that may.
  std::string_view reason;
};
constexpr std::string_view kWire = "the engine knows no wire";
constexpr std::string_view kFormats = "file formats are read in client/import";
constexpr std::string_view kSeam = "TBB is used through core/base/parallel.h";
constexpr std::string_view kLocks = "lock through core/base/mutex.h";
constexpr Ban kBans[] = {
    {"core/", "grpc", "", kWire},
    {"core/", "google/protobuf", "", kWire},
    {"core/", "sightline/v1/", "", kWire},
    {"core/", "assimp/", "", kFormats},
    {"core/", "tiny_", "", kFormats},
    {"core/", "nlohmann/", "", kFormats},
    {"core/", "png.h", "", kFormats},
    {"core/", "lzma.h", "", kFormats},
    {"server/", "assimp/", "", kFormats},
    {"server/", "tiny_", "", kFormats},
    {"server/", "nlohmann/", "", kFormats},
    {"server/", "png.h", "", kFormats},
    {"server/", "lzma.h", "", kFormats},
    {"core/", "tbb/", "", kSeam},
    {"core/", "oneapi/", "core/base/tbb_seam.cc", kSeam},
    {"server/", "tbb/", "", kSeam},
    {"server/", "oneapi/", "", kSeam},
    {"core/", "mutex", "core/base/mutex.h", kLocks},
    {"core/", "condition_variable", "core/base/mutex.h", kLocks},
    {"core/", "absl/synchronization/", "", kLocks},
    {"server/", "mutex", "", kLocks},
    {"server/", "condition_variable", "", kLocks},
    {"server/", "absl/synchronization/", "", kLocks},
};

size_t IndexOf(std::string_view folder) {
  const Room* const room = std::ranges::find(kRooms, folder, &Room::folder);
  return static_cast<size_t>(std::distance(std::begin(kRooms), room));
}

// The name within an #include line, or nothing.
std::string_view IncludedName(std::string_view line) {
  const size_t start = line.find_first_not_of(" \t");
  if (start == std::string_view::npos || line[start] != '#') return {};
  line.remove_prefix(start + 1);
  line.remove_prefix(std::min(line.find_first_not_of(" \t"), line.size()));
  if (!line.starts_with("include")) return {};
  const size_t open = line.find_first_of("\"<");
  if (open == std::string_view::npos) return {};
  const size_t close = line.find_first_of("\">", open + 1);
  if (close == std::string_view::npos) return {};
  return line.substr(open + 1, close - open - 1);
}

std::string Explain(std::string_view user, std::string_view used) {
  return std::string(user) + " must not use " + std::string(used);
}

}  // namespace

std::optional<std::string_view> RoomOfPath(std::string_view path) {
  if (path.starts_with("sightline/v1/")) return "proto";  // Generated headers.
  for (const Room& room : kRooms) {
    if (path.starts_with(room.folder) && path.size() > room.folder.size() &&
        path[room.folder.size()] == '/') {
      return room.folder;
    }
  }
  return std::nullopt;
}

std::optional<std::string_view> RoomOfTarget(std::string_view target) {
  const Room* const other = std::ranges::find(kOtherTargets, target, &Room::target);
  if (other != std::end(kOtherTargets)) return other->folder;
  for (const Room& room : kRooms) {
    if (target == room.target || target.starts_with(std::string(room.target) + "_")) {
      return room.folder;
    }
  }
  return std::nullopt;
}

bool MayUse(std::string_view user, std::string_view used) {
  if (user == used) return true;
  const bool excluded = std::ranges::any_of(kExclusions, [&](const Exclusion& exclusion) {
    return user.starts_with(exclusion.user) && used.starts_with(exclusion.used);
  });
  return !excluded && IndexOf(used) < IndexOf(user);
}

std::vector<std::string> FindIncludeViolations(const SourceFile& file) {
  std::vector<std::string> found;
  const std::optional<std::string_view> user = RoomOfPath(file.path);
  if (!user || !file.IsCpp()) return found;
  for (size_t i = 0; i < file.lines.size(); ++i) {
    const std::string_view name = IncludedName(file.lines[i]);
    if (name.empty()) continue;
    if (const auto used = RoomOfPath(name); used && !MayUse(*user, *used)) {
      found.push_back(Finding(file, i + 1, Explain(*user, *used)));
    }
    for (const Ban& ban : kBans) {
      // "mutex" bans <mutex>, not "mutex_something/x.h"; the others are folders or prefixes.
      const bool whole =
          ban.header.find_first_of("/_.") == std::string_view::npos && ban.header != "grpc";
      const bool named = whole ? name == ban.header : name.starts_with(ban.header);
      if (named && file.IsUnder(ban.user) && file.path != ban.except) {
        found.push_back(Finding(file, i + 1, std::string(name) + ": " + std::string(ban.reason)));
      }
    }
  }
  return found;
}

std::vector<std::string> FindTargetViolations(const SourceFile& file) {
  std::vector<std::string> found;
  const std::optional<std::string_view> user = RoomOfPath(file.path);
  if (!user || !file.HasExtension("CMakeLists.txt")) return found;
  constexpr std::string_view kWord =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_";
  for (size_t i = 0; i < file.lines.size(); ++i) {
    std::string_view line = file.lines[i];
    line = line.substr(0, std::min(line.find('#'), line.size()));
    bool after_library = false;
    while (!line.empty()) {
      line.remove_prefix(std::min(line.find_first_of(kWord), line.size()));
      const std::string_view word =
          line.substr(0, std::min(line.find_first_not_of(kWord), line.size()));
      const std::optional<std::string_view> used = RoomOfTarget(word);
      if (used && !MayUse(*user, *used)) {
        found.push_back(Finding(file, i + 1, Explain(*user, *used)));
      }
      // A library that the list does not know would escape the rule.
      if (after_library && *user != "tests" && used != user) {
        found.push_back(
            Finding(file, i + 1, std::string(word) + " is not named after " + std::string(*user)));
      }
      after_library = word == "sightline_library";
      line.remove_prefix(word.size());
    }
  }
  return found;
}

}  // namespace sightline::policy
