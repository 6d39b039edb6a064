// SPDX-License-Identifier: Apache-2.0
#include "client/cli/scene_argument.h"

#include <memory>
#include <sstream>
#include <string>
#include <utility>

#include "client/cli/session.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/client/lib/mock_connection.h"

namespace sightline::cli {
namespace {

using client::CallOptions;
using client::MockConnection;
using ::testing::_;
using ::testing::Return;

class MockSession final : public Session {
 public:
  MockSession(std::shared_ptr<client::Connection> connection, client::Cancellation* cancellation)
      : Session(std::move(connection), /*server=*/nullptr, SessionFlags(), cancellation) {}
};

class OpenSceneTest : public ::testing::Test {
 protected:
  // OpenScene of a scene of which the server says `says`, and is done with it nevertheless.
  absl::Status Open(const absl::Status& says) {
    EXPECT_CALL(*connection_, GetCapabilities(_)).WillRepeatedly(Return(v1::Capabilities()));
    EXPECT_CALL(*connection_, CreateScene(_, _))
        .WillOnce([&](const client::Upload<v1::CreateSceneRequest>& upload,
                      const CallOptions& options) -> absl::StatusOr<v1::Scene> {
          EXPECT_EQ(options.cancellation, &cancellation_);
          upload([this](const v1::CreateSceneRequest& request) {
            if (request.has_header()) made_ = "scenes/" + request.header().scene_id();
            return true;
          });
          return says;
        });
    std::ostringstream err;
    return OpenScene(session_, "builtin:box", err).status();
  }

  client::Cancellation cancellation_;
  const std::shared_ptr<MockConnection> connection_ = std::make_shared<MockConnection>();
  const MockSession session_{connection_, &cancellation_};
  std::string made_;
};

TEST_F(OpenSceneTest, WhatWasGivenUpHereIsTakenAwayThere) {
  for (const absl::Status& says : {absl::CancelledError(""), absl::DeadlineExceededError(""),
                                   absl::UnavailableError("lost on the way back")}) {
    EXPECT_CALL(*connection_, DeleteScene(_, _))
        .WillOnce([this](const v1::DeleteSceneRequest& request, const CallOptions& options) {
          EXPECT_EQ(request.name(), made_);
          EXPECT_EQ(options.cancellation, nullptr) << "this call has to be made";
          EXPECT_LT(options.deadline, absl::InfiniteFuture());
          return absl::OkStatus();
        });
    EXPECT_EQ(Open(says).code(), says.code());
  }
}

TEST_F(OpenSceneTest, WhatTheServerRefusedIsNotThere) {
  EXPECT_CALL(*connection_, DeleteScene(_, _)).Times(0);
  EXPECT_EQ(Open(absl::InvalidArgumentError("")).code(), absl::StatusCode::kInvalidArgument);
}

// Nobody waits for a server that was never there to take something away.
TEST_F(OpenSceneTest, NothingIsTakenAwayWhereNothingCanHaveBeenMade) {
  EXPECT_CALL(*connection_, GetCapabilities(_))
      .WillOnce(Return(absl::UnavailableError("no connection")));
  EXPECT_CALL(*connection_, CreateScene(_, _)).Times(0);
  EXPECT_CALL(*connection_, DeleteScene(_, _)).Times(0);
  std::ostringstream err;
  EXPECT_TRUE(absl::IsUnavailable(OpenScene(session_, "builtin:box", err).status()));
}

}  // namespace
}  // namespace sightline::cli
