// SPDX-License-Identifier: Apache-2.0
//
// The server in this process. The one file of the tool that includes the server's headers.
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/session.h"
#include "server/server.h"

namespace sightline::cli {
namespace {

class EmbeddedSession final : public Session {
 public:
  EmbeddedSession(client::Client client, std::unique_ptr<Server> server, const SessionFlags& flags)
      : Session(std::move(client), /*embedded=*/true, flags), server_(std::move(server)) {}

 private:
  std::unique_ptr<Server> server_;
};

}  // namespace
