// SPDX-License-Identifier: Apache-2.0
//
// Certificates and the access file of the real server, read again at SIGHUP and every
// reload_interval: what is good is taken, what is not leaves the last good one.
#include <sys/stat.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "client/lib/client.h"
#include "client/lib/connection.h"
#include "client/lib/security.h"
#include "gtest/gtest.h"
#include "tests/integration/serving_process.h"
#include "tests/support/http_get.h"
#include "tests/support/temp_dir.h"
#include "tests/support/test_certificates.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

using client::Security;
using testing_support::IssuedCertificate;
using testing_support::TestAuthority;

constexpr char kFirstToken[] = "first-0123456789abcdef";
constexpr char kSecondToken[] = "second-0123456789abcdef";
constexpr char kScrapeToken[] = "metrics-0123456789abcdef";
// Nothing here happens because time has passed.
constexpr char kNever[] = "--reload-interval=24h";
constexpr char kOften[] = "--reload-interval=100ms";

class ReloadTest : public ::testing::Test {
 protected:
  // In one step, as whoever renews files should.
  std::string Write(const std::string& name, const std::string& text) const {
    const std::string path = dir_.File(name), beside = dir_.File("new");
    std::ofstream(beside) << text;
    chmod(beside.c_str(), 0600);
    std::filesystem::rename(beside, path);
    return path;
  }
  std::string WriteAccess(const std::string& token) const {
    return Write("access", absl::StrCat("query token reader plain:", token,
                                        "\nmetrics token prometheus plain:", kScrapeToken, "\n"));
  }
  std::vector<std::string> AccessFlags(const std::string& reload) const {
    return {"--access-file", WriteAccess(kFirstToken), "--metrics-listen=127.0.0.1:0", reload};
  }
  void WriteCertificate(const TestAuthority& authority) const {
    const IssuedCertificate issued =
        authority.Issue({.common_name = "server", .alternative_names = "IP:127.0.0.1"});
    Write("key.pem", issued.key);
    Write("cert.pem", issued.certificate);
  }
  std::vector<std::string> TlsFlags(const std::string& reload) const {
    WriteCertificate(first_);
    return {"--tls-cert",         dir_.File("cert.pem"),          "--tls-key",
            dir_.File("key.pem"), "--metrics-listen=127.0.0.1:0", reload};
  }
  // By a new connection.
  static absl::Status List(const ServingProcess& server, const Security& security) {
    client::ConnectionOptions options;
    options.retry.give_up_after = absl::ZeroDuration();
    options.channels = 1;
    options.security = security;
    return client::Client(client::MakeConnection(server.address(), options)).ListScenes().status();
  }
  static Security Trusting(const TestAuthority& authority) {
    return {.tls = true, .ca = authority.pem()};
  }
  static double Count(const ServingProcess& server, const std::string& name) {
    return testing_support::MetricOf(server.metrics_port(), name,
                                     absl::StrCat("Authorization: Bearer ", kScrapeToken, "\r\n"));
  }
  // Until the server has counted so many in all.
  static testing::AssertionResult UntilCounted(const ServingProcess& server,
                                               const std::string& name, double count) {
    return testing_support::Until(absl::StrCat(name, " is ", count),
                                  [&] { return Count(server, name) >= count; });
  }
  static testing::AssertionResult UntilReloaded(const ServingProcess& server, double more) {
    return UntilCounted(server, kReloads, Count(server, kReloads) + more);
  }

  static constexpr char kReloads[] = "sightline_security_reloads_total";
  static constexpr char kFailedReloads[] = "sightline_failed_security_reloads_total";
  const testing_support::TempDir dir_;
  const TestAuthority first_{"first"}, second_{"second"};
};

