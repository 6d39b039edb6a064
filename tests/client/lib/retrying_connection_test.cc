// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <string>
#include <vector>

#include "client/lib/connection.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/client/lib/mock_connection.h"

namespace sightline::client {
namespace {

using ::testing::_;
using ::testing::NiceMock;
using ::testing::Return;

class RetryingConnectionTest : public testing::Test {
 protected:
  std::shared_ptr<NiceMock<MockConnection>> mock_ = std::make_shared<NiceMock<MockConnection>>();
  std::shared_ptr<Connection> connection_ = MakeRetryingConnection(
      mock_, {.give_up_after = absl::Seconds(30), .initial_delay = absl::Milliseconds(1)});
};

TEST_F(RetryingConnectionTest, RepeatsWhatMayHeal) {
  v1::Scene scene;
  scene.set_name("scenes/x");
  EXPECT_CALL(*mock_, GetScene(_, _))
      .WillOnce(Return(absl::UnavailableError("restarting")))
      .WillOnce(Return(absl::UnavailableError("restarting")))
      .WillOnce(Return(scene));
  const auto result = connection_->GetScene({}, {});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->name(), "scenes/x");
}

TEST_F(RetryingConnectionTest, TellsAtOnceWhatDoesNot) {
  for (const absl::Status& status :
       {absl::InvalidArgumentError("x"), absl::NotFoundError("x"), absl::InternalError("x"),
        absl::ResourceExhaustedError("a limit"), absl::DeadlineExceededError("x")}) {
    EXPECT_CALL(*mock_, GetScene(_, _)).WillOnce(Return(status));
    EXPECT_EQ(connection_->GetScene({}, {}).status(), status);
    testing::Mock::VerifyAndClearExpectations(mock_.get());
  }
}

TEST_F(RetryingConnectionTest, GivesUpInTime) {
  EXPECT_CALL(*mock_, GetScene(_, _)).WillOnce(Return(absl::UnavailableError("gone")));
  const auto once = MakeRetryingConnection(mock_, {.give_up_after = absl::ZeroDuration()});
  EXPECT_EQ(once->GetScene({}, {}).status().code(), absl::StatusCode::kUnavailable);
  // A deadline that is nearer than the next attempt ends it too.
  EXPECT_CALL(*mock_, GetScene(_, _)).WillOnce(Return(absl::UnavailableError("gone")));
  const auto slow =
      MakeRetryingConnection(mock_, {.initial_delay = absl::Hours(1), .max_delay = absl::Hours(1)});
  EXPECT_EQ(slow->GetScene({}, {.deadline = absl::Now() + absl::Seconds(5)}).status().code(),
            absl::StatusCode::kUnavailable);
}

TEST_F(RetryingConnectionTest, ADeletionThatFindsNothingLaterWasDone) {
  EXPECT_CALL(*mock_, DeleteScene(_, _))
      .WillOnce(Return(absl::UnavailableError("lost the reply")))
      .WillOnce(Return(absl::NotFoundError("no such scene")));
  EXPECT_TRUE(connection_->DeleteScene({}, {}).ok());
  EXPECT_CALL(*mock_, DeleteScene(_, _)).WillOnce(Return(absl::NotFoundError("no such scene")));
  EXPECT_TRUE(absl::IsNotFound(connection_->DeleteScene({}, {})));
}

TEST_F(RetryingConnectionTest, UploadsArePlayedAgainWhole) {
  std::vector<int> messages;
  const auto count = [&](const Upload<v1::CreateSceneRequest>& upload) {
    int n = 0;
    upload([&](const v1::CreateSceneRequest&) { return ++n < 10; });
    messages.push_back(n);
  };
  EXPECT_CALL(*mock_, CreateScene(_, _))
      .WillOnce([&](const Upload<v1::CreateSceneRequest>& upload, const CallOptions&) {
        count(upload);
        return absl::UnavailableError("lost");
      })
      .WillOnce([&](const Upload<v1::CreateSceneRequest>& upload, const CallOptions&) {
        count(upload);
        return v1::Scene();
      });
  const auto result = connection_->CreateScene(
      [](const std::function<bool(const v1::CreateSceneRequest&)>& write) {
        for (int i = 0; i < 3; ++i) write({});
      },
      {});
  EXPECT_TRUE(result.ok());
  EXPECT_THAT(messages, testing::ElementsAre(3, 3));
}

TEST_F(RetryingConnectionTest, CancellationEndsTheWait) {
  Cancellation cancellation;
  const auto slow = MakeRetryingConnection(mock_, {.give_up_after = absl::InfiniteDuration(),
                                                   .initial_delay = absl::Hours(1),
                                                   .max_delay = absl::Hours(1)});
  EXPECT_CALL(*mock_, GetScene(_, _)).WillOnce([&](const v1::GetSceneRequest&, const CallOptions&) {
    cancellation.Cancel();
    return absl::UnavailableError("gone");
  });
  EXPECT_EQ(slow->GetScene({}, {.cancellation = &cancellation}).status().code(),
            absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace sightline::client
