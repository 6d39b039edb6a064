// SPDX-License-Identifier: Apache-2.0
//
// Shadows and relit pictures: every call that they make ends when it is told to, and nothing is
// made ready for what the server will not answer.
#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "client/lib/client.h"
#include "client/lib/relighting.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/client/lib/mock_connection.h"

namespace sightline::client {
namespace {

using ::testing::_;
using ::testing::NiceMock;
using ::testing::Return;

class ShadowsTest : public testing::Test {
 protected:
  ShadowsTest() {
    v1::Capabilities capabilities;
    capabilities.mutable_limits()->set_max_item_rays(1 << 20);
    capabilities.mutable_limits()->set_max_light_samples(16);
    ON_CALL(*mock_, GetCapabilities(_)).WillByDefault([this, capabilities](const CallOptions& o) {
      calls_.push_back(o);
      return capabilities;
    });
    // Sets of no points: all calls but the streams.
    v1::PointSet set;
    set.set_name("scenes/x/pointSets/y");
    ON_CALL(*mock_, CreatePointSet(_, _))
        .WillByDefault([this, set](const auto&, const CallOptions& options) {
          calls_.push_back(options);
          return set;
        });
    ON_CALL(*mock_, GetPointSet(_, _))
        .WillByDefault([this, set](const auto&, const CallOptions& options) {
          calls_.push_back(options);
          return set;
        });
    ON_CALL(*mock_, RenewLease(_, _))
        .WillByDefault([this, set](const auto&, const CallOptions& options) {
          calls_.push_back(options);
          return set;
        });
    ON_CALL(*mock_, channel_count()).WillByDefault(Return(1));
  }

  // That all calls since the last time have one deadline, which is returned, and the cancellation.
  absl::Time ExpectOneDeadline(size_t calls) {
    EXPECT_EQ(calls_.size(), calls);
    absl::Time deadline = absl::InfiniteFuture();
    if (!calls_.empty()) deadline = calls_.front().deadline;
    for (const CallOptions& call : calls_) {
      EXPECT_EQ(call.deadline, deadline);
      EXPECT_EQ(call.cancellation, &cancellation_);
    }
    calls_.clear();
    return deadline;
  }

  Cancellation cancellation_;
  std::vector<CallOptions> calls_;  // How each was to go.
  std::shared_ptr<NiceMock<MockConnection>> mock_ = std::make_shared<NiceMock<MockConnection>>();
  Client client_{mock_};
};

TEST_F(ShadowsTest, AKeptSetIsAskedAboutOnceAndWithinTheQuerysTime) {
  const absl::Time begin = absl::Now();
  const auto shadows =
      client_.ComputeAllShadows({.scene = "scenes/x",
                                 .lights = {Light::Point({0, 0, 0})},
                                 .point_set = "scenes/x/pointSets/y"},
                                {.timeout = absl::Minutes(1), .cancellation = &cancellation_});
  ASSERT_TRUE(shadows.ok()) << shadows.status();
  EXPECT_EQ(shadows->points, 0u);
  EXPECT_EQ(shadows->samples, 1u);
  const absl::Time deadline = ExpectOneDeadline(2);  // The capabilities, the set.
  EXPECT_GE(deadline, begin + absl::Minutes(1));
  EXPECT_LE(deadline, absl::Now() + absl::Minutes(1));
}

TEST_F(ShadowsTest, EveryCallOfARelitPictureIsWithinItsTime) {
  const StreamOptions stream = {.timeout = absl::Minutes(1), .cancellation = &cancellation_};
  const absl::Time begin = absl::Now();
  const auto picture = Relighting::Make(
      client_, {.scene = "scenes/x", .lights = {Light::Point({0, 0, 0}), Light::Point({1, 0, 0})}},
      stream);
  ASSERT_TRUE(picture.ok()) << picture.status();
  // The set, the capabilities, and the set again for either light.
  const absl::Time made = ExpectOneDeadline(4);
  EXPECT_GE(made, begin + absl::Minutes(1));
  EXPECT_LE(made, absl::Now() + absl::Minutes(1));
  // A move has the time anew, for all that it does.
  ASSERT_TRUE((*picture)->Move(Light::Point({0, 0, 1})).ok());
  const absl::Time moved = ExpectOneDeadline(2);
  EXPECT_GT(moved, made);
  EXPECT_LE(moved, absl::Now() + absl::Minutes(1));
}

// A set whose making was given up may be there all the same: its name is known, and it is deleted.
TEST_F(ShadowsTest, TheSetOfAPictureThatWasGivenUpIsDeleted) {
  const std::pair<absl::Status, bool> ends[] = {{absl::CancelledError(""), true},
                                                {absl::DeadlineExceededError(""), true},
                                                {absl::InvalidArgumentError(""), false}};
  for (const auto& [status, may_be_there] : ends) {
    std::string made;
    EXPECT_CALL(*mock_, CreatePointSet(_, _))
        .WillOnce([&, &end = status](const Upload<v1::CreatePointSetRequest>& upload,
                                     const CallOptions&) -> absl::StatusOr<v1::PointSet> {
          upload([&](const v1::CreatePointSetRequest& request) {
            made = absl::StrCat(request.header().parent(), "/pointSets/",
                                request.header().point_set_id());
            return true;
          });
          return end;
        });
    std::string deleted;
    EXPECT_CALL(*mock_, DeletePointSet(_, _))
        .Times(testing::AtMost(1))
        .WillRepeatedly([&](const v1::DeletePointSetRequest& request, const CallOptions& options) {
          EXPECT_EQ(options.cancellation, nullptr) << "this call has to be made";
          deleted = request.name();
          return absl::OkStatus();
        });
    const auto picture =
        Relighting::Make(client_, {.scene = "scenes/x", .lights = {Light::Point({0, 0, 0})}}, {});
    EXPECT_EQ(picture.status(), status);
    EXPECT_EQ(deleted, may_be_there ? made : "");
    testing::Mock::VerifyAndClearExpectations(mock_.get());
  }
}

TEST_F(ShadowsTest, ADeadlineHoldsForAllMovesTogether) {
  const absl::Time deadline = absl::Now() + absl::Minutes(1);
  const auto picture = Relighting::Make(
      client_, {.scene = "scenes/x", .lights = {Light::Point({0, 0, 0})}},
      {.timeout = absl::Hours(1), .deadline = deadline, .cancellation = &cancellation_});
  ASSERT_TRUE(picture.ok()) << picture.status();
  EXPECT_EQ(ExpectOneDeadline(3), deadline);
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE((*picture)->Move(Light::Point({0, 0, 1})).ok());
    EXPECT_EQ(ExpectOneDeadline(2), deadline);
  }
}

// Four terabytes, if it were.
TEST_F(ShadowsTest, NothingIsMadeReadyForMoreThanTheServerAllows) {
  const std::vector<double> positions(3000);
  ShadowQuery query{.scene = "scenes/x",
                    .lights = {{.kind = Light::Kind::kRectangle, .samples = 0xFFFFFFFFu}}};
  query.points.positions = positions;
  EXPECT_EQ(client_.ComputeAllShadows(query).status().code(), absl::StatusCode::kResourceExhausted);
}

}  // namespace
}  // namespace sightline::client
