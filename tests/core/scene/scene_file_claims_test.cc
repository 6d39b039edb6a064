// SPDX-License-Identifier: Apache-2.0
//
// What a scene file claims of itself: how much memory it takes, its revision, its objects' names,
// how many triangles and vertices it has.
#include <unistd.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/scene/scene_file.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/scene/scene_file_bytes.h"
#include "tests/support/scene_file_seal.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using testing_support::Header;
using testing_support::SealSceneFile;
using testing_support::Section;
using testing_support::TempDir;

using Bytes = AlignedVector<std::byte>;

class SceneFileClaimsTest : public ::testing::Test {
 protected:
  static constexpr uint32_t kVertices = 300;

  std::shared_ptr<const Scene> Build(uint64_t revision = 7) {
    ObjectInput chair{.name = "chair", .dynamic = true};
    for (uint32_t i = 0; i < kVertices; ++i) {
      chair.vertices.push_back({1.0 * i, 1.0 * (i % 2), 1.0 * (i % 3)});
      if (i >= 2) chair.indices.insert(chair.indices.end(), {i - 2, i - 1, i});
    }
    const std::vector<ObjectInput> objects = {chair};
    auto scene = BuildScene("hall", revision, objects, std::nullopt, {}, pool_);
    EXPECT_TRUE(scene.ok()) << scene.status();
    return *std::move(scene);
  }
  Bytes Written(const Scene& scene) {
    const absl::Status status = WriteSceneFile(scene, folder_, "scene.slscene", pool_);
    EXPECT_TRUE(status.ok()) << status;
    const absl::StatusOr<SceneBytes> file = MapSceneFile(folder_, "scene.slscene");
    EXPECT_TRUE(file.ok()) << file.status();
    return Bytes(file->bytes.begin(), file->bytes.end());
  }
  // With one more section that no reader knows.
  static Bytes WithAddition(Bytes bytes, uint64_t size) {
    const uint32_t sections = Header(bytes).section_count;
    const uint64_t table = PaddedSection(sections * sizeof(SceneFileSection));
    const uint64_t longer = PaddedSection((sections + 1) * sizeof(SceneFileSection));
    const uint64_t before = bytes.size() + longer - table;
    Bytes out(before + PaddedSection(size), std::byte{0});
    std::memcpy(out.data(), bytes.data(), sizeof(SceneFileHeader) + table);
    std::memcpy(&out[sizeof(SceneFileHeader) + longer], &bytes[sizeof(SceneFileHeader) + table],
                bytes.size() - sizeof(SceneFileHeader) - table);
    for (uint32_t i = 0; i < sections; ++i) Section(out, i).offset += longer - table;
    Section(out, sections) = {.kind = 1000, .element_bytes = 1, .offset = before, .count = size};
    Header(out).section_count = sections + 1;
    Header(out).file_bytes = out.size();
    SealSceneFile(out);
    return out;
  }
  absl::StatusOr<std::shared_ptr<const Scene>> Load(Bytes bytes) {
    SealSceneFile({bytes.data(), bytes.size()});
    auto owner = std::make_shared<const Bytes>(std::move(bytes));
    const std::span<const std::byte> view = *owner;
    return LoadScene({view, std::move(owner), "'file'"}, "again", {}, pool_);
  }

  ThreadPool pool_{2};
  TempDir dir_;
  const Folder folder_ = *Folder::Open(dir_.path());
};

// A file that was read is held as long as the scene is, whatever of it the scene knows.
TEST_F(SceneFileClaimsTest, AFileThatWasReadCountsWhole) {
  const Bytes bytes = WithAddition(Written(*Build()), 1'000'000);
  std::ofstream(dir_.File("long.slscene"), std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  const auto read =
      ReadSceneFile(folder_, "long.slscene", [](uint64_t) { return absl::OkStatus(); });
  ASSERT_TRUE(read.ok()) << read.status();
  const auto scene = LoadScene(*read, "again", {}, pool_);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_GE((*scene)->report.memory_bytes, bytes.size() + kVertices * sizeof(Vec3d));
  EXPECT_GE((*scene)->report.memory_bytes, (*scene)->MemoryBytes());
  EXPECT_GE(InspectSceneFile(*read)->scene_bytes, (*scene)->report.memory_bytes);

  // A mapped one gives back what nobody reads.
  const auto mapped = MapSceneFile(folder_, "long.slscene");
  ASSERT_TRUE(mapped.ok()) << mapped.status();
  const auto lean = LoadScene(*mapped, "again", {}, pool_);
  ASSERT_TRUE(lean.ok()) << lean.status();
  EXPECT_EQ((*lean)->report.memory_bytes, (*lean)->MemoryBytes());
}

TEST_F(SceneFileClaimsTest, ItsEstimateHoldsItsSourceVertices) {
  const auto scene = Build();
  Written(*scene);
  const auto mapped = MapSceneFile(folder_, "scene.slscene");
  const auto again = LoadScene(*mapped, "again", {}, pool_);
  ASSERT_TRUE(again.ok()) << again.status();
  const auto info = InspectSceneFile(*mapped);
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_GE(info->scene_bytes, info->file_bytes + kVertices * sizeof(Vec3d));
}

TEST_F(SceneFileClaimsTest, ARevisionThatIsNoneIsRefused) {
  const Bytes good = Written(*Build());
  const auto with = [&](uint64_t revision) {
    Bytes bytes = good;
    reinterpret_cast<SceneFileScene*>(&bytes[Section(bytes, 0).offset])->revision = revision;
    return Load(std::move(bytes));
  };
  constexpr uint64_t kMost = uint64_t{1} << 62;
  for (const uint64_t revision : {uint64_t{1}, kMost}) {
    const auto scene = with(revision);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_EQ((*scene)->revision, revision);
  }
  for (const uint64_t revision : {uint64_t{0}, kMost + 1, uint64_t{1} << 63, UINT64_MAX}) {
    const absl::Status status = with(revision).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr("revision"));
    EXPECT_THAT(std::string(status.message()), HasSubstr(std::to_string(revision)));
  }
  // Nor is one written that could not be read again.
  for (const uint64_t revision : {uint64_t{0}, kMost + 1}) {
    const absl::Status status = WriteSceneFile(*Build(revision), folder_, "other.slscene", pool_);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(std::to_string(revision)));
  }
  EXPECT_EQ(folder_.List()->size(), 1u);
}