TEST_F(ReloadTest, SighupReadsTheAccessFile) {
  ServingProcess server(AccessFlags(kNever));
  EXPECT_EQ(List(server, {.token = kFirstToken}), absl::OkStatus());
  EXPECT_TRUE(absl::IsUnauthenticated(List(server, {.token = kSecondToken})));
  EXPECT_EQ(Count(server, kReloads), 0);
  WriteAccess(kSecondToken);
  server.Signal(SIGHUP);
  ASSERT_TRUE(UntilCounted(server, kReloads, 1));
  EXPECT_EQ(List(server, {.token = kSecondToken}), absl::OkStatus());
  EXPECT_TRUE(absl::IsUnauthenticated(List(server, {.token = kFirstToken})));
  // What makes no sense is refused, and says so.
  Write("access", "everybody everything\n");
  server.Signal(SIGHUP);
  ASSERT_TRUE(UntilCounted(server, kFailedReloads, 1));
  EXPECT_EQ(List(server, {.token = kSecondToken}), absl::OkStatus());
  EXPECT_EQ(Count(server, kReloads), 1);
  // Nor is that the end of it.
  WriteAccess(kFirstToken);
  server.Signal(SIGHUP);
  ASSERT_TRUE(UntilCounted(server, kReloads, 2));
  EXPECT_EQ(List(server, {.token = kFirstToken}), absl::OkStatus());
  server.Signal(SIGTERM);
  EXPECT_EQ(server.Wait(), 0);
}

// Who expects the configuration to be read again is told that it was not.
TEST_F(ReloadTest, SighupSaysWhatItRead) {
  ServingProcess server(AccessFlags(kNever));
  server.Signal(SIGHUP);
  ASSERT_TRUE(
      testing_support::Until("it says so", [&] { return server.HasSaid("event=reloaded"); }));
  EXPECT_TRUE(server.HasSaid(absl::StrCat("event=reloaded files=", dir_.File("access"),
                                          " configuration=\"as at the start")));
  ServingProcess bare({kNever});
  bare.Signal(SIGHUP);
  ASSERT_TRUE(testing_support::Until("it says so",
                                     [&] { return bare.HasSaid("event=nothing_to_reload"); }));
  bare.Signal(SIGTERM);
  EXPECT_EQ(bare.Wait(), 0);
  EXPECT_FALSE(bare.HasSaid("event=reloaded"));
}

TEST_F(ReloadTest, TheIntervalReadsTheAccessFile) {
  ServingProcess server(AccessFlags(kOften));
  EXPECT_EQ(List(server, {.token = kFirstToken}), absl::OkStatus());
  WriteAccess(kSecondToken);
  // The first may have begun before.
  ASSERT_TRUE(UntilReloaded(server, 2));
  EXPECT_EQ(List(server, {.token = kSecondToken}), absl::OkStatus());
  EXPECT_TRUE(absl::IsUnauthenticated(List(server, {.token = kFirstToken})));
  std::filesystem::remove(dir_.File("access"));
  ASSERT_TRUE(UntilCounted(server, kFailedReloads, 1));
  EXPECT_EQ(List(server, {.token = kSecondToken}), absl::OkStatus());
}

TEST_F(ReloadTest, SighupReadsCertificates) {
  ServingProcess server(TlsFlags(kNever));
  EXPECT_EQ(List(server, Trusting(first_)), absl::OkStatus());
  EXPECT_TRUE(absl::IsUnavailable(List(server, Trusting(second_))));
  WriteCertificate(second_);
  server.Signal(SIGHUP);
  ASSERT_TRUE(UntilCounted(server, kReloads, 1));
  EXPECT_EQ(List(server, Trusting(second_)), absl::OkStatus());
  EXPECT_TRUE(absl::IsUnavailable(List(server, Trusting(first_))));
  Write("cert.pem", "garbage");
  server.Signal(SIGHUP);
  ASSERT_TRUE(UntilCounted(server, kFailedReloads, 1));
  EXPECT_EQ(List(server, Trusting(second_)), absl::OkStatus());
}

// While one file is new and the other is not, they do not fit: the last good pair serves on.
TEST_F(ReloadTest, TheIntervalReadsCertificates) {
  ServingProcess server(TlsFlags(kOften));
  EXPECT_EQ(List(server, Trusting(first_)), absl::OkStatus());
  const IssuedCertificate next =
      second_.Issue({.common_name = "server", .alternative_names = "IP:127.0.0.1"});
  Write("key.pem", next.key);
  ASSERT_TRUE(UntilCounted(server, kFailedReloads, 1));
  EXPECT_EQ(List(server, Trusting(first_)), absl::OkStatus());
  Write("cert.pem", next.certificate);
  ASSERT_TRUE(UntilReloaded(server, 1));
  EXPECT_EQ(List(server, Trusting(second_)), absl::OkStatus());
  EXPECT_TRUE(absl::IsUnavailable(List(server, Trusting(first_))));
}

}  // namespace
}  // namespace sightline
