// SPDX-License-Identifier: Apache-2.0
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "client/lib/connection.h"
#include "client/lib/status.h"
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

// The server may be at work for an attempt whose answer was lost; it is not for a first one.
TEST_F(RetryingConnectionTest, ALaterAttemptWaitsForAnEarlierOne) {
  v1::ItemStatus busy_item;
  busy_item.set_code(10);
  busy_item.set_reason(v1::ERROR_REASON_SCENE_BUSY);
  const absl::Status busy = FromItem(busy_item), lost = absl::UnavailableError("lost the reply");
  v1::Scene scene;
  scene.set_revision(2);
  EXPECT_CALL(*mock_, UpdateScene(_, _))
      .WillOnce(Return(lost))
      .WillOnce(Return(busy))
      .WillOnce(Return(busy))
      .WillOnce(Return(scene));
  const auto updated = connection_->UpdateScene({}, {});
  ASSERT_TRUE(updated.ok()) << updated.status();
  EXPECT_EQ(updated->revision(), 2);
  EXPECT_CALL(*mock_, DeleteScene(_, _))
      .WillOnce(Return(lost))
      .WillOnce(Return(busy))
      .WillOnce(Return(absl::NotFoundError("no such scene")));
  EXPECT_TRUE(connection_->DeleteScene({}, {}).ok());
  EXPECT_CALL(*mock_, LoadScene(_, _)).WillOnce(Return(busy));
  EXPECT_EQ(connection_->LoadScene({}, {}).status(), busy);
  // Other reasons to abort do not pass.
  const absl::Status aborted = absl::AbortedError("no reason");
  EXPECT_CALL(*mock_, LoadScene(_, _)).WillOnce(Return(lost)).WillOnce(Return(aborted));
  EXPECT_EQ(connection_->LoadScene({}, {}).status(), aborted);
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

class RetryingWatchTest : public RetryingConnectionTest {
 protected:
  using Watch = std::function<bool(const v1::WatchSceneResponse&)>;
  // A watch of which `messages` changes come before it ends with `status`.
  static auto Ends(int messages, const absl::Status& status) {
    return [=](const v1::WatchSceneRequest&, const Watch& on_change, const CallOptions&) {
      for (int i = 0; i < messages; ++i) EXPECT_TRUE(on_change({}));
      return status;
    };
  }
  absl::Status WatchScene(Connection& connection) {
    return connection.WatchScene({},
                                 [this](const v1::WatchSceneResponse&) {
                                   ++seen_;
                                   return true;
                                 },
                                 {});
  }
  int seen_ = 0;
};

// However long it went well in between, it is the time since the last change that counts.
TEST_F(RetryingWatchTest, WhatWasSeenIsASuccess) {
  const absl::Status lost = absl::UnavailableError("lost");
  // A second failure without a success in between is too late.
  const auto impatient = MakeRetryingConnection(mock_, {.give_up_after = absl::Milliseconds(50),
                                                        .initial_delay = absl::Milliseconds(40),
                                                        .multiplier = 100.0});
  EXPECT_CALL(*mock_, WatchScene(_, _, _))
      .WillOnce(Ends(1, lost))
      .WillOnce(Ends(2, lost))
      .WillOnce(Ends(1, lost))
      .WillOnce(Ends(1, lost))
      .WillOnce(Ends(1, absl::OkStatus()));
  EXPECT_TRUE(WatchScene(*impatient).ok());
  EXPECT_EQ(seen_, 6);
  EXPECT_CALL(*mock_, WatchScene(_, _, _)).WillOnce(Ends(1, lost)).WillOnce(Ends(0, lost));
  EXPECT_EQ(WatchScene(*impatient), lost);
}

TEST_F(RetryingWatchTest, ASceneThatIsGoneAfterAGapWasDeleted) {
  const absl::Status lost = absl::UnavailableError("lost"), gone = absl::NotFoundError("none");
  EXPECT_CALL(*mock_, WatchScene(_, _, _))
      .WillOnce(Ends(1, lost))
      .WillOnce(Ends(0, lost))
      .WillOnce(Ends(0, gone));
  EXPECT_TRUE(WatchScene(*connection_).ok());
  // One that was never seen was never there.
  EXPECT_CALL(*mock_, WatchScene(_, _, _)).WillOnce(Ends(0, lost)).WillOnce(Ends(0, gone));
  EXPECT_EQ(WatchScene(*connection_), gone);
}

// Waiting is for the first of it: what was seen and is gone would be waited for without end.
TEST_F(RetryingWatchTest, ASceneThatWasSeenIsNotWaitedFor) {
  std::vector<bool> waits;
  EXPECT_CALL(*mock_, WatchScene(_, _, _))
      .Times(3)
      .WillRepeatedly([&](const v1::WatchSceneRequest& request, const Watch& on_change,
                          const CallOptions&) -> absl::Status {
        waits.push_back(request.wait_for_scene());
        if (waits.size() == 2) on_change({});
        if (waits.size() < 3) return absl::UnavailableError("lost");
        return absl::NotFoundError("none");
      });
  v1::WatchSceneRequest request;
  request.set_wait_for_scene(true);
  const Watch go_on = [](const v1::WatchSceneResponse&) { return true; };
  EXPECT_TRUE(connection_->WatchScene(request, go_on, {}).ok());
  EXPECT_THAT(waits, testing::ElementsAre(true, true, false));
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
