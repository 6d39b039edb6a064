// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/process_usage.h"

#include <dirent.h>
#include <sys/resource.h>
#include <sys/time.h>

#include <cstdio>
#include <fstream>
#include <memory>
#include <string>

namespace sightline {
namespace {

double Seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

uint64_t CountDescriptors() {
  const std::unique_ptr<DIR, int (*)(DIR*)> folder(opendir("/proc/self/fd"), &closedir);
  if (folder == nullptr) return 0;
  uint64_t entries = 0;
  while (readdir(folder.get()) != nullptr) ++entries;
  constexpr uint64_t kNotCounted = 3;  // "." and "..", and the folder's own.
  return entries - kNotCounted;
}

// The number behind `key` in /proc/self/status.
uint64_t StatusNumber(const std::string& key) {
  std::ifstream in("/proc/self/status");
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with(key)) return std::strtoull(line.c_str() + key.size(), nullptr, 10);
  }
  return 0;
}

}  // namespace

ProcessUsage MeasureProcess() {
  ProcessUsage usage;
  rusage times{};
  if (getrusage(RUSAGE_SELF, &times) == 0) {
    usage.cpu_seconds = Seconds(times.ru_utime) + Seconds(times.ru_stime);
  }
  rlimit descriptors{};
  if (getrlimit(RLIMIT_NOFILE, &descriptors) == 0) usage.max_descriptors = descriptors.rlim_cur;
  usage.open_descriptors = CountDescriptors();
  usage.resident_bytes = 1024 * StatusNumber("VmRSS:");
  usage.threads = StatusNumber("Threads:");
  return usage;
}

}  // namespace sightline
