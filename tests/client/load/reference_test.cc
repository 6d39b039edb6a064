// SPDX-License-Identifier: Apache-2.0
#include "client/load/reference.h"

#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <vector>

#include "core/geometry/camera.h"
#include "core/mesh/builtin/builtin.h"

namespace sightline::load {
namespace {

class ReferenceTest : public testing::Test {
 protected:
  void SetUp() override {
    absl::StatusOr<BuiltinScene> made = MakeBuiltin(*ParseBuiltin("box"));
    ASSERT_TRUE(made.ok()) << made.status();
    objects_ = made->objects;
    view_ = made->views[0];
    const Camera camera = *LookAt(view_.eye, view_.at, view_.up, view_.fov_y_degrees, 64, 36);
    client::Camera c{.tan_half_fov_y = camera.tan_half_fov_y, .width = 64, .height = 36};
    c.eye = {camera.eye.x, camera.eye.y, camera.eye.z};
    c.right = {camera.right.x, camera.right.y, camera.right.z};
    c.up = {camera.up.x, camera.up.y, camera.up.z};
    c.forward = {camera.forward.x, camera.forward.y, camera.forward.z};
    const Vec3d light = view_.lights[1];
    std::vector<double> surface;
    for (const ObjectInput& object : objects_) {
      for (size_t i = 0; i < object.vertices.size(); i += 7) {
        const Vec3d v = object.vertices[i];
        surface.insert(surface.end(), {v.x, v.y, v.z});
      }
    }
    absl::StatusOr<Workload> workload =
        Workload::Make({.scene = "scenes/box",
                        .cameras = {c},
                        .lights = {client::Light::Point({light.x, light.y, light.z})},
                        .mix = {1, 1, 1},
                        .tile_size = 16,
                        .points_per_item = 33,
                        .segments_per_item = 5,
                        .distinct_items = 20},
                       std::move(surface));
    ASSERT_TRUE(workload.ok()) << workload.status();
    workload_ = *std::move(workload);
    const Vec3d middle = view_.eye + (view_.at - view_.eye) * 0.3;
    const Vec3d side = Cross(view_.at - view_.eye, view_.up) * 0.2;
    extra_ = {.name = "extra",
              .vertices = {middle - side, middle + side, middle + view_.up * 2.0},
              .indices = {0, 1, 2}};
  }
  std::unique_ptr<Reference> Make(size_t stride, bool with_extra) {
    absl::StatusOr<std::unique_ptr<Reference>> reference =
        Reference::Make(Build(objects_), with_extra ? std::optional(extra_) : std::nullopt,
                        *workload_, stride, pool_);
    EXPECT_TRUE(reference.ok()) << reference.status();
    return *std::move(reference);
  }
  Answer Engine(const Scene& scene, const Work& work) {
    absl::StatusOr<Answer> answer = EngineAnswer(scene, *workload_, work);
    EXPECT_TRUE(answer.ok()) << answer.status();
    return *std::move(answer);
  }
  std::shared_ptr<const Scene> Build(const std::vector<ObjectInput>& objects) {
    return *BuildScene("x", 1, objects, Vec3d{}, {}, pool_);
  }
  template <typename Visit>
  void ForEachItem(const Visit& visit) {
    for (const Kind kind : {Kind::kTiles, Kind::kPoints, Kind::kSegments}) {
      for (size_t i = 0; i < workload_->ItemCount(kind); ++i) visit(Work{kind, i});
    }
  }

  ThreadPool pool_{2};
  std::vector<ObjectInput> objects_;
  BuiltinView view_;
  std::optional<Workload> workload_;
  ObjectInput extra_;
};

TEST_F(ReferenceTest, TheEnginesOwnAnswersAreRight) {
  const auto reference = Make(1, false);
  reference->ExpectRevision(1, 0);
  const std::shared_ptr<const Scene> scene = Build(objects_);
  size_t flags = 0, lit = 0;
  ForEachItem([&](const Work& work) {
    const Answer answer = Engine(*scene, work);
    std::string difference;
    EXPECT_EQ(reference->Judge(work, 1, answer, &difference), Verdict::kEqual) << difference;
    for (const uint8_t flag : answer.flags) lit += flag == 1 ? 1 : 0;
    flags += answer.flags.size();
  });
  // The workload tells answers apart: neither all lit nor all dark.
  EXPECT_GT(lit, flags / 20);
  EXPECT_LT(lit, flags - flags / 20);
}

TEST_F(ReferenceTest, OneWrongBitIsFoundAnywhere) {
  const auto reference = Make(1, false);
  reference->ExpectRevision(1, 0);
  const std::shared_ptr<const Scene> scene = Build(objects_);
  ForEachItem([&](const Work& work) {
    const Answer right = Engine(*scene, work);
    const auto expect_wrong = [&](const Answer& answer, const std::string& what) {
      std::string difference;
      EXPECT_EQ(reference->Judge(work, 1, answer, &difference), Verdict::kWrong) << what;
      EXPECT_NE(difference.find(what), std::string::npos) << difference;
    };
    Answer wrong = right;
    wrong.flags.back() ^= 1;
    expect_wrong(wrong, "flags");
    wrong = right;
    wrong.flags.pop_back();
    expect_wrong(wrong, "flags");
    if (work.kind == Kind::kPoints) return;
    wrong = right;
    wrong.triangles.front() ^= 1;
    expect_wrong(wrong, "triangles[0]");
    wrong = right;
    wrong.distances.back() = -wrong.distances.back();
    expect_wrong(wrong, "distances");
  });
}

TEST_F(ReferenceTest, AnEditHasAnswersOfItsOwn) {
  const auto reference = Make(1, true);
  reference->ExpectRevision(1, 0);
  reference->ExpectRevision(2, 1);
  std::vector<ObjectInput> objects = objects_;
  objects.push_back(extra_);
  const std::shared_ptr<const Scene> edited = Build(objects);
  size_t differ = 0;
  ForEachItem([&](const Work& work) {
    const Answer answer = Engine(*edited, work);
    std::string difference;
    EXPECT_EQ(reference->Judge(work, 2, answer, &difference), Verdict::kEqual) << difference;
    differ += reference->Judge(work, 1, answer, &difference) == Verdict::kWrong ? 1 : 0;
  });
  EXPECT_GT(differ, 0u);
}

TEST_F(ReferenceTest, ARevisionThatNobodyMadeIsWrong) {
  const auto reference = Make(1, false);
  reference->ExpectRevision(1, 0);
  reference->ExpectRevision(3, 1);  // A state that was not found.
  std::string difference;
  const Work work{Kind::kTiles, 0};
  const Answer answer = Engine(*Build(objects_), work);
  EXPECT_EQ(reference->Judge(work, 2, answer, &difference), Verdict::kWrong);
  EXPECT_NE(difference.find("revision 2"), std::string::npos);
  EXPECT_EQ(reference->Judge(work, 3, answer, &difference), Verdict::kWrong);
}

TEST_F(ReferenceTest, ASampleKnowsEveryKthItem) {
  const auto reference = Make(8, false);
  reference->ExpectRevision(1, 0);
  const std::shared_ptr<const Scene> scene = Build(objects_);
  ForEachItem([&](const Work& work) {
    std::string difference;
    const Verdict verdict = reference->Judge(work, 1, Engine(*scene, work), &difference);
    EXPECT_EQ(verdict, work.item % 8 == 0 ? Verdict::kEqual : Verdict::kNotChecked) << difference;
  });
}

}  // namespace
}  // namespace sightline::load
