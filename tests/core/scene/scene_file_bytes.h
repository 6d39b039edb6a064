// SPDX-License-Identifier: Apache-2.0
//
// The parts of a native scene file's bytes that tests change.
//
// Thread safety: functions only.
//
//   Section(bytes, 3).count -= 1;
//   SealSceneFile(bytes);
#ifndef SIGHTLINE_TESTS_CORE_SCENE_SCENE_FILE_BYTES_H_
#define SIGHTLINE_TESTS_CORE_SCENE_SCENE_FILE_BYTES_H_

#include <cstddef>
#include <cstdint>

#include "core/base/aligned_vector.h"
#include "core/scene/scene_file_format.h"

namespace sightline::testing_support {

// REQUIRES, of both: the bytes are those of a file that was written.
inline SceneFileHeader& Header(AlignedVector<std::byte>& bytes) {
  return *reinterpret_cast<SceneFileHeader*>(bytes.data());
}
// Row `index` of the table.
inline SceneFileSection& Section(AlignedVector<std::byte>& bytes, uint32_t index) {
  return reinterpret_cast<SceneFileSection*>(bytes.data() + sizeof(SceneFileHeader))[index];
}

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_SCENE_SCENE_FILE_BYTES_H_
