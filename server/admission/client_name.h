// SPDX-License-Identifier: Apache-2.0
//
// Who a call comes from, as far as sharing and quotas go: an authenticated identity, or else the
// address without its port, so that many connections of one machine are one client. All callers
// through a Unix socket are one, as are those behind one proxy, and beside them, "unknown:" before
// the address, those whom an access file does not know.
//
// Thread safety: functions only.
//
//   scheduler.Open(ClientOf(*context, access).name);   // "ipv4:10.1.2.3"
#ifndef SIGHTLINE_SERVER_ADMISSION_CLIENT_NAME_H_
#define SIGHTLINE_SERVER_ADMISSION_CLIENT_NAME_H_

#include <grpcpp/server_context.h>

#include <cstdint>
#include <string>

#include "absl/strings/string_view.h"
#include "server/auth/access_control.h"

namespace sightline {

struct Client {
  std::string name;
  CallerLimits limits;
};

// `access` may be null. Whom an active one does not know may have next to nothing.
Client ClientOf(const grpc::ServerContextBase& context, const AccessControl* access);

// Of gRPC's name of a peer, such as "ipv4:10.1.2.3:40211" or "unix:".
std::string ClientOfPeer(absl::string_view peer);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_CLIENT_NAME_H_
