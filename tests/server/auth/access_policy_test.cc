// SPDX-License-Identifier: Apache-2.0
#include "server/auth/access_policy.h"

#include <grpcpp/test/server_context_test_spouse.h>
#include <sys/stat.h>

#include <fstream>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "server/admission/client_name.h"
#include "server/auth/access_control.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// The SHA-256 of "correct horse battery staple".
constexpr char kHash[] = "c4bbcb1fbec99d65bf59d85c8cb62ee2db963f0fe106f483d9afa73bd4e39a8a";

AccessPolicy Policy() {
  const absl::StatusOr<AccessPolicy> policy =
      AccessPolicy::Parse("a", std::string("# Callers.\n\nquery  cert *.clients.example.org\n"
                                           "query,admin\tcert spiffe://example.org/operator\n"
                                           "metrics token prometheus plain:0123456789abcdef\n"
                                           "query,metrics token nightly sha256:") +
                                   kHash + "\nadmin unix\n");
  EXPECT_TRUE(policy.ok()) << policy.status();
  return *policy;
}

TEST(AccessPolicyTest, TokensAreKnownPlainAndHashed) {
  const AccessPolicy policy = Policy();
  const std::optional<Caller> plain =
      policy.Identify({.authorizations = {"Bearer 0123456789abcdef"}});
  ASSERT_TRUE(plain.has_value());
  EXPECT_EQ(plain->name, "token:prometheus");
  EXPECT_EQ(plain->roles, kMetricsRole);
  const std::optional<Caller> hashed =
      policy.Identify({.authorizations = {"bearer correct horse battery staple"}});
  ASSERT_TRUE(hashed.has_value());
  EXPECT_EQ(hashed->roles, kQueryRole | kMetricsRole);
  for (const char* wrong : {"Bearer 0123456789abcdeF", "Bearer 0123456789abcde", "Bearer ",
                            "0123456789abcdef", "Basic 0123456789abcdef", "Bearer", kHash}) {
    EXPECT_FALSE(policy.Identify({.authorizations = {wrong}}).has_value()) << wrong;
  }
  // The hash is no token.
  EXPECT_FALSE(policy.Identify({.authorizations = {std::string("Bearer ") + kHash}}).has_value());
}

TEST(AccessPolicyTest, CertificatesAreKnownByTheirNames) {
  const AccessPolicy policy = Policy();
  const auto roles = [&](std::vector<std::string> names) {
    const std::optional<Caller> caller = policy.Identify({.certificate_names = std::move(names)});
    return caller.has_value() ? caller->roles : kNoRole;
  };
  EXPECT_EQ(roles({"a.clients.example.org"}), kQueryRole);
  EXPECT_EQ(roles({"other", "spiffe://example.org/operator"}), kQueryRole | kAdminRole);
  EXPECT_EQ(roles({"clients.example.org"}), kNoRole);
  EXPECT_EQ(roles({"a.b.clients.example.org"}), kNoRole);
  EXPECT_EQ(roles({".clients.example.org"}), kNoRole);
  EXPECT_EQ(roles({"a.clients.example.org.evil.com"}), kNoRole);
  EXPECT_EQ(roles({}), kNoRole);
}

TEST(AccessPolicyTest, AWrongTokenIsNotSavedByAnythingElse) {
  const Shown shown{.certificate_names = {"a.clients.example.org"},
                    .authorizations = {"Bearer wrong"},
                    .through_unix_socket = true};
  EXPECT_FALSE(Policy().Identify(shown).has_value());
}

// Not the first of them, not the last, and nothing else that is shown beside them.
TEST(AccessPolicyTest, SeveralAuthorizationsAreNobodys) {
  const std::string good = "Bearer 0123456789abcdef";
  for (const std::string& other : {std::string("Bearer wrong"), std::string(), good}) {
    for (const auto& both : {std::vector{good, other}, std::vector{other, good}}) {
      const Shown shown{.certificate_names = {"a.clients.example.org"},
                        .authorizations = both,
                        .through_unix_socket = true};
      EXPECT_FALSE(Policy().Identify(shown).has_value()) << other;
    }
  }
}

TEST(AccessPolicyTest, UnixSocketsAreNamedApart) {
  EXPECT_EQ(Policy().Identify({.through_unix_socket = true})->roles, kAdminRole);
  const AccessPolicy without = *AccessPolicy::Parse("a", "query cert x\n");
  EXPECT_FALSE(without.Identify({.through_unix_socket = true}).has_value());
}