// A token that fires once the sums are right is heard before the first name is looked at.
TEST_F(SceneFileClaimsTest, ItsObjectsAreReadInReachOfACancel) {
  Bytes bytes = Written(*Build());
  bytes[Section(bytes, 2).offset] = std::byte{0xFF};
  SealSceneFile({bytes.data(), bytes.size()});
  auto owner = std::make_shared<const Bytes>(std::move(bytes));
  const std::span<const std::byte> view = *owner;
  CancelToken cancel;
  const absl::Status status =
      LoadScene({view, owner, "'file'"}, "again", {}, pool_, &cancel, [&](double) {
        cancel.Cancel();
      }).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled) << status;
}

TEST_F(SceneFileClaimsTest, NamesThatAreNotUtf8AreRefused) {
  const Bytes good = Written(*Build());
  const auto with = [&](const std::string& name) {
    Bytes bytes = good;
    std::memcpy(&bytes[Section(bytes, 2).offset], name.data(), name.size());
    return Load(std::move(bytes));
  };
  EXPECT_EQ((*with("s\xC3\xBChl"))->geometry.objects[0].name.substr(0, 3), "s\xC3\xBC");
  for (const char* name : {"\xFF"
                           "hair",
                           "chai\xC3", "\xED\xA0\x80ir"}) {
    const absl::Status status = with(name).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr("UTF-8"));
    EXPECT_THAT(std::string(status.message()), HasSubstr("object 0"));
    EXPECT_THAT(std::string(status.message()), Not(HasSubstr("\xFF")));
  }
}

// More triangles or vertices than any scene has, in files whose arrays are holes: they are refused
// by their counts, before a sum is taken, and whatever the limits say.
TEST_F(SceneFileClaimsTest, NoLimitGoesBeyondWhatTheEngineNumbers) {
  const Bytes good = Written(*Build());
  const std::string name = "large.slscene", path = dir_.File(name);
  for (const SectionKind kind : {SectionKind::kTriangles, SectionKind::kVertices}) {
    Bytes bad = good;
    const uint32_t sections = Header(bad).section_count;
    uint64_t end = Section(bad, 0).offset;
    const uint64_t kept = end + PaddedSection(sizeof(SceneFileScene));
    for (uint32_t i = 0; i < sections; ++i) {
      SceneFileSection& section = Section(bad, i);
      if (section.kind == static_cast<uint32_t>(kind)) section.count = kMaxGeometryItems + 1;
      section.offset = end;
      end += PaddedSection(section.count * section.element_bytes);
    }
    Header(bad).file_bytes = end;
    const uint64_t table = PaddedSection(sections * sizeof(SceneFileSection));
    Header(bad).table_sum = SectionSum({bad.data() + sizeof(SceneFileHeader), table});
    Header(bad).header_sum = HeaderSum(Header(bad));
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(bad.data()), static_cast<std::streamsize>(kept));
    ASSERT_EQ(truncate(path.c_str(), static_cast<off_t>(end)), 0);
    const absl::StatusOr<SceneBytes> file = MapSceneFile(folder_, name);
    ASSERT_TRUE(file.ok()) << file.status();
    const MeshLimits limits = {.max_triangles = end, .max_vertices = end};
    const absl::Status status = LoadScene(*file, "again", {.limits = limits}, pool_).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr("the scene has 715827883 "));
    EXPECT_THAT(std::string(status.message()), HasSubstr(" is 715827882: split the scene"));
  }
}

}  // namespace
}  // namespace sightline
