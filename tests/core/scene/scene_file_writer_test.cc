// SPDX-License-Identifier: Apache-2.0
//
// Files of scenes whose source vertices lie in many arrays, and writing where the disk is full or
// memory runs out.
#include <cerrno>
#include <new>
#include <string>
#include <vector>

#include "core/scene/scene_file.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/faulty_file_calls.h"
#include "tests/support/random.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::FaultyFileCalls;
using testing_support::TempDir;
using testing_support::TestRng;

class SceneFileWriterTest : public ::testing::Test {
 protected:
  // A dynamic object of so many vertices, in a strip.
  ObjectInput Strip(const std::string& name, uint32_t vertices) {
    ObjectInput object{.name = name, .dynamic = true};
    for (uint32_t i = 0; i < vertices; ++i) {
      object.vertices.push_back({rng_.Uniform(0, 9), rng_.Uniform(0, 9), rng_.Uniform(0, 9)});
      if (i >= 2) object.indices.insert(object.indices.end(), {i - 2, i - 1, i});
    }
    return object;
  }
  std::shared_ptr<const Scene> Build(const std::vector<ObjectInput>& objects) {
    auto scene = BuildScene("hall", 7, objects, std::nullopt, {}, pool_);
    EXPECT_TRUE(scene.ok()) << scene.status();
    return *std::move(scene);
  }
  Folder OpenFolder() { return *Folder::Open(dir_.path(), calls_); }

  TestRng rng_;
  ThreadPool pool_{2};
  TempDir dir_;
  FaultyFileCalls calls_;
};

// 24 bytes a vertex: blocks of the sums begin and end within objects, and hold many of them.
TEST_F(SceneFileWriterTest, SourceVerticesOfManyObjectsAreReadAgain) {
  std::vector<ObjectInput> objects = {Strip("a", 60'000), Strip("nothing", 0), Strip("b", 3)};
  objects.push_back(Strip("kept", 50));
  objects.back().dynamic = false;
  for (uint32_t i = 0; i < 500; ++i) {
    objects.push_back(Strip(std::to_string(i), static_cast<uint32_t>(rng_.Below(100))));
  }
  objects.push_back(Strip("c", 90'001));
  const auto scene = Build(objects);
  const Folder folder = OpenFolder();
  ASSERT_TRUE(WriteSceneFile(*scene, folder, "scene.slscene", pool_).ok());
  const absl::StatusOr<SceneBytes> file = MapSceneFile(folder, "scene.slscene");
  ASSERT_TRUE(file.ok()) << file.status();
  const auto again = LoadScene(*file, "again", {}, pool_);
  ASSERT_TRUE(again.ok()) << again.status();
  ASSERT_EQ((*again)->geometry.objects.size(), objects.size());
  for (size_t i = 0; i < objects.size(); ++i) {
    const auto& read = (*again)->geometry.objects[i].source_vertices;
    ASSERT_EQ(read != nullptr, objects[i].dynamic) << i;
    if (read != nullptr) {
      EXPECT_EQ(*read, objects[i].vertices) << i;
    }
  }
}

TEST_F(SceneFileWriterTest, ASumOfPartsIsTheSumOfTheirBytes) {
  for (int turn = 0; turn < 50; ++turn) {
    std::vector<std::byte> bytes(rng_.Below(3 * kSumBlockBytes));
    for (std::byte& byte : bytes) byte = static_cast<std::byte>(rng_());
    std::vector<std::span<const std::byte>> parts;
    for (std::span<const std::byte> rest = bytes; !rest.empty();) {
      const uint64_t most = rng_.Chance(0.2) ? 2 * kSumBlockBytes : 100'000;
      const size_t size = std::min<size_t>(rest.size(), rng_.Below(most));
      parts.push_back(rest.first(size));
      rest = rest.subspan(size);
    }
    EXPECT_EQ(SectionSum(parts), SectionSum(std::span<const std::byte>(bytes)));
  }
}

TEST_F(SceneFileWriterTest, AFaultWhileWritingLeavesTheOldFile) {
  const Folder folder = OpenFolder();
  ASSERT_TRUE(WriteSceneFile(*Build({Strip("a", 40)}), folder, "scene.slscene", pool_).ok());
  const auto bytes = [&folder] {
    const absl::StatusOr<SceneBytes> file = MapSceneFile(folder, "scene.slscene");
    EXPECT_TRUE(file.ok()) << file.status();
    return std::vector<std::byte>(file->bytes.begin(), file->bytes.end());
  };
  const std::vector<std::byte> before = bytes();
  const auto other = Build({Strip("a", 400)});
  for (int writes = 0; writes < 12; writes += 3) {
    calls_.write_error = ENOSPC;
    calls_.writes_before_fault = writes;
    const absl::Status status = WriteSceneFile(*other, folder, "scene.slscene", pool_);
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr("free some space"));
    calls_.write_error = 0;
    EXPECT_EQ(bytes(), before);
    EXPECT_EQ(folder.List()->size(), 1u);
  }
}

TEST_F(SceneFileWriterTest, MemoryThatRunsOutIsAnErrorAndLeavesTheOldFile) {
  const auto scene = Build({Strip("a", 40)});
  const Folder folder = OpenFolder();
  ASSERT_TRUE(WriteSceneFile(*scene, folder, "scene.slscene", pool_).ok());
  calls_.on_write = [] { throw std::bad_alloc(); };
  const absl::Status status = WriteSceneFile(*scene, folder, "scene.slscene", pool_);
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("out of memory while writing"));
  EXPECT_THAT(std::string(status.message()), HasSubstr(dir_.File("scene.slscene")));
  EXPECT_EQ(folder.List()->size(), 1u);
  EXPECT_TRUE(LoadScene(*MapSceneFile(folder, "scene.slscene"), "again", {}, pool_).ok());
}

}  // namespace
}  // namespace sightline
