// SPDX-License-Identifier: Apache-2.0
//
// Who may do what: an access file, read and checked. One line per caller:
//
//   # ROLES      KIND   WHO
//   query        cert   *.clients.example.org
//   query,admin  cert   spiffe://example.org/operator
//   query        token  nightly     sha256:HEX
//   metrics      token  prometheus  plain:a-secret-of-16-characters-or-more
//   query,admin  unix
//   limit        query  rays 4000000
//   limit        query  streams 8
//   limit        admin  uploads 2
//   limit        admin  upload-bytes 4000000000
//   limit        admin  scenes 20
//
// A certificate is known by its subject alternative names or its common name; a leading "*." stands
// for one label. A token is sent as "authorization: Bearer TOKEN" and kept here by its SHA-256, or
// plain. "unix" is whoever may open a Unix socket of the server, by the file's permissions. A limit
// is of each caller with that role: how many rays it may have unanswered in all its streams, how
// many streams (of visibility and of watched scenes) and how many uploads at once, how many bytes
// these may be together, and how many scenes it may have made that are not deleted; of several
// roles with limits the largest counts, and without any the server's own.
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
#include <map>
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
  // Every value of the header or metadata. Several are nobody's: whoever looked at the first alone,
  // or at the last, would know another caller than the next one who looks.
  std::vector<std::string> authorizations;
  bool through_unix_socket = false;
};

// What one caller may have at once, by its roles; 0: the server's own limits alone.
struct CallerLimits {
  uint64_t rays = 0, streams = 0, uploads = 0, upload_bytes = 0, scenes = 0;
};

struct Caller {
  std::string name;  // "token:nightly", "cert:spiffe://example.org/operator", "unix".
  RoleSet roles = kNoRole;
  CallerLimits limits;
};

class AccessPolicy {
 public:
  // Refuses a file that others may read or write (it holds secrets) or the group may write, and
  // one that belongs to neither this user nor root. InvalidArgument naming file and line, NotFound,
  // PermissionDenied (its mode).
  static absl::StatusOr<AccessPolicy> Read(const std::string& path);
  // `name` stands for the file in errors.
  static absl::StatusOr<AccessPolicy> Parse(absl::string_view name, absl::string_view text);

  // A token that is shown decides, even if it is wrong or one of several; then the certificate,
  // then the socket. Nothing: nobody whom the file knows.
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
  absl::Status AddLimit(absl::string_view role, absl::string_view what, absl::string_view number);
  CallerLimits LimitsOf(RoleSet roles) const;
  std::optional<Caller> Recognize(const Shown& shown) const;
  absl::Status AddToken(RoleSet roles, absl::string_view name, absl::string_view secret);
  static Digest Hash(absl::string_view text);
  std::optional<Caller> ByToken(absl::string_view token) const;
  std::optional<Caller> ByCertificate(const std::vector<std::string>& names) const;

  std::vector<Token> tokens_;
  std::vector<Certificate> certificates_;
  RoleSet unix_roles_ = kNoRole;
  std::map<RoleSet, CallerLimits> limits_;  // By one role each.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_AUTH_ACCESS_POLICY_H_
