// SPDX-License-Identifier: Apache-2.0
#include "server/machine_memory.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <sstream>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

namespace sightline {
namespace {

constexpr char kGroups[] = "/proc/self/cgroup";

// Where a hierarchy is mounted, and what a group's limit is called there.
struct Hierarchy {
  absl::string_view root, file;
};
constexpr Hierarchy kVersion2 = {"/sys/fs/cgroup", "memory.max"};
constexpr Hierarchy kVersion1 = {"/sys/fs/cgroup/memory", "memory.limit_in_bytes"};

// The limits of the group at `path` and of all above it; a group's own path may be one that only
// the machine knows, not the container.
void TakeLeast(const Hierarchy& hierarchy, absl::string_view path, FileText read,
               MachineMemory* least) {
  while (true) {
    const std::string file =
        absl::StrCat(hierarchy.root, path, path == "/" ? "" : "/", hierarchy.file);
    uint64_t bytes = 0;
    if (const std::optional<std::string> text = read(file);
        text.has_value() && absl::SimpleAtoi(absl::StripAsciiWhitespace(*text), &bytes) &&
        bytes > 0 && (least->bytes == 0 || bytes < least->bytes)) {
      *least = {bytes, file};
    }
    if (path == "/" || path.empty()) return;
    path = path.substr(0, std::max<size_t>(1, path.rfind('/')));
  }
}

std::optional<std::string> ReadText(const std::string& path) {
  std::ifstream file(path);
  if (!file) return std::nullopt;
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

}  // namespace

MachineMemory FindMachineMemory(uint64_t physical_bytes, FileText read) {
  MachineMemory least{physical_bytes, "this machine"};
  // Lines of NUMBER:CONTROLLERS:PATH; version 2 has no controllers.
  for (const absl::string_view line : absl::StrSplit(read(kGroups).value_or(""), '\n')) {
    const std::vector<absl::string_view> parts = absl::StrSplit(line, absl::MaxSplits(':', 2));
    if (parts.size() != 3 || parts[2].empty() || parts[2][0] != '/') continue;
    if (parts[1].empty()) {
      TakeLeast(kVersion2, parts[2], read, &least);
      continue;
    }
    const std::vector<absl::string_view> controllers = absl::StrSplit(parts[1], ',');
    if (std::find(controllers.begin(), controllers.end(), "memory") != controllers.end()) {
      TakeLeast(kVersion1, parts[2], read, &least);
    }
  }
  return least;
}

MachineMemory ThisMachinesMemory() {
  // Not /proc/meminfo, which a hardened unit does not see.
  const int64_t pages = ::sysconf(_SC_PHYS_PAGES), page = ::sysconf(_SC_PAGESIZE);
  const bool known = pages > 0 && page > 0;
  return FindMachineMemory(known ? static_cast<uint64_t>(pages) * static_cast<uint64_t>(page) : 0,
                           ReadText);
}

void ShareMemory(uint64_t bytes, Limits* limits) {
  if (bytes == 0) return;
  const auto share = [bytes](uint64_t Limits::*limit, uint64_t eighths) {
    for (const LimitEntry& entry : LimitTable()) {
      if (entry.value == limit) return std::clamp(bytes / 8 * eighths, entry.least, entry.most);
    }
    return uint64_t{0};
  };
  limits->max_scene_bytes = share(&Limits::max_scene_bytes, 5);
  limits->max_bytes_per_scene = share(&Limits::max_bytes_per_scene, 5);
  limits->max_point_set_bytes = share(&Limits::max_point_set_bytes, 1);
}

}  // namespace sightline
