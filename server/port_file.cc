// SPDX-License-Identifier: Apache-2.0
#include "server/port_file.h"

#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

#include "absl/strings/str_cat.h"

namespace sightline {
namespace {

absl::Status Failure(const std::string& path) {
  return absl::UnavailableError(
      absl::StrCat("cannot write the port file ", path, ": ", std::strerror(errno)));
}

}  // namespace

absl::Status WritePortFile(const std::string& path, int port) {
  const std::string temporary = absl::StrCat(path, ".", getpid(), ".tmp");
  std::FILE* file = std::fopen(temporary.c_str(), "w");
  if (file == nullptr) return Failure(temporary);
  const bool written = std::fprintf(file, "%d\n", port) > 0;
  const bool closed = std::fclose(file) == 0;
  if (written && closed && std::rename(temporary.c_str(), path.c_str()) == 0) {
    return absl::OkStatus();
  }
  absl::Status failure = Failure(path);
  std::remove(temporary.c_str());
  return failure;
}

void RemovePortFile(const std::string& path) { std::remove(path.c_str()); }

}  // namespace sightline
