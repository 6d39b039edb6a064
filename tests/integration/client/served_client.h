// SPDX-License-Identifier: Apache-2.0
//
// A client of a real server in this process: what the tests of this folder share.
//
// Thread safety: as client::Client.
#ifndef SIGHTLINE_TESTS_INTEGRATION_CLIENT_SERVED_CLIENT_H_
#define SIGHTLINE_TESTS_INTEGRATION_CLIENT_SERVED_CLIENT_H_

#include <gtest/gtest.h>

#include <array>
#include <memory>
#include <vector>

#include "client/lib/client.h"
#include "client/lib/connection.h"
#include "server/server.h"

namespace sightline::testing_support {

class ServedClientTest : public testing::Test {
 protected:
  void SetUp() override {
    ServerOptions options;
    options.listen.clear();
    options.threads = 2;
    options.build_threads = 1;
    absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(options);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
    std::vector<std::shared_ptr<grpc::Channel>> channels = {
        server_->InProcessChannel(client::DefaultChannelArguments())};
    client_ = std::make_unique<client::Client>(client::MakeConnection(std::move(channels), {}));
  }

  const client::Client& client() const { return *client_; }

  // A square of side 2 in the plane z = `z`, centre (x, 0), as two triangles.
  static std::vector<double> SquareVertices(double x, double z) {
    return {x - 1, -1, z, x + 1, -1, z, x + 1, 1, z, x - 1, 1, z};
  }
  static constexpr std::array<uint32_t, 6> kSquareIndices = {0, 1, 2, 0, 2, 3};

 private:
  std::unique_ptr<Server> server_;
  std::unique_ptr<client::Client> client_;
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_INTEGRATION_CLIENT_SERVED_CLIENT_H_
