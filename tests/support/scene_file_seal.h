// SPDX-License-Identifier: Apache-2.0
//
// Makes every sum of a native scene file fit its bytes again, as far as its header and table still
// describe it: what comes after is a file that only the reader's other checks can refuse.
//
// Thread safety: functions only.
//
//   bytes[100] ^= 1;
//   SealSceneFile(bytes);
#ifndef SIGHTLINE_TESTS_SUPPORT_SCENE_FILE_SEAL_H_
#define SIGHTLINE_TESTS_SUPPORT_SCENE_FILE_SEAL_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "core/scene/scene_file_format.h"

namespace sightline::testing_support {

inline void SealSceneFile(std::span<std::byte> bytes) {
  SceneFileHeader header;
  if (bytes.size() < sizeof(header)) return;
  std::memcpy(&header, bytes.data(), sizeof(header));
  const uint64_t room = (bytes.size() - sizeof(header)) / sizeof(SceneFileSection);
  const uint64_t sections = std::min<uint64_t>({header.section_count, room, kMaxSections});
  for (uint64_t i = 0; i < sections; ++i) {
    std::byte* const at = bytes.data() + sizeof(header) + i * sizeof(SceneFileSection);
    SceneFileSection section;
    std::memcpy(&section, at, sizeof(section));
    if (section.offset > bytes.size() || section.element_bytes == 0) continue;
    const uint64_t left = bytes.size() - section.offset;
    if (section.count > left / section.element_bytes) continue;
    const uint64_t size = std::min(left, PaddedSection(section.count * section.element_bytes));
    section.sum = SectionSum(bytes.subspan(section.offset, size));
    std::memcpy(at, &section, sizeof(section));
  }
  const uint64_t table = PaddedSection(sections * sizeof(SceneFileSection));
  if (sizeof(header) + table <= bytes.size()) {
    header.table_sum = SectionSum(bytes.subspan(sizeof(header), table));
  }
  header.header_sum = HeaderSum(header);
  std::memcpy(bytes.data(), &header, sizeof(header));
}

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_SUPPORT_SCENE_FILE_SEAL_H_