TEST(AccessPolicyTest, RolesHaveLimits) {
  const absl::StatusOr<AccessPolicy> policy = AccessPolicy::Parse(
      "a",
      "query cert a\nquery,admin cert b\nmetrics cert c\nlimit query rays 1000\n"
      "limit admin rays 5000\nlimit query streams 3\nlimit metrics,admin uploads 2\n"
      "limit admin upload-bytes 5000000000\nlimit query scenes 4\n");
  ASSERT_TRUE(policy.ok()) << policy.status();
  const auto limit = [&](const char* name) {
    return policy->Identify({.certificate_names = {name}})->limits;
  };
  EXPECT_EQ(limit("a").rays, 1000u);
  EXPECT_EQ(limit("a").streams, 3u);
  EXPECT_EQ(limit("a").uploads, 0u);
  EXPECT_EQ(limit("b").rays, 5000u);
  EXPECT_EQ(limit("b").streams, 3u);
  EXPECT_EQ(limit("b").uploads, 2u);
  EXPECT_EQ(limit("b").upload_bytes, 5'000'000'000u);
  EXPECT_EQ(limit("b").scenes, 4u);
  EXPECT_EQ(limit("a").upload_bytes, 0u);
  EXPECT_EQ(limit("c").scenes, 0u);
  EXPECT_EQ(limit("c").rays, 0u);
  EXPECT_EQ(limit("c").uploads, 2u);
  for (const char* wrong : {"limit query rays 0\n", "limit query rays many\n", "limit query 3\n",
                            "limit reader rays 3\n", "limit query bytes 3\n"}) {
    EXPECT_FALSE(AccessPolicy::Parse("a", wrong).ok()) << wrong;
  }
}

TEST(AccessPolicyTest, ErrorsNameTheLineAndNoSecret) {
  const std::pair<std::string, const char*> cases[] = {
      {"query\n", "a:1: must be ROLES"},
      {"\nquery cert\n", "a:2: must be ROLES"},
      {"reader cert x\n", "\"reader\" is no role; there are query, admin, metrics"},
      {"query token t plain:secretsecret\n", "can be guessed"},
      {"query token t secretsecretsecret\n", "sha256:HEX or plain:TEXT"},
      {"query token t sha256:secretsecret\n", "64 hexadecimal digits"},
      {"query token t plain:secretsecretsecret\nquery token t plain:0123456789abcdef\n",
       "there already"},
      {"query token t plain:secretsecretsecret\nquery token u plain:secretsecretsecret\n",
       "there already, as t"},
      {"query unix x\n", "must be ROLES"},
  };
  for (const auto& [text, message] : cases) {
    const absl::Status status = AccessPolicy::Parse("a", text).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << text;
    EXPECT_THAT(std::string(status.message()), HasSubstr(message)) << text;
    EXPECT_THAT(std::string(status.message()), Not(HasSubstr("secretsecret"))) << text;
  }
}

TEST(AccessPolicyTest, AFileThatOthersMayReadIsRefused) {
  const testing_support::TempDir dir;
  const std::string path = dir.File("access");
  std::ofstream(path) << "query cert x\n";
  for (const mode_t mode : {0644, 0604, 0620, 0602}) {
    chmod(path.c_str(), mode);
    const absl::Status status = AccessPolicy::Read(path).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kPermissionDenied) << std::oct << mode;
    EXPECT_THAT(std::string(status.message()), HasSubstr("chmod 600"));
  }
  for (const mode_t mode : {0600, 0400, 0440}) {
    chmod(path.c_str(), mode);
    EXPECT_TRUE(AccessPolicy::Read(path).ok()) << std::oct << mode;
  }
  EXPECT_EQ(AccessPolicy::Read(dir.File("none")).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(AccessPolicy::Read(dir.path()).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(AccessControlTest, AReloadThatFailsKeepsThePolicy) {
  const testing_support::TempDir dir;
  const std::string path = dir.File("access");
  const auto write = [&](const char* text) {
    std::ofstream(path) << text;
    chmod(path.c_str(), 0600);
  };
  constexpr char kMethod[] = "/sightline.v1.SceneService/DeleteScene";
  const Shown shown{.certificate_names = {"x"}};
  AccessControl access;
  EXPECT_TRUE(access.Check(kMethod, {}).ok());  // Without a file everybody may.
  write("query cert x\n");
  ASSERT_TRUE(access.Load(path).ok());
  EXPECT_EQ(access.Check(kMethod, {}).code(), absl::StatusCode::kUnauthenticated);
  const absl::Status denied = access.Check(kMethod, shown);
  EXPECT_EQ(denied.code(), absl::StatusCode::kPermissionDenied);
  EXPECT_THAT(std::string(denied.message()), HasSubstr("wants the role admin; cert:x has query"));
  EXPECT_TRUE(access.Check("/grpc.health.v1.Health/Check", {}).ok());
  EXPECT_FALSE(access.Check("/some.Other/Method", shown).ok());
  write("nonsense\n");
  EXPECT_FALSE(access.Reload().ok());
  EXPECT_EQ(access.Check(kMethod, shown).code(), absl::StatusCode::kPermissionDenied);
  write("admin cert x\n");
  EXPECT_TRUE(access.Reload().ok());
  EXPECT_TRUE(access.Check(kMethod, shown).ok());
}

// Who the check before a call takes a caller for, and what its quotas are then.
TEST(AccessControlTest, WhomTheFileDoesNotKnowHasNextToNothing) {
  const testing_support::TempDir dir;
  const std::string path = dir.File("access");
  std::ofstream(path) << "query token a plain:0123456789abcdef\nlimit query rays 1000000\n";
  chmod(path.c_str(), 0600);
  AccessControl access;
  ASSERT_TRUE(access.Load(path).ok());
  grpc::ServerContext context;
  grpc::testing::ServerContextTestSpouse metadata(&context);
  metadata.AddClientMetadata("authorization", "Bearer 0123456789abcdef");
  EXPECT_EQ(ClientOf(context, &access).name, "token:a");
  EXPECT_EQ(ClientOf(context, &access).limits.rays, 1'000'000u);
  metadata.AddClientMetadata("authorization", "Bearer junk");
  EXPECT_EQ(ShownBy(context).authorizations.size(), 2u);
  // And no part of what others have who come by the same way, all of a Unix socket for one.
  EXPECT_EQ(ClientOf(context, &access).name, "unknown:" + ClientOfPeer(context.peer()));
  const CallerLimits unknown = ClientOf(context, &access).limits;
  EXPECT_EQ(unknown.rays, 1u);
  EXPECT_EQ(unknown.streams, 1u);
  EXPECT_EQ(unknown.uploads, 1u);
  EXPECT_EQ(unknown.upload_bytes, 1u);
  EXPECT_EQ(unknown.scenes, 1u);
  EXPECT_EQ(ClientOf(context, nullptr).limits.rays, 0u);
}

}  // namespace
}  // namespace sightline
