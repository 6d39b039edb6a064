// SPDX-License-Identifier: Apache-2.0
//
// What a server makes at its start of the scenes that are stored: of those that it does not load,
// or cannot, and of those that have the name of an option's.
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>

#include "absl/strings/str_cat.h"
#include "client/lib/client.h"
#include "client/lib/connection.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "server/options.h"
#include "server/server.h"
#include "tests/integration/repository_server.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using client::Health;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class RepositoryStartTest : public ::testing::Test {
 protected:
  ServerOptions Options() const { return RepositoryOptions(dir_.path()); }
  // Stops the server, and starts one on the same folder.
  void Start(const ServerOptions& options) {
    client_.reset();
    server_.reset();
    SetLogLevel(LogLevel::kOff);
    absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(options);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
    client_ = ClientInProcess(*server_);
  }
  void Store(const std::string& id) const {
    const absl::StatusOr<client::Scene> scene =
        client_->CreateScene({.scene_id = id, .builtin = "builtin:box:1000"});
    ASSERT_TRUE(scene.ok()) << scene.status();
    ASSERT_TRUE(scene->stored) << scene->state_message;
  }
  std::string Read(const std::string& id) const {
    std::ostringstream bytes;
    bytes << std::ifstream(dir_.File(id + ".slscene"), std::ios::binary).rdbuf();
    return bytes.str();
  }
  // Another file in the place of whichever is mapped.
  void Write(const std::string& id, const std::string& bytes) const {
    std::ofstream(dir_.File("new"), std::ios::binary) << bytes;
    std::filesystem::rename(dir_.File("new"), dir_.File(id + ".slscene"));
  }
  Health HealthOf(const std::string& id) const {
    const absl::StatusOr<Health> health = client_->CheckHealth(absl::StrCat("scenes/", id));
    EXPECT_TRUE(health.ok()) << health.status();
    return health.value_or(Health::kUnknown);
  }

  const testing_support::TempDir dir_;
  std::unique_ptr<Server> server_;
  std::unique_ptr<client::Client> client_;
};

// A balancer that asks for a scene hears the same of one that did not load at the start as of one
// that fails later.
TEST_F(RepositoryStartTest, ScenesThatAreNotLoadedHaveAHealth) {
  ServerOptions options = Options();
  ASSERT_NO_FATAL_FAILURE(Start(options));
  ASSERT_NO_FATAL_FAILURE(Store("good"));
  Write("bad", "no scene file at all");
  ASSERT_NO_FATAL_FAILURE(Start(options));
  EXPECT_EQ(HealthOf("good"), Health::kServing);
  EXPECT_EQ(HealthOf("bad"), Health::kNotServing);
  EXPECT_EQ(HealthOf("none"), Health::kServiceUnknown);
  options.load_repository = false;
  ASSERT_NO_FATAL_FAILURE(Start(options));
  EXPECT_EQ(HealthOf("good"), Health::kNotServing);
  ASSERT_TRUE(client_->LoadScene("scenes/good").ok());
  EXPECT_EQ(HealthOf("good"), Health::kServing);
  // What comes while it runs is known once it was in memory, or failed on its way there.
  Write("late", Read("good"));
  EXPECT_EQ(HealthOf("late"), Health::kServiceUnknown);
  ASSERT_TRUE(client_->LoadScene("scenes/late").ok());
  EXPECT_EQ(HealthOf("late"), Health::kServing);
  std::string bytes = Read("good");
  bytes[bytes.size() / 2] ^= 1;  // Seen when all of it is read.
  Write("spoilt", bytes);
  EXPECT_EQ(HealthOf("spoilt"), Health::kServiceUnknown);
  EXPECT_TRUE(absl::IsDataLoss(client_->LoadScene("scenes/spoilt").status()));
  EXPECT_EQ(HealthOf("spoilt"), Health::kNotServing);
}

// Somebody deleted the scene that an option made, and stored another of its name: that is no reason
// for a server not to start again.
TEST_F(RepositoryStartTest, AStoredSceneStaysInThePlaceOfAnOptions) {
  ServerOptions options = Options();
  options.scenes = {"hall=builtin:box:1000", "other=builtin:box:1000"};
  ASSERT_NO_FATAL_FAILURE(Start(options));
  EXPECT_FALSE(client_->GetScene("scenes/hall")->stored);
  EXPECT_THAT(StoredInstead(options), ElementsAre());
  ASSERT_TRUE(client_->DeleteScene("scenes/hall").ok());
  ASSERT_NO_FATAL_FAILURE(Store("hall"));
  EXPECT_TRUE(CheckOptions(options).ok());
  EXPECT_THAT(StoredInstead(options), ElementsAre(HasSubstr("hall=builtin:box:1000")));
  for (const bool load : {true, false}) {
    options.load_repository = load;
    ASSERT_NO_FATAL_FAILURE(Start(options));
    EXPECT_TRUE(client_->GetScene("scenes/other").ok());
    EXPECT_EQ(client_->GetScene("scenes/hall").ok(), load);
    const auto hall = client_->LoadScene("scenes/hall");
    ASSERT_TRUE(hall.ok()) << hall.status();
    EXPECT_TRUE(hall->stored);
  }
  // Nor is one that cannot be read.
  Write("hall", "no scene file at all");
  options.load_repository = true;
  ASSERT_NO_FATAL_FAILURE(Start(options));
  EXPECT_TRUE(client_->GetScene("scenes/other").ok());
  EXPECT_FALSE(client_->GetScene("scenes/hall").ok());
}

}  // namespace
}  // namespace sightline
