// SPDX-License-Identifier: Apache-2.0
#include "server/machine_memory.h"

#include <map>
#include <optional>
#include <string>

#include "gtest/gtest.h"

namespace sightline {
namespace {

constexpr uint64_t kGiB = uint64_t{1} << 30;

MachineMemory Find(uint64_t physical, const std::map<std::string, std::string>& files) {
  return FindMachineMemory(physical, [&](const std::string& path) -> std::optional<std::string> {
    const auto found = files.find(path);
    return found == files.end() ? std::nullopt : std::optional<std::string>(found->second);
  });
}

TEST(MachineMemoryTest, WithoutGroupsItIsTheMachines) {
  const MachineMemory memory = Find(16 * kGiB, {});
  EXPECT_EQ(memory.bytes, 16 * kGiB);
  EXPECT_EQ(memory.origin, "this machine");
  EXPECT_EQ(Find(0, {}).bytes, 0u);
}

TEST(MachineMemoryTest, TheLeastLimitOfAGroupAndThoseAboveCounts) {
  const std::string group = "/proc/self/cgroup", line = "0::/system.slice/sightlined.service\n";
  const std::string root = "/sys/fs/cgroup/";
  EXPECT_EQ(Find(16 * kGiB,
                 {{group, line}, {root + "system.slice/sightlined.service/memory.max", "max\n"}})
                .bytes,
            16 * kGiB);
  const MachineMemory own =
      Find(16 * kGiB, {{group, line},
                       {root + "system.slice/sightlined.service/memory.max", "4294967296\n"},
                       {root + "system.slice/memory.max", "8589934592\n"}});
  EXPECT_EQ(own.bytes, 4 * kGiB);
  EXPECT_EQ(own.origin, root + "system.slice/sightlined.service/memory.max");
  const MachineMemory above =
      Find(16 * kGiB, {{group, line},
                       {root + "system.slice/sightlined.service/memory.max", "4294967296\n"},
                       {root + "system.slice/memory.max", "2147483648\n"}});
  EXPECT_EQ(above.bytes, 2 * kGiB);
  EXPECT_EQ(above.origin, root + "system.slice/memory.max");
  // A limit beyond the machine's memory is none.
  EXPECT_EQ(Find(kGiB, {{group, line}, {root + "system.slice/memory.max", "2147483648\n"}}).origin,
            "this machine");
}

TEST(MachineMemoryTest, AContainerSeesItsLimitAtTheRoot) {
  EXPECT_EQ(Find(16 * kGiB,
                 {{"/proc/self/cgroup", "0::/\n"}, {"/sys/fs/cgroup/memory.max", "3221225472\n"}})
                .bytes,
            3 * kGiB);
}

TEST(MachineMemoryTest, VersionOneHasAHierarchyOfItsOwn) {
  const std::string groups = "11:cpuset:/docker/abc\n4:cpu,memory:/docker/abc\n1:name=systemd:/\n";
  const MachineMemory memory =
      Find(16 * kGiB, {{"/proc/self/cgroup", groups},
                       {"/sys/fs/cgroup/memory/memory.limit_in_bytes", "6442450944\n"},
                       {"/sys/fs/cgroup/memory.max", "1\n"}});  // Not that one's.
  EXPECT_EQ(memory.bytes, 6 * kGiB);
  EXPECT_EQ(memory.origin, "/sys/fs/cgroup/memory/memory.limit_in_bytes");
  // What version 1 says for "none".
  EXPECT_EQ(
      Find(16 * kGiB, {{"/proc/self/cgroup", groups},
                       {"/sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n"}})
          .bytes,
      16 * kGiB);
}

TEST(MachineMemoryTest, WhatIsNoLimitIsNotTakenForOne) {
  for (const char* groups : {"0::\n", "0:relative\n", "::::\n", "memory", "0::/a\n"}) {
    EXPECT_EQ(Find(kGiB, {{"/proc/self/cgroup", groups},
                          {"/sys/fs/cgroup/a/memory.max", "0\n"},
                          {"/sys/fs/cgroup/memory.max", "many\n"}})
                  .bytes,
              kGiB)
        << groups;
  }
}

TEST(MachineMemoryTest, SharesLeaveRoomAndStayWithinTheirRange) {
  Limits limits;
  ShareMemory(16 * kGiB, &limits);
  EXPECT_EQ(limits.max_scene_bytes, 10 * kGiB);
  EXPECT_EQ(limits.max_bytes_per_scene, 10 * kGiB);
  EXPECT_EQ(limits.max_point_set_bytes, 2 * kGiB);
  EXPECT_TRUE(ValidateLimits(limits).ok());
  for (const uint64_t bytes : {uint64_t{1}, ~uint64_t{0}}) {
    ShareMemory(bytes, &limits);
    EXPECT_TRUE(ValidateLimits(limits).ok()) << bytes;
  }
  Limits unknown;
  ShareMemory(0, &unknown);
  EXPECT_EQ(unknown.max_scene_bytes, Limits().max_scene_bytes);
}

TEST(MachineMemoryTest, ThisMachineHasSome) { EXPECT_GT(ThisMachinesMemory().bytes, 0u); }

}  // namespace
}  // namespace sightline
