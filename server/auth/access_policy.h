// SPDX-License-Identifier: Apache-2.0
//
// Who may do what: an access file, read and checked. One line per caller:
//
//   # ROLES         KIND   WHO
//   query           cert   *.clients.example.org
//   query,admin     cert   spiffe://example.org/operator
//   query           token  nightly
//   sha256:9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08 metrics         token
//   prometheus plain:a-secret-of-16-characters-or-more query,admin     unix
//
// A certificate is known by its subject alternative names or its common name; a leading "*." stands
// for one label. A token is sent as "authorization: Bearer TOKEN" and kept here by its SHA-256, or
// plain. "unix" is whoever may open a Unix socket of the server, by the file's permissions.
//
// Invariants: a policy never changes; every token of the file is compared on every look, in time
// that does not depend on where they differ; errors never quote a token.
//
// Thread safety: constant after construction.
//
//   SL_ASSIGN_OR_RETURN(const AccessPolicy policy, AccessPolicy::Read("access.conf"));
//   const std::optional<Caller> caller = policy.Identify(shown);
#ifndef SIGHTLINE_SERVER_AUTH_ACCESS_POLICY_H_
#define SIGHTLINE_SERVER_AUTH_ACCESS_POLICY_H_

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "server/auth/role.h"

namespace sightline {

// What a caller shows of itself.
struct Shown {
  std::vector<std::string> certificate_names;  // Of a verified certificate.
  std::string authorization;                   // The header or metadata; empty without.
  bool through_unix_socket = false;
};

struct Caller {
  std::string name;  // "token:nightly", "cert:spiffe://example.org/operator", "unix".
  RoleSet roles = kNoRole;
};

class AccessPolicy {
 public:
  // Refuses a file that others may read or write (it holds secrets) or the group may write, and
  // one that belongs to neither this user nor root. InvalidArgument naming file and line, NotFound,
  // PermissionDenied (its mode).
  static absl::StatusOr<AccessPolicy> Read(const std::string& path);
  // `name` stands for the file in errors.
  static absl::StatusOr<AccessPolicy> Parse(absl::string_view name, absl::string_view text);

  // A token that is shown decides, even if it is wrong; then the certificate, then the socket.
  // Nothing: nobody whom the file knows.
  std::optional<Caller> Identify(const Shown& shown) const;

 private:
  using Digest = std::array<uint8_t, 32>;
  struct Token {
    std::string name;
    Digest digest;
    RoleSet roles;
  };
  struct Certificate {
    std::string pattern;
    RoleSet roles;
  };

  absl::Status AddLine(const std::vector<absl::string_view>& words);
  absl::Status AddToken(RoleSet roles, absl::string_view name, absl::string_view secret);
  static Digest Hash(absl::string_view text);
  std::optional<Caller> ByToken(absl::string_view token) const;
  std::optional<Caller> ByCertificate(const std::vector<std::string>& names) const;

  std::vector<Token> tokens_;
  std::vector<Certificate> certificates_;
  RoleSet unix_roles_ = kNoRole;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_AUTH_ACCESS_POLICY_H_
