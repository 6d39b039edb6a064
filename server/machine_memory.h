// SPDX-License-Identifier: Apache-2.0
//
// How much memory this process may take: the machine's, or less where a control group (a container,
// a systemd unit) bounds it. From it come the default budgets of `sightlined`, so that a server
// beyond them refuses scenes instead of being killed.
//
// Units: bytes; 0 where nothing is known. Both versions of control groups are read, with every
// group above the process's own. A file that is not there, or that says "max", bounds nothing.
//
// Thread safety: functions only.
//
//   const MachineMemory memory = ThisMachinesMemory();
//   ShareMemory(memory.bytes, &limits);
#ifndef SIGHTLINE_SERVER_MACHINE_MEMORY_H_
#define SIGHTLINE_SERVER_MACHINE_MEMORY_H_

#include <cstdint>
#include <optional>
#include <string>

#include "absl/functional/function_ref.h"
#include "server/base/limits.h"

namespace sightline {

struct MachineMemory {
  uint64_t bytes = 0;
  std::string origin;  // "this machine", or the file of the limit that is smaller.
};

// What is in a file; nothing if it cannot be read.
using FileText = absl::FunctionRef<std::optional<std::string>(const std::string& path)>;

MachineMemory FindMachineMemory(uint64_t physical_bytes, FileText read);
MachineMemory ThisMachinesMemory();

// Five eighths for scenes, all of it for a single one if need be, and an eighth for point sets. The
// rest is for builds, the queue and replies. Nothing changes for 0 bytes.
void ShareMemory(uint64_t bytes, Limits* limits);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_MACHINE_MEMORY_H_
