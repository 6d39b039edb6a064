// SPDX-License-Identifier: Apache-2.0
//
// How a client proves who it is, and makes sure of whom it talks to: certificates and a token, read
// from files.
//
// Invariant: a token never goes over a plain connection to another machine.
//
// Thread safety: functions and plain values.
//
//   SL_ASSIGN_OR_RETURN(options.security, LoadSecurity({.ca = "ca.pem"}, "server:7070"));
//   auto connection = MakeConnection("server:7070", options);
#ifndef SIGHTLINE_CLIENT_LIB_SECURITY_H_
#define SIGHTLINE_CLIENT_LIB_SECURITY_H_

#include <grpcpp/channel.h>
#include <grpcpp/support/channel_arguments.h>

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace sightline::client {

struct SecurityFiles {
  std::string ca;           // PEM authorities of the server's certificate; makes it TLS.
  std::string certificate;  // PEM, the client's own; makes it TLS, too.
  std::string key;          // PEM, of the certificate.
  std::string token;        // Holds a bearer token.
};

// What is in the files.
struct Security {
  bool tls = false;
  std::string ca, certificate, key;  // PEM; no authorities: those of the system.
  std::string token;                 // Empty: none.
};

// Whether the names of the files go together, whatever is in them. InvalidArgument: a certificate
// without its key, a token for a plain connection to another machine.
absl::Status CheckSecurity(const SecurityFiles& files, const std::string& target);

// What CheckSecurity returns; InvalidArgument (no regular file, a token that is empty or many, a
// file that is too large, no PEM or broken PEM, another certificate's key), PermissionDenied
// (others may read the token), and what reading returns.
absl::StatusOr<Security> LoadSecurity(const SecurityFiles& files, const std::string& target);

// The token in file `path`, which none but its owner and group may use. Errors as above.
absl::StatusOr<std::string> LoadToken(const std::string& path);
// Whether `target`, HOST:PORT or unix:PATH, is on this machine: no token goes to another in the
// clear.
bool StaysOnThisMachine(const std::string& target);

// A channel that keeps to it. No proxy of the environment (http_proxy and its like) is asked for a
// target that is on this machine; one is for others.
std::shared_ptr<grpc::Channel> MakeChannel(const std::string& target, const Security& security,
                                           const grpc::ChannelArguments& arguments);

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_SECURITY_H_
